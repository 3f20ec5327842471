"""The page of a session, in a real browser."""

from __future__ import annotations

import base64
import html
import re
import shutil
import struct
import subprocess
import zlib
from importlib.resources import files

import numpy as np
import pytest
from browser import Browser, need_chromium
from hypothesis import given
from hypothesis import strategies as st
from program import program
from shipped import SCENES

import itouch
from itouch_tools.report import sections
from itouch_tools.report.collect import collect
from itouch_tools.report.curves import NUMBERS_CONTACTS, NUMBERS_WHOLE, Block
from itouch_tools.report.session_page import Packer, page, scene_picture

SETTLE = """new Promise(done => { const wait = () => document.querySelector("path.curve") ? setTimeout(() => done(true), 300)
  : setTimeout(wait, 50); wait(); })"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording, a snapshot, and their pages, of two contacts."""
    folder = tmp_path_factory.mktemp("report")
    text = (SCENES / "four_materials_hurried.xml").read_text().replace("<safety", '<record to="run.mcap"/><safety')
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
    assert "default-src 'none'" in html.unescape(head)


def test_what_was_not_as_it_should_be_is_said_first(recorded):
    findings = collect(recorded / "run.mcap")
    said = sections.answer(findings)
    assert "all devices were simulated" in said["said"] and not said["short"]
    assert "not as it should" not in page(findings)
    findings.report["contacts"][0] |= {"plate_limited": np.False_, "plate_ready": np.True_}  # as a stranger may say it
    findings.report["contacts"][1] |= {"plate_limited": True, "plate_ready": False}
    text = page(findings)
    said = "not as it should have been in 1 of 2 contacts: pyrex (the plate was not ready, the plate was limited)"
    assert f'<p class="bad">{said}</p>' in text
    assert ">the plate was not ready, the plate was limited</td>" in text
    assert "its start temperature is out of the plate" in text  # the whole sentence below it


def test_the_page_pictures_the_first_touch(recorded):
    findings = collect(recorded / "run.mcap")
    assert findings.touching and findings.model.objects[int(findings.state["finger.object"])] == "aluminium"
    begin = findings.contacts[0]["begin_s"]
    assert int(findings.state["tick"]) * findings.model.period == pytest.approx(begin + 0.5, abs=0.003)
    assert "<h2>Scene in its first touch</h2>" in page(findings, picture=b"png")
    end = collect(recorded / "end.itouch")
    assert not end.touching


@pytest.mark.parametrize("width", [400, 1600])
def test_plots_are_drawn_and_nothing_overflows_or_complains(recorded, browser, width, tmp_path):
    browser.said.clear()
    browser.open(recorded / "run.mcap.html", width=width, height=900)
    browser.run(SETTLE)
    assert browser.said == [] and browser.asked == []
    assert browser.run("document.querySelectorAll('.plot').length") >= 6
    assert browser.run("document.querySelectorAll('#histogram0 path.curve.filled').length") == 1
    drawn = "p.querySelectorAll('path.curve').length > 0 && p.querySelector('path.curve').getBBox().width > 200"
    assert browser.run(f"[...document.querySelectorAll('[id^=chart]')].every(p => {drawn})")
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("[...document.querySelectorAll('.plot')].every(p => p.getBoundingClientRect().width > 300)")
    small = browser.run("parseFloat(getComputedStyle(document.querySelector('table')).fontSize)")
    assert small >= 12
    browser.shoot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000


CHART = "document.getElementById('chart0').chart"
RANGE = f"{CHART}.group.range"
POINTS = f"{CHART}.seconds.length"
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


def test_one_cursor_tells_the_values_of_all_charts(recorded, browser):
    """What the page says at a time is what the run had, to the step of its numbers."""
    browser.open(recorded / "run.mcap.html", width=1200, height=900)
    browser.run(SETTLE)
    curves = collect(recorded / "run.mcap").curves
    assert curves is not None
    times, row, checked = curves.whole.times, 0, 0
    for time in (8.0, 9.5, 15.0, 19.25):
        browser.run(f"sessionCharts.point({time})")
        place, row = int(np.searchsorted(times, time)), 0
        for index, chart in enumerate(curves.charts):
            names = f"[...document.querySelectorAll('#chart{index} .value')].map(v => v.textContent.trim())"
            for told in browser.run(names):
                signal = curves.whole.values[row]
                row += 1
                near = signal[max(0, place - 1) : place + 2]  # the time itself is a whole number, too
                if not np.isfinite(near).all():
                    assert told == "–" or np.isfinite(near).any()
                    continue
                step = np.nanmax(np.abs(signal)) * 5e-4 + 1e-12  # four digits are told
                assert near.min() - step <= float(told) <= near.max() + step, (chart.title, told, near)
                checked += 1
    assert checked >= 32
    dragged = """
        const svg = document.querySelector('#chart1 svg'), box = svg.getBoundingClientRect();
        const at = (kind, x) => svg.dispatchEvent(new PointerEvent(kind, { clientX: box.left + x, clientY: box.top + 80,
                                                  pointerType: 'mouse', button: 0, pointerId: 1, bubbles: true }));
        svg.setPointerCapture = () => {};
        at('pointerdown', 300); at('pointermove', 500); at('pointerup', 500);
        sessionCharts.charts.every(chart => chart.group.range[1] - chart.group.range[0] < 8)"""
    assert browser.run(dragged)
    browser.run("document.querySelector('#chart2 svg').dispatchEvent(new MouseEvent('dblclick'))")
    assert browser.run(RANGE) == pytest.approx([0.001, 23.0], abs=0.05)
    paths = "document.querySelectorAll('#chart0 path.curve').length"
    before = browser.run(paths)
    browser.run("document.querySelector('#chart0 button.name').click()")
    assert browser.run(paths) == before - 1
    assert browser.said == []


def test_an_hour_of_touches_is_a_small_page():
    """336 contacts with as many numbers as the sampler admits, and noise that no packing takes away."""
    dice = np.random.default_rng(1)
    packer = Packer()
    smooth = np.sin(np.linspace(0.0, 9.0, NUMBERS_WHOLE))
    for count, times in ((1, NUMBERS_WHOLE // 23), (336, NUMBERS_CONTACTS // 23 // 336)):
        for _ in range(count):
            rows = [smooth[:times] * (1 + 1e-3 * dice.standard_normal(times)) for _ in range(22)]
            packer.add(Block(np.linspace(0.0, 6.0, times), np.array(rows, np.float32)), 0.0)
    assert len(packer.text()) < 1_700_000  # and 0.3 MB for texts and a picture, see below


def test_texts_and_picture_take_a_third_of_a_megabyte(recorded):
    findings = collect(recorded / "run.mcap")
    png = scene_picture(findings)
    if png is None:
        return  # no OpenGL; where CI is set the tests of pictures fail for that
    assert struct.unpack(">II", png[16:24]) == (960, 540)
    findings.curves = None
    assert len(page(findings, picture=png)) < 300_000


NUMBERS = st.floats(-(2.0**90), 2.0**90, width=32) | st.just(float("nan"))


@given(
    st.lists(
        st.lists(NUMBERS, min_size=3, max_size=3),
        max_size=20,
    ),
    st.integers(0, 3),
)
def test_packed_curves_come_out_as_they_went_in(samples, blocks):
    """Unpacked as the page does it: within a half step of 1/65534 of the range; gaps stay gaps."""
    values = np.array(samples, np.float32).reshape(-1, 3).T
    times = np.arange(values.shape[1]) * 1e-3
    packer = Packer()
    found = [packer.add(Block(times, values), 0.0) for _ in range(blocks + 1)][-1]
    stream = np.frombuffer(zlib.decompress(base64.b64decode(packer.text())), np.uint8)
    at, count = found["at"], found["count"]
    for row, (low, step) in zip((times, *values), found["rows"], strict=True):
        change = stream[at : at + count].astype(int) + 256 * stream[at + count : at + 2 * count].astype(int)
        whole = (np.cumsum(change) & 0xFFFF).astype(np.uint16).view(np.int16).astype(float)
        at += 2 * count
        np.testing.assert_array_equal(whole == -32768, np.isnan(row))
        known = ~np.isnan(row)
        np.testing.assert_allclose(
            low + step * (whole + 32767)[known], row[known].astype(float), rtol=1e-6, atol=0.51 * step
        )


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
    assert browser.run(f"{small}.every(p => p.querySelectorAll('path.curve').length > 0)")
    first = browser.run(f"{small}[0].chart.seconds[0]")
    assert first == pytest.approx(-0.5, abs=2e-3)  # seconds since the touch


def test_the_page_prints_all_of_it(recorded, browser, tmp_path):
    browser.open(recorded / "run.mcap.html", width=400, height=800)
    browser.run(SETTLE)
    wide = browser.run(f"{CHART}.svg.getAttribute('width')")
    (tmp_path / "page.pdf").write_bytes(browser.pdf())
    assert browser.run("[...document.querySelectorAll('.small')].every(p => p.querySelector('path.curve'))")
    assert not browser.run("document.querySelector('details').open")
    assert browser.run(f"{CHART}.svg.getAttribute('width')") == wide
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
    assert browser.run("document.querySelectorAll('#chart0 path.curve').length") > 0
    assert browser.run("document.body.innerText.split('window.pwned=1').length") > 10


def test_only_our_own_style_scripts_and_packed_data_go_in_unescaped():
    """What a session says is escaped by the template, for nothing there is marked as safe but this."""
    template = files("itouch_tools.report").joinpath("page.html").read_text("utf-8")
    assert re.findall(r"\{\{([^}|]*)\|\s*safe\s*\}\}", template) == [" style ", " data ", " script "]
    assert template.count("| safe") == template.count("|safe") + 3 and "autoescape" not in template


def test_what_is_no_text_is_written_as_one(recorded):
    findings = collect(recorded / "run.mcap")
    findings.marks = [{"time": 1.0, "name": ["<b>", "\ud800"], "payload": {"<i>": None}}]
    text = page(findings)
    assert "&lt;b&gt;" in text and "<b>&#39;" not in text and "&lt;i&gt;" in text
    assert text.encode()


@pytest.fixture(scope="module")
def untouched(tmp_path_factory):
    """The page of a session without a plate in which nothing is touched: its forces are zero all the time."""
    folder = tmp_path_factory.mktemp("untouched")
    done = program(
        "run", SCENES / "first_touch.xml", "--headless", "--for", "0.3s", "--record", folder / "run.mcap"
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (folder / "run.html").write_text(page(collect(folder / "run.mcap")))
    return folder


def test_where_there_is_no_plate_no_curve_tells_of_one(untouched):
    charts = {
        chart.title: [line.label for line in chart.lines] for chart in collect(untouched / "run.mcap").curves.charts
    }
    assert charts == {"force": ["virtual", "felt"]}


def test_numbers_at_the_axis_of_a_constant_curve_are_not_cut(untouched, browser):
    browser.open(untouched / "run.html", width=1000, height=900)
    browser.run(SETTLE)
    left = "t => t.getBoundingClientRect().left - t.closest('svg').getBoundingClientRect().left"
    texts = "[...document.querySelectorAll('[id^=chart] text.tick')]"
    assert browser.run(f"{texts}.length") > 5
    assert browser.run(f"Math.min(...{texts}.map({left}))") >= 0.0


@pytest.mark.parametrize("name", ["missing.mcap", "missing.itouch", "empty.mcap", "empty.itouch"])
def test_a_file_that_is_none_is_refused(tmp_path, name):
    if name.startswith("empty"):
        (tmp_path / name).write_bytes(b"")
    done = program("report", str(tmp_path / name), "-o", str(tmp_path / "x.html"))
    assert done.returncode == 2 and "Traceback" not in done.stderr and name in done.stderr
    assert not (tmp_path / "x.html").exists()
