"""The page of a session, in a real browser."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from browser import Browser, need_chromium
from program import program
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
    assert program("run", "scene.xml", "--headless", "--for", "23s", "--save", "end.itouch", cwd=folder).returncode == 0
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
    assert "default-src 'none'" in head


@pytest.mark.parametrize("width", [400, 1600])
def test_plots_are_drawn_and_nothing_overflows_or_complains(recorded, browser, width, tmp_path):
    browser.said.clear()
    browser.open(recorded / "run.mcap.html", width=width, height=900)
    browser.run(SETTLE)
    assert browser.said == [] and browser.asked == []
    assert browser.run("document.querySelectorAll('.plot').length") >= 6
    assert browser.run("document.querySelectorAll('#histogram0 .scatterlayer path.js-fill').length") == 1
    assert browser.run(
        "[...document.querySelectorAll('[id^=chart]')].every(p => p.querySelectorAll('.scatterlayer path.js-line').length > 0)"
    )
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("[...document.querySelectorAll('.plot')].every(p => p.getBoundingClientRect().width > 300)")
    small = browser.run("parseFloat(getComputedStyle(document.querySelector('table')).fontSize)")
    assert small >= 12
    browser.shoot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000


RANGE = "document.getElementById('chart0').layout.xaxis.range"
POINTS = "document.getElementById('chart0').data[0].x.length"
WHICH = "document.getElementById('which')"


def chosen(browser: Browser) -> tuple[str, list[bool]]:
    pressed = "[...document.querySelectorAll('tr.choice')].map(r => r.getAttribute('aria-pressed') === 'true')"
    return browser.run(f"{WHICH}.value"), browser.run(pressed)


def test_every_control_chooses_what_the_curves_show(recorded, browser):
    browser.said.clear()
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    browser.run(SETTLE)
    whole = browser.run(RANGE)
    assert whole == pytest.approx([0.001, 23.0], abs=0.05) and chosen(browser) == ("-1", [False, False])
    browser.run("document.querySelectorAll('tr.choice')[1].click()")
    rows = browser.run("[...document.querySelectorAll('tr.choice')[1].cells].map(c => c.textContent)")
    assert browser.run(RANGE) == pytest.approx([float(rows[2]) - 0.5, min(23.0, float(rows[3]) + 0.5)], abs=5e-3)
    assert chosen(browser) == ("1", [False, True])
    assert browser.run(POINTS) > 1000  # a contact is drawn finer than it is in the whole
    for button, value in (("before", "0"), ("before", "-1"), ("after", "0"), ("after", "1"), ("all", "-1")):
        browser.run(f"document.getElementById('{button}').click()")
        assert chosen(browser)[0] == value
    assert browser.run(RANGE) == whole
    assert browser.run("document.getElementById('before').disabled")
    browser.run(f"{WHICH}.value = '0'; {WHICH}.dispatchEvent(new Event('change'))")
    assert chosen(browser) == ("0", [True, False])
    assert browser.said == []


def test_a_keyboard_is_enough(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    browser.run(SETTLE)
    browser.run("window.printed = 0; window.print = () => { window.printed += 1; }")
    order: list[str] = []
    active = "document.activeElement"
    while "SUMMARY" not in order and len(order) < 100:
        browser.press("Tab", code=9)
        order.append(browser.run(f"{active}.id || {active}.className || {active}.tagName"))
        if order[-1] == "print":
            browser.press("Enter", code=13, text="\r")
        if order[-1] == "choice":
            rows = order.count("choice")
            browser.press("Enter", code=13) if rows == 1 else browser.press(" ", code=32)
            assert chosen(browser)[0] == str(rows - 1)
        if order[-1] == "which":
            browser.press("ArrowUp", code=38)
            assert chosen(browser)[0] == "0"
    assert browser.run("window.printed") == 1
    assert order[:7] == ["print", "choice", "choice", "before", "which", "after", "all"]
    assert "SUMMARY" in order


def test_every_contact_is_drawn_by_itself_when_it_comes_into_sight(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=400, height=800)
    browser.run("document.querySelectorAll('section.contact')[1].scrollIntoView()")
    browser.run(SETTLE)
    small = "[...document.querySelectorAll('section.contact')[1].querySelectorAll('.small')]"
    assert browser.run(f"{small}.length") >= 5
    assert browser.run(f"{small}.every(p => p.querySelectorAll('.scatterlayer path.js-line').length > 0)")
    first = browser.run(f"{small}[0].data[0].x[0]")
    assert first == pytest.approx(-0.5, abs=2e-3)  # seconds since the touch


def test_the_page_prints_all_of_it(recorded, browser, tmp_path):
    browser.open(recorded / "run.mcap.html", width=400, height=800)
    browser.run(SETTLE)
    wide = browser.run("document.getElementById('chart0').layout.height")
    (tmp_path / "page.pdf").write_bytes(browser.pdf())
    assert browser.run("[...document.querySelectorAll('.small')].every(p => p.dataset.drawn === 'yes')")
    assert not browser.run("document.querySelector('details').open")
    assert browser.run("document.getElementById('chart0').layout.height") == wide
    assert browser.run("document.documentElement.scrollWidth") <= 400
    if pdftotext := shutil.which("pdftotext"):
        text = subprocess.run(
            [pdftotext, tmp_path / "page.pdf", "-"], capture_output=True, text=True, check=True
        ).stdout
        for part in ("aluminium", "Contact by contact", "The scene that ran", "<itouch version", "Provenance"):
            assert part in text


def test_the_page_tells_what_the_session_was(recorded, browser):
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    text = browser.run("document.body.innerText")
    for part in ("aluminium", "pyrex", "Faults", "none", "23.000 s", "itouch-py", "commands that differ"):
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


EVIL = "</script><script>window.pwned=1</script><img src=x onerror=window.pwned=1><!--\u2028'\"&amp;${1}`\0\ud800"


def spoilt(value):
    """Return the same with every text in it an attack."""
    if isinstance(value, str):
        return EVIL
    if isinstance(value, dict):
        return {key: spoilt(inner) for key, inner in value.items()} | {EVIL: EVIL}
    return [spoilt(inner) for inner in value] if isinstance(value, list) else value


def test_texts_of_a_session_are_shown_and_never_run(recorded, browser, tmp_path):
    findings = collect(recorded / "run.mcap")
    findings.faults = [{"time_s": 1.5, "device": "", "trip": "", "cause": "", "scene": ""}]
    findings.marks = [{"time": 1.0, "name": "", "payload": ""}]
    for name in ("title", "kind", "summary", "faults", "marks", "provenance", "scene_xml"):
        setattr(findings, name, spoilt(getattr(findings, name)))
    findings.losses, findings.notices = [EVIL], [EVIL]
    findings.report["contacts"] = spoilt(findings.report["contacts"])
    findings.report["modalities"] = spoilt(findings.report["modalities"])
    (tmp_path / "evil.html").write_text(page(findings), "utf-8")
    browser.said.clear()
    browser.open(tmp_path / "evil.html", width=1200, height=900)
    browser.run(SETTLE)
    assert browser.said == [] and browser.asked == [] and browser.run("window.pwned") is None
    assert browser.run("document.querySelectorAll('img[src=x]').length") == 0
    assert browser.run("document.querySelectorAll('#chart0 path.js-line').length") > 0
    assert browser.run("document.body.innerText.split('window.pwned=1').length") > 10


@pytest.mark.parametrize("name", ["missing.mcap", "missing.itouch", "empty.mcap", "empty.itouch"])
def test_a_file_that_is_none_is_refused(tmp_path, name):
    if name.startswith("empty"):
        (tmp_path / name).write_bytes(b"")
    done = program("report", str(tmp_path / name), "-o", str(tmp_path / "x.html"))
    assert done.returncode == 2 and "Traceback" not in done.stderr and name in done.stderr
    assert not (tmp_path / "x.html").exists()
