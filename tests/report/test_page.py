"""A report's page: whole in one file, hostile names stay text, and a browser draws it without a word of complaint."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from click.testing import CliRunner

from vsalog.cli import cli
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence
from vsalog.figures.joint_figures import joint_charts
from vsalog.report.document import Document, Figures
from vsalog.report.html import page_of
from vsalog.report.validate import report_document
from vsalog.validation.document import VERSION, JointReport, LogReport, Report

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\u2028<!--"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


def evidence(count, joint="elbow"):
    t = np.arange(count) * 1e-3
    phi = 0.1 * np.sin(t)
    torque = 20.0 * phi + 500.0 * phi**3
    noise = 0.02 * np.random.default_rng(1).standard_normal(count)
    part = TransmissionEvidence(
        phi, torque, np.full(count, 0.01), torque + noise, "sensor", 20.0 + 1500.0 * phi**2, np.full(count, 0.3), None,
        np.abs(phi) < 0.095,
    )  # fmt: skip
    return JointEvidence(joint, t, None, "rad", {"1": part}, None)


def drawn(logs, columns=1200):
    return [{joint.joint: joint_charts(joint, columns) for joint in joints} for joints in logs]


def write_page(path, title, found, charts):
    """Write a validation's page, or one of nothing but figures."""
    figures = [
        Figures(tuple(own), f"{j} {n}") for log in charts for j, parts in log.items() for n, own in parts.items()
    ]
    document = Document(title, "", tuple(figures)) if found is None else report_document(found, drawn=charts)
    path.write_text(page_of(document), encoding="utf-8")


def report(name):
    joint = JointReport(
        joint=name, verdict="holds", reasons=(), findings=(), sentences=(f"About {name}.", "Two.", "Three."), duration=1.0,
        period=1e-3, transmissions=(), warnings=(f"warning of {name}",),
    )  # fmt: skip
    return Report(
        version=VERSION, vsalog="0", model=name, model_sha256="0" * 64, model_logs={name: "1" * 64}, settings={name: name},
        rig=f'name = "{name}"', logs=(LogReport(log=name, sha256="2" * 64, joints=(joint,)),),
    )  # fmt: skip


def test_an_hour_makes_a_small_page_that_needs_nothing_else(tmp_path):
    path = tmp_path / "page.html"
    write_page(path, "an hour", None, drawn([[evidence(3_600_000)]]))
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 6_000_000
    for loads in (r'<script[^>]+src\s*=\s*["\']', r"<link[^>]+href", r"@import", r"url\(\s*['\"]?https?:"):
        assert not re.search(loads, text.split("</style>")[0] if loads == r"@import" else text[:200_000]), loads
    assert "prefers-color-scheme" in text
    assert "@media print" in text


def test_hostile_names_stay_text(tmp_path):
    path = tmp_path / "page.html"
    write_page(path, HOSTILE, report(HOSTILE), drawn([[evidence(2000, HOSTILE)]]))
    text = path.read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "<img src=x" not in text
    assert "&lt;script&gt;alert(1)" in text


def browsed(page, folder):
    """Return a page's document as a browser leaves it, and what it complained of."""
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}", "--virtual-time-budget=10000",
        "--enable-logging=stderr", "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout, said


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_draws_it_without_complaint_and_without_a_network(tmp_path, samples):
    page = tmp_path / "page.html"
    arguments = ["estimate", str(samples / "awas_exp1.mcap"), "-o", str(tmp_path), "--report", str(page)]
    assert CliRunner().invoke(cli, arguments).exit_code == 0
    document, said = browsed(page, tmp_path / "profile")
    assert said == []
    assert document.count("main-svg") > 4
    hostile = tmp_path / "hostile.html"
    write_page(hostile, HOSTILE, report(HOSTILE), drawn([[evidence(2000, HOSTILE)]]))
    document, said = browsed(hostile, tmp_path / "profile")
    assert said == []
    assert "main-svg" in document
    assert "'unsafe-inline'" not in document.split("script-src ")[1].split(";")[0]
    text = hostile.read_text(encoding="utf-8")
    hostile.write_text(text.replace("</body>", "<script>document.title = 'run'</script></body>"), encoding="utf-8")
    document, said = browsed(hostile, tmp_path / "profile")
    assert "<title>run</title>" not in document  # a script that got in all the same
    assert any("Content Security Policy" in line for line in said)
    assert "<img src=" not in document.replace('<img src="data:', "")
