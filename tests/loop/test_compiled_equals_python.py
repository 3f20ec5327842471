"""The check `joined`: what is compiled does what it does in Python; if not, the suite says so."""

from __future__ import annotations

import gc
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES
from test_plugin_fault_isolation import SCENE, Hum, engine

import itouch
from itouch.loop import Engine
from itouch.loop.device_runner import DeviceFaultError
from itouch.plugin import Bound, Contact, ContactArrays, ContactEvent, Device, Field, Record, TwinInputs
from itouch.plugin.kernels import kernel
from itouch.testing import joined
from itouch.testing.checks import CheckError, NotApplicableError
from itouch.testing.harness import DeviceHarness
from itouch_thermal import ThermalDisplay
from itouch_usb_arm.arm import UsbArm
from itouch_xyz_table import XyzTable


@kernel
def _one_more(place: np.ndarray) -> int:
    """Count."""
    place[0] += 1.0
    return 0


EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "compiled_twin.py"


def _example() -> Any:
    spec = importlib.util.spec_from_file_location("compiled_twin", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = sys.modules["compiled_twin"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("device", [XyzTable, UsbArm, ThermalDisplay])
def test_the_shipped_twins_do_the_same_both_ways(device: type[Device]) -> None:
    assert "ticks" in joined.twin.run(DeviceHarness(device, "device"))


def test_the_example_passes_and_its_python_twin_does_not_join() -> None:
    example = _example()
    assert joined.twin.run(DeviceHarness(example.Rod, "rod"))
    slow = type("Slow", (example.Rod,), {"Twin": example.PythonTwin})
    with pytest.raises(NotApplicableError, match="plain Python"):
        joined.twin.run(DeviceHarness(slow, "rod"))


def test_the_example_is_the_same_rod_in_python() -> None:
    example = _example()
    for ticks in (1, 17, 300):
        twins = [cls(example.RodParams()) for cls in (example.PythonTwin, example.CompiledTwin)]
        assert example.height_after(twins[0], ticks) == example.height_after(twins[1], ticks)


def test_a_step_that_differs_is_told() -> None:
    example = _example()

    class Wrong(example.CompiledTwin):  # type: ignore[misc, name-defined]
        def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
            return Bound(example.swing, state["height"], state["speed"], touch.wrench, 7.0, 1.0, period)

        def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
            super(example.CompiledTwin, self).step(state, command, touch, period)

    wrong = type("WrongRod", (example.Rod,), {"Twin": Wrong})
    with pytest.raises(CheckError, match="the field '(height|speed)' is .* joined"):
        joined.twin.run(DeviceHarness(wrong, "rod"))


@kernel
def _count(count: Any) -> int:
    if count[0] % 5 == 4:
        return 1  # left to Python
    count[0] += 1
    return 0


def test_a_modality_joins_and_leaves_to_python_what_it_will(tmp_path: Path) -> None:

    class Quick(Hum):
        def bound_update(self, model: Any, state: Record, period: float) -> Bound:
            return Bound(_count, state["hum.count"])

    found: Engine = engine(tmp_path, Quick)
    step = next(step for step in found.plan.steps if step.name == "hum")
    assert step.bound is not None
    found.run(0.02)
    assert int(found.state["hum.count"]) == found.ticks  # both count by one


class _Address:
    """A whole number by its address, which may be written, as compiled code may write anywhere."""

    def __init__(self, address: int) -> None:
        self.__array_interface__ = {"version": 3, "shape": (1,), "typestr": "<i8", "data": (address, False)}


@kernel
def _hear(event: Any, count: Any, left: int) -> int:
    if event.kind[0] == left:
        return 1  # left to Python
    if event.kind[0] >= 0:
        count[0] += 1000 + 100 * event.kind[0]
    return 0


def _hearing(tmp_path: Path, left: int, elsewhere: str = "") -> Engine:
    class Quick(Hum):
        subscribes_to = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})

        def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
            state["hum.count"][...] += 1000 + 100 * event.kind

        def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound:
            count = state[elsewhere or "hum.count"]
            return Bound(_hear, event, np.asarray(_Address(count.ctypes.data)), left)

    return engine(tmp_path, Quick)


@pytest.mark.parametrize("left", [9, *Contact])
def test_a_modality_hears_of_contacts_compiled_and_leaves_to_python_what_it_will(tmp_path: Path, left: int) -> None:
    found = _hearing(tmp_path, left)
    found.run(0.35)
    table = found.state["events.table"]["kind"][: int(found.state["events.count"])].tolist()
    assert {Contact.NEAR, Contact.BEGIN, Contact.END} <= set(table)
    assert int(found.state["hum.count"]) == found.ticks + sum(1000 + 100 * kind for kind in table)


@kernel
def _note(event: Any, count: Any, begun: Any) -> int:
    if event.kind[0] == 1:
        begun[0] = event.tick[0]
    elif event.kind[0] == 2:
        count[0] += 1000000 if event.tick[0] == begun[0] else 1000
    return 0


@pytest.mark.parametrize("compiled", [True, False])
def test_the_first_move_comes_in_the_tick_after_the_beginning(tmp_path: Path, compiled: bool) -> None:
    class Follower(Hum):
        subscribes_to = frozenset({Contact.BEGIN, Contact.MOVE})

        def fields(self, model: Any) -> tuple[Field, ...]:
            return Field("count", "i8"), Field("begun", "i8")

        def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
            numbers = ContactArrays.of(event, 0)
            Bound(_note, numbers, state["hum.count"].reshape(1), state["hum.begun"].reshape(1)).run()

        def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound | None:
            own = state["hum.count"].reshape(1), state["hum.begun"].reshape(1)
            return Bound(_note, event, *own) if compiled else None

    found = engine(tmp_path, Follower)
    found.run(0.35)
    table = found.state["events.table"][: int(found.state["events.count"])]
    (begin,), (end,) = ([int(one["tick"]) for one in table if one["kind"] == kind] for kind in (1, Contact.END))
    assert int(found.state["hum.count"]) == found.ticks + 1000 * (end - begin - 1)


def test_an_heir_that_hears_of_less_is_not_told_of_more(tmp_path: Path) -> None:

    class Quick(Hum):
        subscribes_to = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})

        def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
            state["hum.count"][...] += 1000 + 100 * event.kind

        def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound:
            return Bound(_hear, event, state["hum.count"].reshape(1), 9)

    class Few(Quick):
        subscribes_to = frozenset({Contact.BEGIN})

    found = engine(tmp_path, Few)
    found.run(0.35)
    table = found.state["events.table"]["kind"][: int(found.state["events.count"])].tolist()
    assert Contact.END in table and table.count(Contact.BEGIN) == 1
    assert int(found.state["hum.count"]) == found.ticks + 1000 + 100 * Contact.BEGIN


def test_a_compiled_listener_that_writes_elsewhere_is_told_by_name(tmp_path: Path) -> None:
    found = _hearing(tmp_path, 9, "events.count")
    with pytest.raises(DeviceFaultError, match=r"hum.*events\.count"):
        found.run(0.35)


def test_an_heir_with_an_update_of_its_own_runs_that(tmp_path: Path) -> None:

    class Quick(Hum):
        def bound_update(self, model: Any, state: Record, period: float) -> Bound:
            return Bound(_count, state["hum.count"])

    class Slow(Quick):
        def update(self, model: Any, state: Record, period: float) -> None:
            state["hum.count"][...] += 2

    found: Engine = engine(tmp_path, Slow)
    found.run(0.01)
    assert int(found.state["hum.count"]) == 2 * found.ticks


def test_a_call_that_is_made_runs_and_is_gone() -> None:
    place = np.zeros(1)
    Bound(_one_more, place.copy()).run()  # compiled now
    gc.collect()
    gc.disable()
    try:
        made = Bound(_one_more, place)
        assert (made.run(), made.run(), place[0]) == (0, 0, 2.0)
        del made
        assert gc.collect() == 0, "what is left refers to itself in a circle"
    finally:
        gc.enable()


def test_python_has_nothing_to_do_while_a_touch_off_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither with what carries the plate, nor with where frames are, nor with a hand that rests."""
    session = itouch.build(SCENES / "four_materials.xml", seed=1)
    (rig,), called = session._rigs, []

    def counted(name: str) -> Callable[..., None]:
        method = getattr(rig, name)
        return lambda *given: (called.append(name), method(*given))[1]

    for name in ("contact", "surface", "lead"):
        monkeypatch.setattr(rig, name, counted(name))
    session.tick()  # frames are found once
    called.clear()
    session.run(until=lambda: bool(session.state["ready"]))
    assert session.ticks > 1000
    assert called in ([], ["contact"])  # the calibration has moved the table's frame


#: Prints what tells the State of a short run with a touch; arguments: a scene, and for how long it runs [s].
_RUN = """
import hashlib, sys
import itouch
session = itouch.build(sys.argv[1], seed=1)
session.records = False
session.run(float(sys.argv[2]))
kinds = session.state["events.table"]["kind"][: int(session.state["events.count"])].tolist()
print(kinds, hashlib.sha256(session.state.tobytes()).hexdigest())
"""


@pytest.mark.parametrize(
    ("name", "seconds", "kinds"), [("", "0.35", "[0, 1, 3] "), ("texture.xml", "1.6", "[0, 1, 0, 3, 1] ")]
)
def test_a_session_is_the_same_with_the_compiler_off(tmp_path: Path, name: str, seconds: str, kinds: str) -> None:
    path = SCENES / name if name else tmp_path / "scene.xml"
    if not name:
        path.write_text(SCENE.format(plugin="usb-arm", modality="", force='force-to="arm"'), encoding="utf-8")
    said = [
        subprocess.run([sys.executable, "-c", _RUN, str(path), seconds], env={**os.environ, "NUMBA_DISABLE_JIT": off},
                       capture_output=True, text=True, check=False)
        for off in ("0", "1")
    ]  # fmt: skip
    assert [one.returncode for one in said] == [0, 0], said[1].stderr[-2000:]
    assert said[0].stdout.startswith(kinds)
    assert said[0].stdout == said[1].stdout


def test_a_surface_on_a_device_without_force_divides_by_nothing_before_it_is_placed(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    scene = SCENE.format(plugin="usb-arm", modality="", force='force-to="arm" surface-to="table"')
    table = '<device name="table" plugin="xyz-table"/></devices>'
    path.write_text(scene.replace("</devices>", table), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error:divide by zero:RuntimeWarning", "-c", _RUN, str(path), "0.005"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]


#: Writes the commands of a touch that begins; arguments: a scene, a file with the State to begin with, one to write.
#: With the compiler on, the State is written 10 ms before the touch.  What a start temperature is found from would take
#: minutes in Python: without the variable, a process takes it from where one with the compiler has kept it.
_BEGIN = """
import os, sys
from collections import deque
import numba
compiled = not numba.config.DISABLE_JIT
os.environ.pop("NUMBA_DISABLE_JIT", None)
import numpy as np
import itouch
scene, begin, commands = sys.argv[1:]
session = itouch.build(scene, seed=1)
session.records = False
touched, before = session.state["finger.contact.object"], deque(maxlen=10)
if compiled:
    session.run(until=lambda: (before.append(session.state.tobytes()), touched >= 0)[1])
    open(begin, "wb").write(before[0])
session.adopt(open(begin, "rb").read())
names = [name for name in session.state if ".command." in name]
rows = []
for _ in range(60):
    session.tick()
    rows.append(np.concatenate([session.state[name].ravel() for name in names]))
np.save(commands, rows)
print(compiled, int(touched) >= 0, *names)
"""


def test_a_thermal_touch_is_the_same_with_the_compiler_off(tmp_path: Path) -> None:
    """But for rounding."""
    said = [
        subprocess.run([sys.executable, "-W", "ignore", "-c", _BEGIN, str(SCENES / "four_materials.xml"),
                        str(tmp_path / "state"), str(tmp_path / f"commands{off}.npy")],
                       env={**os.environ, "NUMBA_DISABLE_JIT": off, "ITOUCH_KEPT": str(tmp_path / "kept")},
                       capture_output=True, text=True, check=False)
        for off in ("0", "1")
    ]  # fmt: skip
    assert [one.returncode for one in said] == [0, 0], said[1].stderr[-2000:]
    names = said[0].stdout.split()[2:]
    assert [one.stdout.split() for one in said] == [["True", "True", *names], ["False", "True", *names]]
    compiled, python = (np.load(tmp_path / f"commands{off}.npy") for off in ("0", "1"))
    assert names[-1] == "peltier.command.current" and np.ptp(compiled[:, -1]) > 1.0
    np.testing.assert_allclose(python, compiled, rtol=1e-9, atol=1e-12)
