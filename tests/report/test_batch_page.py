"""The page of a batch in a browser: a click sorts."""

import base64
import hashlib
import html
import json
import re
import shutil
import subprocess

import pytest

from vsalog.report.batch import Column, batch_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
PROBE = """
const told = {}, heads = [...document.querySelectorAll("thead th")];
const click = (text) => heads.find((h) => h.textContent === text).querySelector("button").click();
const logs = () => [...document.querySelectorAll("tbody tr")].map((row) => row.cells[0].textContent);
told.before = logs();
click("excited [%]"); told.up = logs();
click("excited [%]"); told.down = logs();
click("log"); told.names = logs();
const pre = document.createElement("pre");
pre.id = "told"; pre.textContent = JSON.stringify(told);
document.body.append(pre);
"""


def test_a_click_sorts_numbers_as_numbers_and_blanks_come_last(tmp_path):
    shares = {"b": 0.09, "a": 0.1, "d": None, "c": 1.0, "e": -0.5}
    known = dict.fromkeys(("joint", "device", "date", "reason", "report", "trace", "model", "document", "rig"))
    rows = [known | {"log": log, "status": "done", "warnings": [], "share": share} for log, share in shares.items()]
    counts = {"done": 5, "failed": 0, "missed": 0}
    page = batch_page("estimate", counts, rows, [Column("share", "excited [%]", True, True)])
    digest = base64.b64encode(hashlib.sha256(PROBE.encode()).digest()).decode()
    page = page.replace("script-src '", f"script-src 'sha256-{digest}' '", 1)
    (tmp_path / "index.html").write_text(page.replace("</body>", f"<script>{PROBE}</script></body>"), encoding="utf-8")
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=5000", "--dump-dom", (tmp_path / "index.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    told = json.loads(html.unescape(re.search(r'<pre id="told">(.*?)</pre>', done.stdout, re.DOTALL)[1]))
    assert told["before"] == list(shares)
    assert told["up"] == ["e", "b", "a", "c", "d"]
    assert told["down"] == ["c", "a", "b", "e", "d"]
    assert told["names"] == ["a", "b", "c", "d", "e"]
