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
from reports_evidence import HOSTILE, drawn, evidence, lever_arm_joint, report, write_page

from vsalog.batch.records import Joint, Record
from vsalog.batch.summary import page_columns, rows_of
from vsalog.report.batch import batch_page
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
    told.tables = document.querySelectorAll(".scores").length;
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


def probed(page, folder, *options, probe=PROBE, opened=None):
    """Open a page with a probe in it, or one that holds it; return what that found, and what the console says."""
    text = page.read_text(encoding="utf-8")
    script = probe.removeprefix("<script>").removesuffix("</script>").encode()
    digest = base64.b64encode(hashlib.sha256(script).digest()).decode()
    text = text.replace("script-src ", f"script-src 'sha256-{digest}' ", 1)  # the page lets no other script run
    page.write_text(text.replace("</body>", probe + "</body>"), encoding="utf-8")
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-3d-apis", "--no-first-run",
        "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}",
        "--window-size=1280,20000", "--enable-logging=stderr", "--virtual-time-budget=120000", "--dump-dom", *options,
        (opened or page).as_uri(),
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
    first = replace(joint, joint=lever_arm_joint().joint, transmissions=(part,))
    return replace(found, logs=(replace(found.logs[0], joints=(first, joint)),))


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
    assert told["tables"] == 2
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


LAYOUT = """<script>
(async () => {
  const told = { width: innerWidth };
  const until = async (ready) => { for (let i = 0; i < 100 && !ready(); i++) await new Promise((r) => setTimeout(r, 50)); };
  try {
    const plots = [...document.querySelectorAll(".plot")], first = plots[0];
    if (first) await until(() => first.dataset.state === "drawn");
    told.fold = first ? first.getBoundingClientRect().top + 100 - innerHeight : -1;
    told.drawn = first ? first.querySelectorAll(".main-svg").length > 0 : true;
    told.tooWide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    told.cutOff = [...document.querySelectorAll(".scroll")].filter((box) => box.scrollWidth > box.clientWidth).length;
    told.height = document.documentElement.scrollHeight;
    told.headings = document.querySelectorAll("header h1").length;
    told.theme = !document.getElementById("theme").hidden;
  } catch (error) { told.error = String(error.stack); }
  parent.postMessage(JSON.stringify(told), "*");
})();
</script>"""
# A window of its own is never as narrow as a telephone.
FRAME = """<!doctype html><body><iframe src="page.html" style="border: 0; width: {}px; height: {}px"></iframe><script>
addEventListener("message", ({{ data }}) => {{
  const pre = document.createElement("pre");
  pre.id = "probe";
  pre.textContent = data;
  document.body.append(pre);
}});
</script></body>"""


def records():
    """Logs of long names, of which each second one failed."""
    names = [f"day{i}/{'a_name_without_end_' * 8}{i}.mcap" for i in range(40)]
    warned = {"verdict": "unexplained", "causes": (), "unexplained": 0.25, "warnings": ("The first one. " * 9, "Two.")}
    told = (Joint(joint="elbow_" * 20, figures=warned),)
    return [
        Record(log=name, do="diagnose", status="failed", vsalog="0", reason="It is damaged. " * 20)
        if i % 2
        else Record(log=name, do="diagnose", status="done", vsalog="0", joints=told)
        for i, name in enumerate(names)
    ]


@pytest.mark.every(5)
@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
@pytest.mark.parametrize("command", ["estimate", "validate", "validate two", "compare", "diagnose", "batch"])
def test_every_page_fits_its_window_and_begins_with_a_figure(said, tmp_path, command, size):
    page = tmp_path / "page.html"
    if command == "batch":
        counts = {"done": 20, "failed": 20, "missed": 0}
        page.write_text(batch_page("diagnose", counts, rows_of(records()), page_columns("diagnose")), encoding="utf-8")
    else:
        shutil.copyfile(said[command].page, page)
    frame = tmp_path / "frame.html"
    frame.write_text(FRAME.format(*size))
    told, console = probed(page, tmp_path / "profile", "--window-size=1300,900", probe=LAYOUT, opened=frame)
    assert console == []
    assert told["width"] == size[0]
    assert told["drawn"]
    assert (told["headings"], told["theme"]) == (1, True)
    assert told["tooWide"] == 0
    assert told["cutOff"] == 0
    assert told["fold"] < 0  # a hundred pixels of the first figure are seen at once
    if command == "compare":
        assert told["height"] < (2000 if size[0] == 1280 else 5000)  # fourteen estimators


@pytest.mark.parametrize("command", ["estimate", "compare"])
def test_a_page_is_whole_without_a_script(said, command):
    """The verdict, the table and what the figures show are in the HTML itself."""
    text = said[command].page.read_text(encoding="utf-8")
    body = text[text.index("<main") : text.index("</main>")]
    assert "N·m/rad" in body
    assert body.index('class="plot"') < body.index("<table")
