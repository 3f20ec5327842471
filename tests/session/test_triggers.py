"""Event codes: each mark shows its code on a wire at once, for as long as a pulse; a wire that fails stops nothing."""

from __future__ import annotations

import json
import os
import random
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from program import program
from shipped import SCENES

import itouch
from itouch.plugin import Terminal
from itouch.session.outputs import Outputs, open_outputs
from itouch.session.session_error import SessionError
from itouch.session.trigger_ports import ParallelWire, wire
from itouch.session.triggers import CONTACT, LOST, PULSE, Triggers
from itouch_tools.cli import sync

FIRST = SCENES / "first_touch.xml"


@pytest.fixture(scope="module")
def session() -> Iterator[Any]:
    engine = itouch.build(FIRST)
    engine.run(0.01)
    yield engine
    engine.close()


@pytest.fixture
def box() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.close()


def heard(box: Terminal, count: int) -> bytes:
    """Return so many bytes: a pseudo-terminal hands them on when the system finds the time."""
    found, end = b"", time.monotonic() + 300
    while len(found) < count and time.monotonic() < end:
        found += box.receive()
    return found


def test_a_mark_is_on_the_wire_at_once_and_the_lines_are_zero_after_the_pulse(session: Any, box: Terminal) -> None:
    with Triggers(session, wire(box.path), {"begin": 7}) as triggers:
        assert heard(box, 1) == b"\0"
        session.mark("begin")
        assert heard(box, 1) == b"\x07"  # before any tick
        session.mark("answer", {"code": 200, "key": "left"})
        session.mark("no code")
        session.mark("begin", {"code": 3})
        assert heard(box, 2) == b"\xc8\x03"
        session.run(0.001)
        time.sleep(PULSE)
        session.run(0.002)
        assert heard(box, 1) == b"\0"
        session.post_mark("begin")
        session.run(0.001)
        assert heard(box, 1) == b"\x07"
    assert heard(box, 1) == b"\0"
    assert [code for _, code in triggers.put] == [0, 7, 200, 3, 0, 7, 0]
    session.mark("begin")
    assert box.receive() == b""


def test_contacts_are_on_the_wire_before_their_tick_has_ended(box: Terminal) -> None:
    engine = itouch.build(FIRST)
    (touched,) = engine.model.objects
    wished = {"begin": 10, "end": 11, f"end:{touched}": 12}
    codes: list[int] = []
    try:
        with open_outputs(engine, Outputs(records=False, trigger=box.path, contacts=wished)):
            engine.run(2.0)
        kinds = {int(one["tick"]): int(one["kind"]) for one in engine.state["events.table"]
                 if one["kind"] in (1, 3)}  # fmt: skip
        end = time.monotonic() + 300
        while len(codes) < len(kinds) and time.monotonic() < end:
            codes += [code for code in box.receive() if code]
        assert kinds and codes == [10 if kind == 1 else 12 for _, kind in sorted(kinds.items())]
        marks = [mark["payload"] for mark in engine.marks if mark["name"] == CONTACT]
        assert {mark["tick"]: mark["code"] for mark in marks} == {t: 10 if k == 1 else 12 for t, k in kinds.items()}
        assert {(mark["object"], mark["event"]) for mark in marks} <= {(touched, "begin"), (touched, "end")}
    finally:
        engine.close()


@given(st.dictionaries(st.sampled_from(["begin", "end", "begin:a", "end:a:b", "begin:end"]), st.integers(1, 255)),
       st.sampled_from(["begin", "end"]), st.sampled_from(["a", "a:b", "end", "c"]))  # fmt: skip
def test_a_contact_has_the_code_of_its_object_else_of_its_kind_else_none(
    codes: dict[str, int], kind: str, name: str
) -> None:
    found = Triggers(None, None, {}, codes).of_contact(kind, name)  # type: ignore[arg-type]
    assert found == codes.get(f"{kind}:{name}", codes.get(kind, 0))


def test_a_box_that_is_pulled_out_is_told_by_a_mark_and_the_session_goes_on(session: Any) -> None:
    box = Terminal()
    with Triggers(session, wire(box.path), {"begin": 7}):
        box.close()
        session.mark("begin")
        session.run(0.002)
        session.mark("begin")
        session.run(0.002)
    lost = [mark for mark in session.marks if mark["name"] == LOST]
    assert len(lost) == 1 and lost[0]["payload"]["port"] == box.path


@given(st.dictionaries(st.text(max_size=5), st.integers(1, 255)), st.text(max_size=5),
       st.none() | st.integers() | st.text() | st.dictionaries(st.sampled_from(["code", "x"]), st.integers() | st.text()))  # fmt: skip
def test_a_code_is_that_of_the_payload_else_of_the_name_else_none(
    codes: dict[str, int], name: str, payload: Any
) -> None:
    found = Triggers(None, None, codes).code(name, payload)  # type: ignore[arg-type]
    own = payload.get("code") if isinstance(payload, dict) else None
    expected = own if isinstance(own, int) and 0 < own < 256 else codes.get(name, 0)
    assert found == expected and 0 <= found <= 255


def test_a_parallel_port_is_claimed_set_and_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The requests are those of linux/ppdev.h; no port of this machine is touched."""
    port, asked = tmp_path / "parport0", []
    port.write_bytes(b"")
    monkeypatch.setattr("fcntl.ioctl", lambda handle, request, data: asked.append((request, data)))
    line = wire(str(port))
    assert isinstance(line, ParallelWire)
    line.put(65)
    line.close()
    ppdev = ord("p") << 8
    assert asked == [(ppdev | 0x8B, b""), (1 << 30 | 1 << 16 | ppdev | 0x86, b"A"), (ppdev | 0x8C, b"")]


def test_a_run_puts_codes_and_what_can_not_be_is_said(box: Terminal, tmp_path: Path) -> None:
    done = program("run", str(FIRST), "--headless", "--for", "0.02s", "--no-record", "--trigger", box.path,
                   "--code", "begin=1")  # fmt: skip
    assert done.returncode == 0 and heard(box, 2) == b"\0\0"
    for words, said in (
        (("--trigger", str(tmp_path)), "no event codes can be put on"),
        (("--trigger", os.devnull), "no serial port"),
        (("--code", "begin=1"), "name the port, too"),
        (("--trigger", box.path, "--code", "begin=256"), "is not a code"),
        (("--contact-code", "end=1"), "--contact-code says what --trigger PORT"),
        (("--trigger", box.path, "--contact-code", "move=1"), "is not a code of contacts"),
        (("--trigger", box.path, "--contact-code", "begin:none=1"), "contacts with 'none'"),
    ):
        failed = program("run", str(FIRST), "--headless", "--for", "0.02s", *words)
        assert failed.returncode == 2 and said in failed.stderr and "Traceback" not in failed.stderr, failed.stderr
    with pytest.raises(SessionError):
        wire(str(tmp_path / "none"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--port", "/dev/ttyS99"), "--port PORT --loopback go together"),
        (("--marks", "1"), "10 to 100000"),
        (("--limit", "-1"), "above 0"),
        (("none.xml",), "none.xml"),
    ],
)
def test_what_sync_can_not_measure_is_said(words: tuple[str, ...], said: str) -> None:
    done = program("sync", *words)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr


def test_sync_sets_marks_whose_codes_are_those_of_a_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sync.time, "sleep", lambda seconds: None)
    asked: list[int] = []
    link: Any = SimpleNamespace(
        period=1e-3, state={"marks.count": 0}, follow=lambda: None,
        command=lambda what, value: asked.append(value["payload"]["code"]),
    )  # fmt: skip
    lost: Any = SimpleNamespace(wait=lambda code: None)
    for delays in sync._marks(link, lost, 300, random.Random(0)):
        assert (delays.seconds, delays.lost) == ((), 300)
    assert asked == [*range(1, 256), *range(1, 46)]  # 0 is the line at rest


def test_the_figures_of_delays_are_in_milliseconds() -> None:
    figures = sync.Delays("asked", (1e-3, 2e-3, 6e-3), 1).figures()
    assert figures == pytest.approx(
        {"way": "asked", "marks": 4, "lost": 1, "min_ms": 1.0, "p50_ms": 2.0, "p95_ms": 5.6, "p99_ms": 5.92,
         "max_ms": 6.0, "sd_ms": 14.0**0.5 / 3.0**0.5}
    )  # fmt: skip


@pytest.mark.long
def test_sync_tells_the_distribution() -> None:
    done = program("sync", "--marks", "40", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == 0 and told["good"]
    asked, ticked = told["ways"]
    assert asked["marks"] == 40 and asked["lost"] == ticked["lost"] == 0
    assert 0.0 < asked["min_ms"] <= asked["p50_ms"] <= asked["p99_ms"] <= asked["max_ms"]
    assert ticked["p50_ms"] < asked["p50_ms"]  # who asks waits for the tick
    assert program("sync", "--marks", "10", "--limit", "0.0001").returncode == 1


def test_the_loopback_reader_reads_an_emulated_box_or_a_port(box: Terminal) -> None:
    line = os.open(box.path, os.O_WRONLY | os.O_NOCTTY)
    try:
        for port, terminal, send in ((None, box, partial(os.write, line)), (box.path, None, box.send)):
            with sync.LoopbackReader(port, terminal) as reader:
                begin = time.monotonic_ns()
                send(bytes((1, 9)))
                arrived = reader.wait(9)
                assert arrived is not None and begin <= arrived <= time.monotonic_ns()
    finally:
        os.close(line)


@pytest.mark.parametrize(
    ("limit", "seconds", "lost", "code"),
    [(None, (1e-3, 3e-3), 0, 0), (5.0, (1e-3, 3e-3), 0, 0), (2.0, (1e-3, 3e-3), 0, 1), (5.0, (1e-3, 3e-3), 1, 1),
     (None, (), 10, 1)],
)  # fmt: skip
def test_sync_is_good_if_no_code_is_lost_and_its_limit_is_kept(
    limit: float | None, seconds: tuple[float, ...], lost: int, code: int,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    rows = [sync.Delays(way, seconds, lost) for way in ("asked", "ticked")]
    monkeypatch.setattr(sync, "measure", lambda *words: rows)
    words = ["--json"] if limit is None else ["--json", "--limit", str(limit)]
    assert sync.main(words) == code
    assert json.loads(capsys.readouterr().out)["good"] == (code == 0)
