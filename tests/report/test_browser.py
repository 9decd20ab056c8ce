"""A page in a browser, driven by a script that is added to it: figures answer, names stay text, colours follow."""

import base64
import hashlib
import html
import json
import re
import shutil
import subprocess

import pytest
from msgspec.structs import replace
from reports_evidence import HOSTILE, drawn, evidence, lever_arm_joint, report

from vsalog.report.page import write_page
from vsalog.validation.document import Comparison, Figure, Score, TransmissionReport

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")

PROBE = """<script>
(async () => {
  const told = {};
  const until = async (ready) => { for (let i = 0; i < 100 && !ready(); i++) await new Promise((r) => setTimeout(r, 50)); };
  const plots = [...document.querySelectorAll(".plot")];
  try {
    for (const p of plots) await until(() => p.dataset.state === "drawn");
    told.plots = plots.length;
    told.drawn = plots.filter((p) => p.dataset.state === "drawn").length;
    const torque = plots.find((p) => p.spec.name === "torque"), stiffness = plots.find((p) => p.spec.name === "stiffness");
    const range = (p) => [...p._fullLayout.xaxis.range];
    told.before = range(torque);
    torque.dispatchEvent(new KeyboardEvent("keydown", { key: "+" }));
    await until(() => range(torque)[0] !== told.before[0] && Math.abs(range(stiffness)[0] - range(torque)[0]) < 1e-9);
    told.zoomed = range(torque);
    told.followed = range(stiffness);
    const ink = () => torque._fullLayout.font.color, paper = () => getComputedStyle(document.body).backgroundColor;
    told.ink = ink();
    told.paper = paper();
    document.getElementById("theme").click();
    await until(() => ink() !== told.ink);
    told.otherInk = ink();
    told.otherPaper = paper();
    told.tooWide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    told.cutOff = [...document.querySelectorAll(".scroll")].filter((box) => box.scrollWidth > box.clientWidth).length;
    told.tables = document.querySelectorAll(".scores:not(.stacking)").length;
    told.requests = performance.getEntriesByType("resource").map((e) => e.name).filter((n) => !/^(data|blob):/.test(n));
    told.images = document.querySelectorAll("img").length;
    told.servers = [...new Set(plots.map((p) => `${p._context.showSendToCloud} ${p._context.plotlyServerURL}`))];
    told.buttons = [...new Set([...document.querySelectorAll("[data-title]")].map((b) => b.dataset.title))];
  } catch (error) { told.error = String(error.stack); }
  const pre = document.createElement("pre");
  pre.id = "probe";
  pre.textContent = JSON.stringify(told);
  document.body.append(pre);
})();
</script>"""


def probed(page, folder, *options, probe=PROBE):
    """Open a page with a probe in it; return what that found, and what the console says."""
    text = page.read_text(encoding="utf-8")
    script = probe.removeprefix("<script>").removesuffix("</script>").encode()
    digest = base64.b64encode(hashlib.sha256(script).digest()).decode()
    text = text.replace("script-src ", f"script-src 'sha256-{digest}' ", 1)  # the page lets no other script run
    page.write_text(text.replace("</body>", probe + "</body>"), encoding="utf-8")
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-3d-apis", "--no-first-run",
        "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}",
        "--window-size=1280,20000", "--enable-logging=stderr", "--virtual-time-budget=120000", "--dump-dom", *options,
        page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert found, done.stderr[-2000:]
    told = json.loads(html.unescape(found[1]))
    assert "error" not in told, told["error"]
    return told, [line for line in done.stderr.splitlines() if "CONSOLE" in line and "willReadFrequently" not in line]


def scored(found):
    """Give the report's joint scores whose figures are as long as they get."""
    long = Figure(value=-1.23e-05, low=-0.000123, high=-1.23e-08)
    score = Score(samples=3_600_000, effective_samples=123_456.7, span=1.0, mse=long, rmse=long, nrmse=long, msrep=long,
                  r2=Figure(value=0.1234, low=-0.1234, high=0.9999), bias=long, largest=1.23e-05)  # fmt: skip
    comparison = Comparison(quantity="stiffness", unit="N*m/rad", reference="residual", inside=score, outside=score)
    (joint,) = found.logs[0].joints
    part = TransmissionReport(
        transmission="1", judged_on=None, comparisons=(comparison,) * 2, inside_share=0.5, dependence=()
    )
    joint = replace(joint, joint=lever_arm_joint().joint, transmissions=(part,))
    return replace(found, logs=(replace(found.logs[0], joints=(joint,)),))


def test_figures_answer_and_colours_follow(tmp_path):
    page = tmp_path / "page.html"
    write_page(page, HOSTILE, scored(report(HOSTILE)), drawn([[lever_arm_joint(), evidence(5000, HOSTILE)]]))
    told, console = probed(page, tmp_path / "profile", "--window-size=1280,20000")
    assert console == []
    assert told["plots"] == told["drawn"] > 12
    a, b = told["before"]
    assert told["zoomed"] == pytest.approx([a + 0.2 * (b - a), b - 0.2 * (b - a)])
    assert told["followed"] == pytest.approx(told["zoomed"])
    assert told["ink"] != told["otherInk"]
    assert told["paper"] != told["otherPaper"]
    assert told["tooWide"] == 0  # the page itself does not scroll sideways
    assert told["tables"] == 1
    assert told["cutOff"] == 0  # nor does its table of scores
    assert told["requests"] == []
    assert told["images"] == 0
    assert told["servers"] == ["false "]  # log data are offered to no server
    words = ("share", "cloud", "chart studio", "edit", "upload", "publish")
    assert not [title for title in told["buttons"] if any(word in title.lower() for word in words)]
    assert told["buttons"]


def test_a_dark_desktop_gets_a_dark_page(tmp_path):
    page = tmp_path / "page.html"
    write_page(page, "dark", None, drawn([[evidence(2000)]]))
    told, _ = probed(page, tmp_path / "profile", "--blink-settings=preferredColorScheme=0")
    assert told["paper"] == "rgb(20, 24, 29)"
    assert told["otherPaper"] == "rgb(255, 255, 255)"
