"""The check `joined`: each door to compiled code is compared with its Python, also where no run leads by itself."""

from __future__ import annotations

import dataclasses
import re
from typing import Any, ClassVar

import numpy as np
import pytest
from slider import Slider, SliderTwin
from test_modality_suite import Counter, harness

from itouch import joining
from itouch.plugin import Bound, Contact, ContactArrays, ContactEvent, Field, Record, Twin, TwinInputs
from itouch.plugin.kernels import kernel
from itouch.testing import joined
from itouch.testing.checks import CheckResult
from itouch.testing.harness import DeviceHarness
from itouch.testing.scenario import made

# --- a modality: `which` is the way in which its compiled form differs ------------------------------------------------


@kernel
def _update(which: int, count: Any, x: Any, choice: Any, place: Any, told: Any) -> int:
    """Count; note in ``told`` what the finger's place says."""
    if which == 6 and count[0] % 7 == 6:
        return 1
    if which == 7 and x[0] > 0.01:
        count[0] += 1
        return 1
    if which == 15 and x[0] < -1e-3:
        raise ValueError("there is no such x")
    wrong = (
        (which == 1 and x[0] < -1e-3)
        or (which == 2 and count[0] > 1000)
        or (which == 3 and choice[0] == 7)
        or (which == 4 and place[2] > 0.05)
    )
    count[0] += 101 if wrong else 1
    told[0] = place[2] * (1.0 + 1e-15 if which == 5 else 1.0)
    return 0


@kernel
def _hear(which: int, event: Any, heard: Any, last: Any) -> int:
    """Add up what is heard, and remember the speed of the last beginning."""
    kind = event.kind[0]
    if which == 10:
        heard[0] += 1.0 if kind >= 0 else 0.0  # also what is not heard of
    if kind != 1 and kind != 3:
        return 0
    if which == 14 and kind == 3:
        return 1
    heard[0] += 2.0 if which == 11 and kind == 3 else 1.0
    if kind == 1:
        last[0] = abs(event.speed[0]) if which == 12 else event.speed[0]
    elif which == 13 and last[0] < -0.05:
        last[0] = 0.0
    return 0


class Both(Counter):
    """Counts updates, and hears of beginnings and ends; both also compiled."""

    subscribes_to = frozenset({Contact.BEGIN, Contact.END})
    which: ClassVar[int] = 0

    def fields(self, model: Any) -> tuple[Field, ...]:
        return (
            Field("count", "i8", unit="1"), Field("x", unit="1"), Field("choice", "i8", low=0, high=9, unit="1"),
            Field("told", unit="m"), Field("heard", unit="1"), Field("last", unit="m/s"),
        )  # fmt: skip

    def _own(self, model: Any, state: Record, *names: str) -> list[Any]:
        return [state[f"{model['name']}.{name}"] for name in names]

    def reset(self, model: Any, state: Record) -> None:
        state[f"{model['name']}.count"] = 0

    def update(self, model: Any, state: Record, period: float) -> None:
        count, told = self._own(model, state, "count", "told")
        count += 1
        told[...] = state["finger.hip"][2]

    def bound_update(self, model: Any, state: Record, period: float) -> Bound:
        count, x, choice, told = self._own(model, state, "count", "x", "choice", "told")
        return Bound(_update, self.which, count, x, choice, state["finger.hip"], told)

    def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
        heard, last = self._own(model, state, "heard", "last")
        heard += 1.0
        if event.kind is Contact.BEGIN:
            last[...] = event.speed

    def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound:
        return Bound(_hear, self.which, event, *self._own(model, state, "heard", "last"))


def _examined(which: int, **more: Any) -> CheckResult:
    return joined.modality.examine(harness(type("Wrong", (Both,), {"which": which, **more})))


@pytest.mark.parametrize("which", [0, 6, 14])
def test_a_modality_whose_forms_are_the_same_passes(which: int) -> None:
    """Also one that now and then leaves it to Python."""
    finding = _examined(which)
    assert finding.outcome == "passed", finding.note
    assert "random States" in finding.note


@pytest.mark.parametrize(
    ("which", "said"),
    [
        (1, r"'count.count' is \d+ joined and \d+ in Python after update, in draw \d+ of seed \d+"),
        (2, r"'count.count' is 1102 joined and 1002 in Python, at tick 1001\n"),
        (3, r"'count.count' is \d+ joined and \d+ in Python after update, in draw \d+ of seed \d+"),
        (4, r"'count.count' is \d+ joined and \d+ in Python after update, in draw \d+ of seed \d+"),
        (5, r"'count.told' is 0.0450*5 joined and 0.045 in Python, at tick 0, in which NEAR happened"),
        (7, r"'count.count' is \d+ joined and \d+ before it, though what joins for update returns 1, in draw \d+"),
        (15, r"what joins for update raises ValueError: there is no such x, and Python does not, in draw \d+ of seed"),
        (10, r"'count.heard' is 1.0 joined and 0.0 in Python, at tick 0, in which NEAR happened"),
        (11, r"'count.heard' is 4.0 joined and 3.0 in Python, at tick \d+, in which NEAR and END and BEGIN happened"),
        (12, r"'count.last' is .* joined and -.* in Python, at tick \d+, in which .*BEGIN happened"),
        (13, r"'count.last' is 0.0 joined and -.* in Python after on_contact, in draw \d+ of seed \d+, of an event END"),
    ],
)  # fmt: skip
def test_a_modality_whose_forms_differ_is_told_where(which: int, said: str) -> None:
    finding = _examined(which)
    assert finding.outcome == "failed"
    assert re.search(said, finding.note), finding.note


def test_what_python_makes_nothing_of_is_no_finding() -> None:
    """From a State that raises, or gives NaN, in Python alone."""

    def update(self: Any, model: Any, state: Record, period: float) -> None:
        if self._own(model, state, "x")[0] < -1e-3:
            raise ValueError("there is no such x")
        Both.update(self, model, state, period)
        if self._own(model, state, "x")[0] > 1e-3:
            state[f"{model['name']}.told"] = np.nan

    finding = _examined(0, update=update, bound_update=Both.bound_update)
    assert finding.outcome == "passed" and int(re.findall(r"(\d+) random", finding.note)[0]) < joined._DRAWS


def test_a_class_that_may_have_no_heirs_is_compared_from_random_states_alone() -> None:
    class Last(Both):
        which = 3

        def __init_subclass__(cls) -> None:
            raise TypeError("it is the last one")

    finding = joined.modality.examine(harness(Last))
    assert finding.outcome == "failed" and re.search(r"'count.count' .* in draw \d+ of seed", finding.note)
    Last.which = 0
    finding = joined.modality.examine(harness(Last))
    assert (finding.outcome, finding.note) == ("passed", "no subclass of it runs in Python; 800 random States")


def test_an_update_that_comes_every_tenth_tick_is_compared_with_its_own_period() -> None:
    class Slow(Both):
        def update(self, model: Any, state: Record, period: float) -> None:
            self._own(model, state, "x")[0][...] += period

        def bound_update(self, model: Any, state: Record, period: float) -> Bound:
            return Bound(_add, state[f"{model['name']}.x"], period)

    one = harness(Slow)
    text = made("counter.count", one.catalog).replace("</interaction>", '</interaction><rates count="100 Hz"/>')
    finding = joined.modality.examine(dataclasses.replace(one, scene=text))
    assert finding.outcome == "passed", finding.note


@kernel
def _add(x: Any, period: float) -> int:
    x[0] += period
    return 0


# --- a twin: `which` is the way in which its compiled form differs ----------------------------------------------------


@kernel
def _step(which: int, place: Any, finger: Any, wrench: Any, asked: Any, skin: Any) -> int:
    """Follow the finger, pushed by a command."""
    for i in range(3):
        place[i] = finger[i] + 1e-3 * asked[i]
    if (which == 1 and wrench[1] > 1.0) or (which == 2 and asked[2] < -4.0) or (which == 3 and skin[0] < 292.0):
        place[2] += 1e-3
    if which == 4:
        asked[2] = 0.0
    return 0


@kernel
def _read(which: int, place: Any, shown: Any) -> int:
    """Show the place, if it is above the ground."""
    if place[2] < -0.02:
        return 0 if which == 7 else 1
    for i in range(7):
        shown[i] = place[i] if i < 3 else 0.0
    shown[3] = 1.0
    if which == 5 or (which == 6 and place[0] > 0.03):
        shown[2] += 0.003
    return 0


class TwoFormsTwin(SliderTwin):
    """Follows the finger; in Python and compiled."""

    which = 0

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        for i in range(3):
            state["place"][i] = touch.finger_pose[i] + 1e-3 * command["wrench"][i]

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        given = (touch.finger_pose, touch.wrench, command["wrench"], touch.skin_temperature)
        return Bound(_step, self.which, state["place"], *given)

    def read(self, state: Record, reading: Record) -> bool:
        if state["place"][2] < -0.02:
            return False
        reading["pose"] = (*state["place"], 1.0, 0.0, 0.0, 0.0)
        return True

    def bound_read(self, state: Record, reading: Record) -> Bound:
        return Bound(_read, self.which, state["place"], reading["pose"])


def test_a_bench_binds_the_calls_of_a_twin_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a session does: binding takes ten times as long as the call."""
    bench = DeviceHarness(type("Moved", (Slider,), {"Twin": TwoFormsTwin}), "slider").bench()
    called, caller = list[Bound](), joining.caller
    monkeypatch.setattr(joining, "caller", lambda bound: called.append(bound) or caller(bound))
    bench.step(50)
    assert [bound.function for bound in called] == [_step, _read]


def _twin(which: int, **more: Any) -> CheckResult:
    twin = type("WrongTwin", (TwoFormsTwin,), {"which": which, **more})
    return joined.twin.examine(DeviceHarness(type("Wrong", (Slider,), {"Twin": twin}), "slider"))


@pytest.mark.parametrize("door", ["step", "read", ""])
def test_a_twin_whose_forms_are_the_same_passes(door: str) -> None:
    """Also one that offers only one of them."""
    finding = _twin(0, **({f"bound_{door}": getattr(Twin, f"bound_{door}")} if door else {}))
    assert finding.outcome == "passed" and "800 random States" in finding.note, finding.note


@kernel
def _rest(shown: Any) -> int:
    shown[:] = 0.0
    shown[3] = 1.0
    return 0


def test_a_twin_without_state_is_compared_too() -> None:
    class Still(Twin):
        """Stays where it is."""

        def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None: ...

        def read(self, state: Record, reading: Record) -> bool:
            reading["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
            return True

        def bound_read(self, state: Record, reading: Record) -> Bound:
            return Bound(_rest, reading["pose"])

    finding = joined.twin.examine(DeviceHarness(type("Resting", (Slider,), {"Twin": Still}), "slider"))
    assert finding.outcome == "passed", finding.note


@pytest.mark.parametrize(
    ("which", "said"),
    [
        (1, r"the field 'place', number 2, is [\d.e-]+ joined and [\d.e-]+ in Python after step, in draw \d+ of seed"),
        (2, r"the field 'place', number 2, is [\d.e-]+ joined and [\d.e-]+ in Python after step, in draw \d+ of seed"),
        (3, r"the field 'place', number 2, is [\d.e-]+ joined and [\d.e-]+ in Python after step, in draw \d+ of seed"),
        (4, r"the command 'wrench', number 2, is 0.0 joined and [\d.e-]+ in Python after step, at tick \d+"),
        (5, r"the reading 'pose', number 2, is 0.005\d+ joined and 0.002\d+ in Python after read, at tick 0"),
        (6, r"the reading 'pose', number 2, is [\d.e-]+ joined and [\d.e-]+ in Python after read, in draw \d+ of seed"),
        (7, r"there is a new reading joined and none in Python after read, in draw \d+ of seed"),
    ],
)  # fmt: skip
def test_a_twin_whose_forms_differ_is_told_where(which: int, said: str) -> None:
    finding = _twin(which)
    assert finding.outcome == "failed"
    assert re.search(said, finding.note), finding.note
