"""What is written of the package in several places agrees: its version, its dependencies, the weight of none is unexplained."""

import re
import tomllib
from pathlib import Path

import pytest

import vsalog

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# What conda calls otherwise.
IN_CONDA = {"matplotlib": "matplotlib-base"}


def name(requirement):
    return re.split(r"[\[<>=; ]", requirement)[0]


def test_the_conda_recipe_requires_what_the_package_requires():
    text = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    run = text.split("  run:\n")[1].split("\n\n")[0]
    listed = {line.strip("- ").replace(" ", "") for line in run.splitlines() if "python >=" not in line}
    assert listed == {
        required.replace(name(required), IN_CONDA.get(name(required), name(required)))
        for required in PROJECT["dependencies"]
    }
    assert f'python_min: "{PROJECT["requires-python"].removeprefix(">=")}"' in text


@pytest.mark.parametrize(("file", "line"), [("conda/recipe.yaml", 'version: "{}"'), ("CITATION.cff", "version: {}")])
def test_files_have_the_version_of_the_package(file, line):
    assert line.format(vsalog.__version__) in (ROOT / file).read_text(encoding="utf-8")


def test_every_dependency_has_its_reason():
    text = (ROOT / "docs" / "contributing" / "dependencies.md").read_text(encoding="utf-8")
    told = {word for row in re.findall(r"^\| ([^|]+) \|", text, re.M) for word in re.split(r", ", row)}
    extras = PROJECT["optional-dependencies"]
    users = [
        *PROJECT["dependencies"],
        *(r for extra, listed in extras.items() if extra not in ("test", "benchmark", "dev") for r in listed),
    ]
    assert {name(required) for required in users} <= told


def test_supported_versions_of_python_are_classified_and_tested():
    classified = {c.split(" :: ")[-1] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)}
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert classified == set(re.findall(r'"(3\.\d+)"', workflow.split("matrix:")[1].split("steps:")[0]))
