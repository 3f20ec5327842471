"""The page of a session, in a real browser."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from browser import Browser, need_chromium
from shipped import SCENES

import itouch
from itouch.report.collect import collect
from itouch.report.page import page

SETTLE = "new Promise(done => setTimeout(() => done(true), 300))"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording, a snapshot, and their pages, of two contacts."""
    folder = tmp_path_factory.mktemp("report")
    text = (SCENES / "four_materials.xml").read_text().replace("<safety", '<record to="run.mcap"/><safety')
    for name in ("materials.xml", "rigs/twin.xml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text((SCENES / name).read_text())
    (folder / "scene.xml").write_text(text)
    words = [sys.executable, "-m", "itouch.cli", "run", "scene.xml", "--for", "23s", "--save", "end.itouch"]
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    for name in ("run.mcap", "end.itouch"):
        (folder / f"{name}.html").write_text(page(collect(folder / name)))
    return folder


@pytest.fixture(scope="module")
def browser():
    running = Browser(need_chromium())
    yield running
    running.close()


def test_the_page_is_one_file_that_asks_for_nothing(recorded):
    text = (recorded / "run.mcap.html").read_text()
    head = text[: text.index('<script id="data"')]
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", head)
    assert "@import" not in head and "url(" not in head


@pytest.mark.parametrize("width", [400, 1600])
def test_plots_are_drawn_and_nothing_overflows_or_complains(recorded, browser, width, tmp_path):
    browser.said.clear()
    browser.open(recorded / "run.mcap.html", width=width, height=900)
    browser.run(SETTLE)
    assert browser.said == []
    assert browser.run("document.querySelectorAll('.plot').length") >= 5
    assert browser.run(
        "[...document.querySelectorAll('[id^=chart]')].every(p => p.querySelectorAll('.scatterlayer path.js-line').length > 0)"
    )
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("[...document.querySelectorAll('.plot')].every(p => p.getBoundingClientRect().width > 300)")
    small = browser.run("parseFloat(getComputedStyle(document.querySelector('table')).fontSize)")
    assert small >= 12
    browser.shoot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000


def test_choosing_a_contact_shows_it_and_the_button_shows_all(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    browser.run(SETTLE)
    span = browser.run("document.getElementById('chart0').layout.xaxis.range")
    browser.run("document.querySelectorAll('tr.choice')[1].click()")
    browser.run(SETTLE)
    chosen = browser.run("document.getElementById('chart0').layout.xaxis.range")
    rows = browser.run("[...document.querySelectorAll('tr.choice')[1].cells].map(c => c.textContent)")
    assert chosen == pytest.approx([float(rows[2]) - 0.5, float(rows[3]) + 0.5], abs=2e-3)
    assert browser.run("document.getElementById('which').value") == "1"
    browser.run("document.getElementById('all').click()")
    browser.run(SETTLE)
    again = browser.run("document.getElementById('chart0').layout.xaxis.range")
    assert again == pytest.approx(span, rel=0.02, abs=0.1)
    select = "document.getElementById('which')"
    browser.run(f"{select}.value = '0'; {select}.dispatchEvent(new Event('change'))")
    browser.run(SETTLE)
    assert browser.run("document.querySelectorAll('tr.choice')[0].classList.contains('chosen')")
    assert browser.said == []


def test_the_page_prints(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    browser.run(SETTLE)
    pdf = browser.pdf()
    assert pdf.startswith(b"%PDF") and len(pdf) > 50_000


def test_the_page_tells_what_the_session_was(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    text = browser.run("document.body.innerText")
    for part in ("aluminium", "pyrex", "Faults", "none", "23.000 s", "itouch-py", "commands differ"):
        assert part in text
    session = itouch.restore(recorded / "end.itouch")
    first = session.report()["contacts"][0]
    assert f"{first['begin_s']:.3f}" in text and f"{first['peak_force_N']:.2f}" in text


def test_a_snapshot_has_a_page_without_curves(recorded, browser):
    browser.said.clear()
    browser.open(recorded / "end.itouch.html", width=1200, height=900)
    assert browser.said == []
    text = browser.run("document.body.innerText")
    assert "a recording holds the curves" in text and "pyrex" in text


def test_faults_are_shown_and_names_are_not_markup(recorded):
    findings = collect(recorded / "end.itouch")
    findings.faults = [{"time_s": 1.5, "device": "<b>x</b>", "trip": "silence", "cause": "</script><i>", "scene": None}]
    findings.scene_xml = "</script><script>alert(1)</script>"
    text = page(findings)
    assert "&lt;b&gt;x&lt;/b&gt;" in text and "<b>x</b>" not in text
    assert "alert(1)</script>" not in text


@pytest.mark.parametrize("name", ["missing.mcap", "missing.itouch", "empty.mcap", "empty.itouch"])
def test_a_file_that_is_none_is_refused(tmp_path, name):
    if name.startswith("empty"):
        (tmp_path / name).write_bytes(b"")
    words = [sys.executable, "-m", "itouch.cli", "report", str(tmp_path / name), "-o", str(tmp_path / "x.html")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2 and "Traceback" not in done.stderr and name in done.stderr
    assert not (tmp_path / "x.html").exists()
