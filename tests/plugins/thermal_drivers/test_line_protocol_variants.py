"""The line protocol against rigs of one's own with habits that anybody's program or adaptor may have."""

from __future__ import annotations

import contextlib
import math
import os
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from test_thermal_drivers import served

from itouch.plugin import DeviceError, Terminal
from itouch_thermal.drivers import LinePort
from itouch_thermal.drivers.lineport import LineDriver, seal, seal_2, unseal, unseal_2
from itouch_tools.cli import main as cli

pytestmark = pytest.mark.punctual  # a rig is a thread beside the driver: on a busy machine either is kept waiting

GREETING = "N itouch-line 2 bench amps=3 plate=10:43 sink=58 silence=0.2 reset=power cut=none"
PLATE = 24.5


@dataclass
class OwnRig:
    """A rig of either version, written by somebody else; ``said`` are answers on their way, with when they arrive."""

    version: int
    #: How late it answers, and how long it does nothing else for an order.
    late: float = 0.0
    takes: float = 0.0
    #: What it says at once when it has heard an order, how it greets, and what it answers to one.
    talks: bytes = b""
    greets: Callable[[], bytes] | None = None
    answers: Callable[[str, float], str] | None = None
    free: float = 0.0
    current: float = 0.0
    orders: int = 0
    said: list[tuple[float, bytes]] = field(default_factory=list)
    habit: Callable[[bytes, bytes], bytes] = lambda order, answer: answer
    _text: bytes = b""

    def hear(self, data: bytes) -> None:
        self._text += data
        while b"\n" in self._text:
            line, _, self._text = self._text.partition(b"\n")
            old = unseal(line)
            body = old if old is not None else unseal_2(line) if self.version == 2 else None
            if body is not None:
                answer = self.answer(body)
                sealed = seal_2(answer) if self.version == 2 else seal(answer)
                if body == "?" and self.greets is not None:
                    sealed = self.greets()
                now = time.monotonic()
                self.free = max(now, self.free) + self.takes
                self.said += [(now, self.talks), (self.free + self.late, self.habit(line + b"\n", sealed))]

    def answer(self, body: str) -> str:
        kind, _, rest = body.partition(" ")
        if kind == "?":
            return GREETING if self.version == 2 else "N itouch-line 1 bench"
        if kind != "I":
            return "E unknown"
        self.orders += 1
        number, amps = rest.split() if self.version == 2 else ("", rest)
        self.current = float(amps)
        if self.answers is not None:
            return self.answers(number, self.current)
        values = f"{PLATE:.3f} 25.1 120.0 nan {self.current:.5f}"
        return f"R {number} {values} ok" if self.version == 2 else f"R {values}"

    def due(self) -> bytes:
        now = time.monotonic()
        out = b"".join(text for when, text in self.said if when <= now)
        self.said = [(when, text) for when, text in self.said if when > now]
        return out


@contextlib.contextmanager
def on_a_line(rig: OwnRig, pieces: int = 0) -> Iterator[Terminal]:
    """Serve a rig at a terminal; ``pieces``: at most so many bytes at once."""
    terminal, waiting = Terminal(), bytearray()

    def step() -> None:
        rig.hear(terminal.receive())
        waiting.extend(rig.due())
        size = pieces or len(waiting)
        if waiting:
            terminal.send(bytes(waiting[:size]))
            del waiting[:size]

    with served(step):
        yield terminal
    terminal.close()


def driver(terminal: Terminal) -> LineDriver:
    return LineDriver(LinePort(port=terminal.path, baud=250_000), patience=3.0)


def drive(rig: OwnRig, exchanges: int, pieces: int = 0) -> None:
    """Drive a rig; each reading is of the order before it."""
    with on_a_line(rig, pieces) as terminal:
        line = driver(terminal)
        for number in range(exchanges):
            amps = round(0.01 * (number % 200 - 100), 5)
            read = line.exchange(amps)
            assert read.plate == pytest.approx(PLATE + 273.15)
            assert read.current == pytest.approx(amps)
            assert rig.current == pytest.approx(amps)
        line.close()
        assert rig.current == 0.0


def stale(order: bytes, answer: bytes) -> bytes:
    """An answer to an order before this one comes once more; of version 1 nobody could tell."""
    if not answer.startswith(b"R "):
        return answer
    before = (int(answer.split()[1]) - 1) % 256
    return seal_2(f"R {before} 39.0 25.1 0.0 nan 2.00000 ok") + answer


HABITS: dict[str, Callable[[bytes, bytes], bytes]] = {
    "echo": lambda order, answer: order + answer,
    "talks": lambda order, answer: b"# loop 417 us, all well\n" + answer,
    "talks twice": lambda order, answer: b"boot\r\n\r\n" + answer + b"> ",
    "carriage return and line feed": lambda order, answer: answer[:-1] + b"\r\n",
    "line feed and carriage return": lambda order, answer: answer + b"\r",
    "zeros": lambda order, answer: b"\0\0" + answer,
    "small letters": lambda order, answer: answer[:-5] + answer[-5:].lower(),
    "half an answer before": lambda order, answer: answer[:9] + b"\n" + answer,
}


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("habit", HABITS)
def test_each_variant_of_the_line_protocol_is_driven(version: int, habit: str) -> None:
    drive(OwnRig(version, habit=HABITS[habit]), 12)


@pytest.mark.parametrize("version", [1, 2])
def test_an_answer_that_comes_byte_by_byte(version: int) -> None:
    drive(OwnRig(version), 6, pieces=1)


def test_an_answer_to_an_earlier_order_is_none() -> None:
    drive(OwnRig(2, habit=stale), 12)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("late", [10e-3, 30e-3])
def test_late_answers_are_lived_through(version: int, late: float) -> None:
    drive(OwnRig(version, late=late), 12)


@pytest.mark.parametrize(("version", "kind"), [(1, "damaged"), (1, "cut"), (2, "damaged"), (2, "cut"), (2, "lost")])
def test_one_bad_answer_in_ten_ends_nothing(version: int, kind: str) -> None:
    chance = random.Random(7)

    def sometimes(order: bytes, answer: bytes) -> bytes:
        if chance.random() >= 0.1:
            return answer
        at = chance.randrange(len(answer) - 1)
        wrong = answer[:at] + bytes((answer[at] ^ 1 << chance.randrange(7),)) + answer[at + 1 :]
        return {"damaged": wrong, "cut": answer[at:], "lost": b""}[kind]

    drive(OwnRig(version, habit=sometimes), 300)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("takes", [0.0, 20e-3])
def test_after_a_stall_each_reading_is_again_of_its_own_order(version: int, takes: float) -> None:
    """The order was sent again meanwhile; its second and third answer are not those to the orders behind it."""
    rig = OwnRig(version, takes=takes)

    def stall(order: bytes, answer: bytes) -> bytes:
        if rig.orders == 10:
            rig.free = time.monotonic() + 0.25
        return answer

    rig.habit = stall
    drive(rig, 30)


def test_four_answers_lost_in_a_row_make_no_reading_too_old() -> None:
    """Version 2 numbers its answers: an order is sent again before the reading is as old as W1 lets it be."""
    waits: list[float] = []

    class Deaf:
        """A line on which nothing is heard, and what it was waited for."""

        port = "bench"

        def clear(self) -> None: ...

        def send(self, message: bytes) -> None: ...

        def receive(self, wait: float) -> bytes | None:
            waits.append(wait)
            return None

    with on_a_line(OwnRig(2)) as terminal:
        line = LineDriver(LinePort(port=terminal.path, baud=250_000))
        real, line._line = line._line, Deaf()  # type: ignore[assignment]
        line._usual = 0.002  # [s]: as it answers where nothing else runs on the machine
        with pytest.raises(
            DeviceError, match="did not answer '.*', sent again and again; check its power and its cable$"
        ):
            line.exchange(0.5)
        line._line = real
        line.close()
    assert sum(waits[:4]) < 0.1
    assert len(waits) == 8


def test_a_line_that_never_ends_to_talk_holds_up_nobody() -> None:
    terminal = Terminal()
    with served(lambda: terminal.send(b"R 1 2\nlog log log\n")):
        begin = time.monotonic()
        with pytest.raises(DeviceError, match="did not answer"):
            driver(terminal)
        assert time.monotonic() - begin < 60.0  # it ends
    terminal.close()


def test_a_port_that_vanishes_is_told_and_one_that_comes_back_is_opened() -> None:
    rig = OwnRig(2)
    with on_a_line(rig) as terminal:
        line = driver(terminal)
        line.exchange(0.5)
        path = terminal.path
        assert os.path.exists(path)
    with pytest.raises(DeviceError):
        for _ in range(3):
            line.exchange(0.5)
    with pytest.raises(DeviceError):
        line.close()
    with on_a_line(rig) as terminal:
        again = driver(terminal)
        assert again.exchange(0.25).current == pytest.approx(0.25)
        again.close()


def test_a_restart_in_the_middle_is_lived_through_or_told() -> None:
    """A rig that has restarted greets first, unasked; its current is what the next order says."""
    rig, count = OwnRig(2), iter(range(1000))
    rig.habit = lambda order, answer: (seal_2(GREETING) if next(count) == 5 else b"") + answer
    drive(rig, 12)


@pytest.mark.parametrize("version", [1, 2])
def test_one_that_talks_before_it_measures_is_not_asked_again_meanwhile(version: int) -> None:
    """Orders in a queue would be answered ever later; of version 1 nobody could tell which order an answer is to."""
    rig = OwnRig(version, takes=50e-3, talks=b"# measuring\n")
    drive(rig, 6)
    assert rig.orders < 12


@pytest.mark.parametrize("words", ["", "24.5 25.1 120.0 nan 1.0 ok fan=1200", "24.5 25.1 2.4e1 nan 1.0 ok"])
def test_an_answer_of_other_words_is_told_as_it_was(words: str) -> None:
    rig = OwnRig(2, answers=lambda number, _: f"R {number} {words}")
    with on_a_line(rig) as terminal:
        line = driver(terminal)
        with pytest.raises(
            DeviceError, match=f"answered '{words}', not five numbers and its state".replace(".", "[.]")
        ):
            line.exchange(0.5)
        line._line.close()


@pytest.mark.parametrize("plate", ["+24.5", "24.500000000000004", "+24.50"])
def test_numbers_have_any_sign_and_any_digits(plate: str) -> None:
    drive(OwnRig(2, answers=lambda number, amps: f"R {number} {plate} +25.1 -nan NaN {amps:+.12f} ok"), 4)


@pytest.mark.parametrize(("skin", "seen"), [("-127", False), ("999.9", False), ("31.5", True)])
def test_a_skin_that_cannot_be_is_no_finger(skin: str, seen: bool) -> None:
    """An open thermometer says such numbers."""
    with on_a_line(OwnRig(2, answers=lambda number, amps: f"R {number} 24.5 25.1 0 {skin} {amps:.5f} ok")) as terminal:
        line = driver(terminal)
        assert math.isfinite(line.exchange(0.5).skin) == seen
        line.close()


@pytest.mark.parametrize("words", ["EVENT fan on", "READY"])
def test_a_sealed_word_that_only_begins_as_an_answer_is_none(words: str) -> None:
    for version, sealed in ((1, seal(words)), (2, seal_2(words))):
        drive(OwnRig(version, talks=sealed), 3)


@pytest.mark.parametrize(
    ("said", "instead"),
    [("silence=0.2", "silence=0"), ("silence=0.2", "silence=-1"), ("plate=10:43", "plate=43:10"), ("amps=3", "amps=0")],
)
def test_a_promise_that_can_be_none_is_refused(said: str, instead: str) -> None:
    """A silence of 0 is how many a device says that its watchdog is off."""
    greeting = seal_2(GREETING.replace(said, instead))
    with (
        on_a_line(OwnRig(2, greets=lambda: greeting)) as terminal,
        pytest.raises(DeviceError, match="impossible limit"),
    ):
        driver(terminal)


def test_a_cut_off_is_seen_even_if_the_greeting_has_the_old_check_sum() -> None:
    greeting = seal(GREETING.replace("cut=none", "cut=plate-hot"))
    said = pytest.raises(DeviceError, match="its plate was too hot")
    with on_a_line(OwnRig(2, greets=lambda: greeting)) as terminal, said:
        driver(terminal)


@pytest.mark.parametrize(("sealed", "version"), [(seal, "10"), (seal_2, "20")])
def test_another_version_is_not_taken_for_one_that_begins_so(sealed: Callable[[str], bytes], version: str) -> None:
    greeting = sealed(f"N itouch-line {version} bench amps=3 plate=10:43 sink=58 silence=0.2 reset=power cut=none")
    said = pytest.raises(DeviceError, match=f"answers 'itouch-line {version} .*not 'itouch-line 1'")
    with on_a_line(OwnRig(2, greets=lambda: greeting)) as terminal, said:
        driver(terminal)


@pytest.mark.parametrize("baud", ["0", "-5", "3000000"])
def test_a_speed_that_no_port_has_is_bad_input(baud: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli(["thermal", "display", "/dev/no-such-port", "--baud", baud]) == 2
    assert f"--baud {baud} is out of range: 9600 to 2000000" in capsys.readouterr().err


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(("gives", "asked"), [(lambda amps: 2.0, 0.5), (lambda amps: -amps, 1.5)])
def test_a_rig_that_gives_another_current_is_told(version: int, gives: Callable[[float], float], asked: float) -> None:
    rig = giving(version, gives)
    with on_a_line(rig) as terminal:
        line = driver(terminal)
        with pytest.raises(DeviceError, match=f"gives {gives(asked):.2f} A where {asked:.2f} A was asked for"):
            for _ in range(60):
                line.exchange(asked)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("gives", [lambda amps: 0.0, lambda amps: 0.4 * amps, lambda amps: amps + 0.2])
def test_a_rig_may_give_less_current_or_not_measure_it(version: int, gives: Callable[[float], float]) -> None:
    """It holds back by itself, or a bridge that has no shunt says nothing of it."""
    with on_a_line(giving(version, gives)) as terminal:
        line = driver(terminal)
        for _ in range(60):
            line.exchange(-2.0)


def giving(version: int, gives: Callable[[float], float]) -> OwnRig:
    """Return a rig that says that it gives another current than was asked for."""

    def answer(number: str, amps: float) -> str:
        values = f"{PLATE:.3f} 25.1 120.0 nan {gives(amps):.5f}"
        return f"R {number} {values} ok" if version == 2 else f"R {values}"

    return OwnRig(version=version, answers=answer)
