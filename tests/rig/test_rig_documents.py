"""The JSON Schema and docs/reference/rig say what the structures say."""

import json
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from vsalog.rig import Rig, presets
from vsalog.rig.load import preset_text
from vsalog.rig.schema_file import rig_schema, schema_text, structures

DOCS = Path(__file__).parents[2] / "docs"
# A heading between two pages ends the section before it.
TEXT = "\n## \n".join(path.read_text(encoding="utf-8") for path in sorted((DOCS / "reference" / "rig").glob("*.md")))
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
# The heading under which the keys of each structure are described.
SECTIONS = {
    "RigFile": "The file", "RigidJoint": "Rigid", "ElasticJoint": "Elastic", "SerialJoint": "Serial",
    "AntagonisticJoint": "Antagonistic", "Motor": "Motors", "Link": "Link", "Lever": "Lever", "Basis": "Basis",
    "LinearTransmission": "Transmissions", "CubicTransmission": "Transmissions", "Vsa2Transmission": "Transmissions",
    "AwasTransmission": "Transmissions", "UnknownTransmission": "Transmissions", "SingleSignals": "Signals",
    "SerialSignals": "Signals", "AntagonisticSignals": "Signals", "Signal": "Signals", "Run": "Runs",
    **dict.fromkeys(("PneumaticJoint", "Air", "Valve", "Muscle", "Seesaw", "LinearForce", "BraidForce", "ExponentialForce",
                     "SpringForce", "PressureFriction", "SimpleFriction", "TonduFriction"), "Pneumatic"),
    "PneumaticSignals": "Signals", "Eccentricity": "Signals", "Friction": "Friction", "Cogging": "Cogging",
    "PolynomialTransmission": "Transmissions", "ExponentialTransmission": "Transmissions", "BoucWen": "Hysteresis",
    "SlipElement": "Hysteresis", "PositionServo": "Drive", "Payload": "Link", "Contact": "Link",
    **dict.fromkeys(("Chain", "ChainLink", "Coupling", "Accelerometer"), "Chain"),
}  # fmt: skip
VALIDATOR = jsonschema.Draft202012Validator(rig_schema())


def section(title):
    match = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^## |^### |\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert match is not None, f"docs/reference/rig have no heading '{title}'"
    return match[1]


@pytest.mark.parametrize("struct", structures(), ids=lambda s: s.cls.__name__)
def test_every_key_is_documented(struct):
    text = section(SECTIONS[struct.cls.__name__])
    for field in struct.fields:
        assert f"`{field.encode_name}`" in text, f"{struct.cls.__name__}.{field.encode_name}"
    if struct.tag is not None:
        assert f'`"{struct.tag}"`' in text


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_every_example_loads_and_validates(example):
    Rig.from_toml(example)
    VALIDATOR.validate(tomllib.loads(example))


def test_there_is_an_example_of_each_kind():
    for kind in ("rigid", "elastic", "serial", "antagonistic", "pneumatic"):
        assert any(f'kind = "{kind}"' in example for example in EXAMPLES)


@pytest.mark.parametrize(
    "struct", [s for s in structures() if s.cls.__name__.endswith("Transmission")], ids=lambda s: s.cls.__name__
)
def test_there_is_an_example_of_each_transmission(struct):
    assert struct.tag == "unknown" or any(f'type = "{struct.tag}"' in example for example in EXAMPLES)


@pytest.mark.parametrize(
    "key", ["friction", "cogging", "bouc_wen", "slip", "backlash", "payload", "contact", "eccentricity"]
)
def test_there_is_an_example_of_each_effect(key):
    assert any(re.search(rf"^{key} =|\.{key}\]", example, re.MULTILINE) for example in EXAMPLES)


def test_the_schema_file_is_up_to_date():
    assert (DOCS / "rig.schema.json").read_text(encoding="utf-8") == schema_text(), (
        "run: python -m vsalog.rig.schema_file > docs/rig.schema.json"
    )


def test_the_schema_is_a_schema_without_nulls():
    jsonschema.Draft202012Validator.check_schema(rig_schema())
    assert '"null"' not in json.dumps(rig_schema())


@pytest.mark.parametrize("name", presets())
def test_presets_validate_as_written_and_as_loaded(name):
    VALIDATOR.validate(tomllib.loads(preset_text(name)))
    VALIDATOR.validate(tomllib.loads(Rig.preset(name).to_toml()))


@pytest.mark.parametrize(
    "text",
    [
        "colour = 1",
        '[joint.a]\nkind = "series"',
        "[joint.a]",
        '[joint.a]\nkind = "elastic"\n[joint.a.motor]\ninertai = 1',
        '[joint.a]\nkind = "elastic"\n[joint.a.motor]\ninertia = -1',
        '[joint.a]\nkind = "elastic"\n[joint.a.motor]\ngear_ratio = "50"',
        '[joint.a]\nkind = "elastic"\n[joint.a.signals]\nsetpoint = "x"',
    ],
)
def test_the_schema_refuses(text):
    assert not VALIDATOR.is_valid(tomllib.loads(text))


def test_every_key_of_the_schema_is_explained():
    for name, definition in rig_schema()["$defs"].items():
        assert definition["description"], name
