"""Plugins of others whose code fails: everything is made safe, and whose fault it was is said by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from requirements import meant

import itouch
from itouch.joining import can_join
from itouch.loop import contact_report
from itouch.plugin import (
    Bound,
    Channel,
    Contact,
    Device,
    DeviceError,
    Field,
    Measured,
    Mechanics,
    Modality,
    Record,
    Role,
    Timing,
    Twin,
    pose,
    wrench,
)
from itouch.plugin.discovery import Catalog, Found, find
from itouch.plugin.kernels import kernel
from itouch.safety import Trip
from itouch.schema.plugin_errors import error_text

SCENE = """<itouch version="1.0" xmlns:tone="urn:itouch:plugin:tone">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" material="wood"/></world>
  <devices><device name="arm" plugin="{plugin}"/></devices>
  <interaction><probe name="finger" pose-from="arm" {force}/>
    <operator probe="finger"><motion>
      <to pos="0 0 30 mm" in="20 ms"/><to pos="0 0 5 mm" in="100 ms" hold="50 ms"/><to pos="0 0 60 mm" in="150 ms"/>
    </motion></operator>
    {modality}
  </interaction>
</itouch>
"""


@dataclass(frozen=True)
class Params:
    """Nothing."""


class Hum(Modality):
    """Commands the arm, and does nothing wrong."""

    Params = Params

    def compile(self, name: str, params: Any, world: Any) -> None:
        return None

    def fields(self, model: Any) -> tuple[Field, ...]:
        return (Field("count", "i8"),)

    def commands(self, model: Any) -> tuple[str, ...]:
        return ("arm.wrench",)

    def reset(self, model: Any, state: Record) -> None:
        state["hum.count"] = 0

    def update(self, model: Any, state: Record, period: float) -> None:
        state["hum.count"][...] += 1


class Rod(Device):
    """An arm that does nothing wrong."""

    Params: ClassVar[type] = Params
    reads = (pose(),)
    commands = (wrench(force=2.0),)

    def open(self) -> None: ...
    def close(self) -> None: ...
    def read(self, reading: Record) -> None: ...


class RodTwin(Twin):
    """Follows the finger that holds it."""

    def fields(self) -> tuple[Field, ...]:
        return (Field("place", "f8", 7),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        state["place"] = (0, 0, 0.05, 1, 0, 0, 0)

    def step(self, state: Record, command: Record, touch: Any, period: float) -> None:
        state["place"][:3] = touch.finger_pose[:3]

    def read(self, state: Record, reading: Record) -> None:
        reading["pose"] = state["place"]


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def engine(
    tmp_path: Path, modality: type[Modality] | None = Hum, device: type[Device] | None = None, name: str = "hum"
) -> itouch.Session:  # fmt: skip
    def finder(group: str) -> dict[str, Found]:
        found = dict(find(group))
        added: dict[str, tuple[str, type | None]] = {
            "itouch.modalities": ("tone.hum", modality), "itouch.devices": ("rod", device)
        }  # fmt: skip
        entry, cls = added.get(group, ("", None))
        return found if cls is None else {**found, entry: Found(entry, "itouch-tone", "1.0", Entry(cls))}  # type: ignore[arg-type]

    path = tmp_path / "scene.xml"
    text = SCENE.format(
        plugin="rod" if device else "usb-arm", modality=f'<tone:hum name="{name}"/>' if modality else "",
        force='' if modality else 'force-to="arm"',
    )  # fmt: skip
    path.write_text(text, encoding="utf-8")
    return itouch.build(path, catalog=Catalog(finder))


def broken(base: type, method: str, act: Callable[..., Any]) -> Any:
    return type("Broken", (base,), {method: act})


def late(when: int, inner: str) -> Callable[..., Any]:
    """Return an update that fails in the tick of that number; rehearsals count nothing."""

    def act(self: Any, *rest: Any) -> None:
        state = next(value for value in rest if isinstance(value, Record))
        if state["tick"].item() >= when:
            raise KeyError(inner)

    return act


def test_it_runs_when_nothing_is_wrong(tmp_path: Path) -> None:
    session = engine(tmp_path)
    session.run()
    assert session.report()["faults"] == []
    assert len(session.report()["contacts"]) == 1


@pytest.mark.parametrize("method", ["update", "on_contact"])
def test_a_modality_that_raises_makes_safe_and_is_named(tmp_path: Path, method: str) -> None:
    session = engine(tmp_path, broken(Hum, method, late(20, "no such tone")))
    with pytest.raises(itouch.DeviceFaultError, match="lost its modality 'hum'") as caught:
        session.run()
    fault = caught.value
    assert fault.trip is Trip.MODALITY_ERROR
    assert fault.device == "arm"
    assert f"failed in {method}: KeyError: 'no such tone' (test_plugin_fault_isolation.py, line " in fault.cause
    assert isinstance(fault.__cause__, KeyError)
    assert session.status("arm").name == "FAULT"
    assert not session.state["arm.sent.wrench"].any()
    (told,) = session.report()["faults"]
    assert (told["trip"], told["safe"]["reached"]) == ("modality-error", True)
    session.close()


def test_a_command_that_is_not_a_number_names_its_writer(tmp_path: Path) -> None:
    def act(self: Any, model: Any, state: Record, period: float) -> None:
        state["arm.command.wrench"][2] = np.nan if state["tick"].item() == 30 else 0.5

    session = engine(tmp_path, broken(Hum, "update", act))
    with pytest.raises(itouch.DeviceFaultError, match=r"commanded with NaN \(wrench\) by modality 'hum' at tick 30"):
        session.run()
    assert not session.state["arm.sent.wrench"].any()
    assert session.report()["faults"][0]["cause"].endswith("by modality 'hum'")


@pytest.mark.parametrize(
    ("method", "where"),
    [("compile", "compile"), ("fields", "fields"), ("commands", "commands"), ("reset", "reset"), ("update", "update")],
)
def test_a_modality_that_can_not_even_begin_is_a_problem_of_the_scene(tmp_path: Path, method: str, where: str) -> None:
    def act(self: Any, *rest: Any) -> None:
        raise TypeError("no tone at all")

    with pytest.raises(itouch.SceneError, match=f"modality 'hum' failed in {where}: TypeError: no tone") as caught:
        engine(tmp_path, broken(Hum, method, act))
    (problem,) = caught.value.problems
    assert problem.code == "plugin-failed"
    assert problem.place is not None and problem.place.line == 9


def test_what_only_tells_of_a_run_does_not_end_it(tmp_path: Path) -> None:
    def act(self: Any, model: Any, state: Record, *rest: Any) -> dict[str, Any]:
        if state["tick"].item() > 100:  # rehearsals take fewer ticks
            raise ZeroDivisionError("of nothing")
        return {}

    cls = broken(broken(Hum, "measures", act), "report", act)
    session = engine(tmp_path, cls)
    session.run()
    report = session.report()
    assert "ZeroDivisionError: of nothing" in report["contacts"][0]["hum_error"]
    assert "ZeroDivisionError: of nothing" in report["modalities"]["hum"]["error"]


LATER = 100  # a tick that rehearsals do not come to


def tells(first: object, then: object, **more: Any) -> Any:
    """Return a modality whose ``measures`` returns the one when it is rehearsed, and the other in the run."""

    def act(self: Any, model: Any, state: Record, *rest: Any) -> Any:
        value = then if state["tick"].item() > LATER else first
        return value(state) if callable(value) else value

    return type("Teller", (Hum,), {"measures": act, **more})


def test_what_measures_returns_is_a_figure_where_it_can_be_one(tmp_path: Path) -> None:
    figures = {
        "state": lambda state: state["hum.count"], "one": lambda state: np.array([2.5]), "f32": np.float32(1.5),
        "yes": np.bool_(True), "text": np.str_("soft"), "nothing": None, "nan": np.float64("nan"),
        "wave": lambda state: state["finger.hip"], "thing": object(),
    }  # fmt: skip

    def then(state: Record) -> dict[Any, Any]:
        given = {key: value(state) if callable(value) else value for key, value in figures.items()}
        return {**given, 5: 1.0, "begin_s": -5.0}

    session = engine(
        tmp_path, tells({}, then, report=lambda self, model, state: {"all": [state["hum.count"], object()]})
    )
    session.run()
    report = session.report()
    (contact,) = report["contacts"]
    json.dumps(report, allow_nan=False)
    assert contact["begin_s"] > 0.0
    assert type(contact["state"]) is int and contact["state"] > 0
    assert (contact["one"], contact["f32"], contact["text"], contact["nothing"], contact["nan"]) == (
        2.5,
        1.5,
        "soft",
        None,
        None,
    )
    assert contact["yes"] is True
    assert not {"wave", "thing", 5} & contact.keys()
    told = contact["hum_error"]
    assert "returned an array of 3 numbers as 'wave'; a figure is a number" in told
    assert "returned a value of type object as 'thing'" in told
    assert "under 5, which is no text" in told
    assert "under 'begin_s', which is the framework's own" in told
    assert told.count("(test_plugin_fault_isolation.py, line ") == 4
    assert report["modalities"]["hum"]["all"] == [session.state["hum.count"].item(), None]
    assert "report returned a value of type object as 'all[1]'" in report["modalities"]["hum"]["error"]


@pytest.mark.parametrize("wrong", [None, 3.0], ids=repr)
def test_measures_without_a_mapping_loses_nothing_but_itself(tmp_path: Path, wrong: Any) -> None:
    session = engine(tmp_path, tells({}, wrong, report=lambda self, model, state: None))
    session.run()
    (contact,) = session.report()["contacts"]
    assert contact["end_s"] > contact["begin_s"]
    assert "a mapping of names to figures is wanted, {} if there are none" in contact["hum_error"]
    assert "report returned None; a mapping" in session.report()["modalities"]["hum"]["error"]


@pytest.mark.parametrize(
    ("wrong", "why"), [(None, "returned None; a mapping"), ({"peak_force_N": 99.0}, "the framework's own")]
)
def test_measures_that_is_wrong_when_it_is_rehearsed_is_a_problem_of_the_scene(
    tmp_path: Path, wrong: Any, why: str
) -> None:
    with pytest.raises(
        itouch.SceneError, match=rf"modality 'hum': measures .*{why}.*\(test_plugin_fault_isolation.py, line"
    ) as caught:
        engine(tmp_path, tells(wrong, {}))
    (problem,) = caught.value.problems
    assert problem.place is not None and problem.place.line == 9


def test_measures_that_exits_does_not_lose_the_entry(tmp_path: Path) -> None:
    def then(state: Record) -> None:
        raise SystemExit(5)

    session = engine(tmp_path, tells({}, then))
    session.run()
    (contact,) = session.report()["contacts"]
    assert contact["end_s"] is not None
    assert "failed in measures: SystemExit: 5 (test_plugin_fault_isolation.py, line " in contact["hum_error"]


def test_ctrl_c_while_the_entry_of_a_contact_is_made_does_not_lose_it(tmp_path: Path) -> None:
    pressed: list[int] = []

    def act(self: Any, model: Any, state: Record, *rest: Any) -> dict[str, Any]:
        if state["events.count"].item() >= 3 and not pressed:  # near, begin, end
            pressed.append(1)
            raise KeyboardInterrupt
        return {}

    session = engine(tmp_path, type("Deaf", (Hum,), {"measures": act, "subscribes_to": frozenset()}))
    with pytest.raises(KeyboardInterrupt):
        session.run()
    (contact,) = session.report()["contacts"]
    assert contact["end_s"] is not None
    assert session.report()["contacts"] == [contact]


def test_a_twin_that_raises_is_a_lost_device(tmp_path: Path) -> None:
    def act(self: Any, state: Record, *rest: Any) -> None:
        state["place"][0] += 1.0  # a twin knows no tick
        if state["place"][0] > 40.0:
            raise RuntimeError("bent")

    twin = broken(RodTwin, "step", act)
    session = engine(tmp_path, None, type("Bent", (Rod,), {"Twin": twin}))
    with pytest.raises(itouch.DeviceFaultError) as caught:
        session.run()
    assert caught.value.device == "arm"
    session.close()


@pytest.mark.parametrize("method", ["fields", "reset", "step", "read", "stand"])
def test_a_twin_that_can_not_begin_is_a_problem_of_the_scene(tmp_path: Path, method: str) -> None:
    def act(self: Any, *rest: Any) -> None:
        raise OSError("no bench")

    twin = broken(RodTwin, method, act)
    with pytest.raises(itouch.SceneError, match="device 'arm' failed in .*: OSError: no bench"):
        engine(tmp_path, None, type("Bent", (Rod,), {"Twin": twin}))


def cross(self: Any, *rest: Any) -> None:
    raise DeviceError("the pad is cross; pat it")


@pytest.mark.parametrize("method", ["fields", "reset", "step"])
def test_a_twin_that_explains_itself_at_the_start_is_told_with_its_name_and_place(tmp_path: Path, method: str) -> None:
    with pytest.raises(itouch.SceneError) as caught:
        engine(tmp_path, None, type("Cross", (Rod,), {"Twin": broken(RodTwin, method, cross)}))
    (problem,) = caught.value.problems
    assert problem.sentence == "device 'arm': the pad is cross; pat it"
    assert problem.place is not None and problem.place.line == 4


@pytest.mark.parametrize("method", ["commands", "fields", "reset", "on_contact", "update"])
def test_a_modality_that_explains_itself_is_told_with_its_name_and_place(tmp_path: Path, method: str) -> None:
    with pytest.raises(itouch.SceneError) as caught:
        engine(tmp_path, broken(Hum, method, cross))
    (problem,) = caught.value.problems
    assert problem.sentence == "modality 'hum': the pad is cross; pat it"
    assert problem.place is not None and problem.place.line == 9


def test_what_fails_in_the_first_step_or_reading_of_a_twin_is_named_with_its_place(tmp_path: Path) -> None:
    def act(self: Any, *rest: Any) -> None:
        rest[1]["no such field"] = 1.0

    for method, where in (("step", "the step of its twin"), ("read", "the reading of its twin")):
        with pytest.raises(itouch.SceneError, match=f"failed in {where}: KeyError: 'no such field'") as caught:
            engine(tmp_path, None, type("Bent", (Rod,), {"Twin": broken(RodTwin, method, act)}))
        (problem,) = caught.value.problems
        assert "(test_plugin_fault_isolation.py, line " in problem.sentence  # not where the framework noticed it
        assert problem.place is not None and problem.place.line == 4


def test_a_reading_that_is_not_there_is_put_down_to_the_line_that_wrote_it(tmp_path: Path) -> None:
    def act(self: Any, state: Record, reading: Record) -> None:
        reading["pose"] = (0, 0, 0.05, 1, 0, 0, 0)
        state["place"][1] += 1.0
        if state["place"][1] > 40.0:
            reading["twist"] = 0.0

    twin = type("Bent", (RodTwin,), {"read": act, "step": lambda *rest: None})
    session = engine(tmp_path, None, type("Bent", (Rod,), {"Twin": twin}))
    with pytest.raises(
        itouch.DeviceFaultError, match=r"failed in read: KeyError: 'twist' \(test_plugin_fault_isolation.py, "
    ):
        session.run()
    session.close()


PLACE = Field("place", "f8", 7)
FIELDS = [
    (lambda self: None, "it returned None; a tuple of Field is wanted"), (lambda self: (PLACE, PLACE), "declared twice"),
    (lambda self: ("place",), "'place' among its fields, which is not a Field"),
]  # fmt: skip


@pytest.mark.parametrize(("fields", "why"), FIELDS, ids=["none", "twice", "text"])
def test_fields_that_can_not_be_state_are_a_problem_of_the_scene(tmp_path: Path, fields: Any, why: str) -> None:
    for modality, device, who, line in (
        (None, type("Bent", (Rod,), {"Twin": broken(RodTwin, "fields", fields)}), "device 'arm'", 4),
        (broken(Hum, "fields", lambda self, model: fields(self)), None, "modality 'hum'", 9),
    ):
        with pytest.raises(
            itouch.SceneError, match=rf"{who} failed in .*fields: .*{why}.*\(test_plugin_fault_isolation"
        ) as caught:
            engine(tmp_path, modality, device)
        assert [one.place.line for one in caught.value.problems if one.place] == [line]


@pytest.mark.parametrize("call", range(1, 5))
def test_a_twin_that_fails_in_a_later_call_of_fields_is_a_problem_of_the_scene(tmp_path: Path, call: int) -> None:
    calls: list[int] = []

    def act(self: Any) -> tuple[Field, ...]:
        calls.append(1)
        if len(calls) == call:
            raise ValueError("not again")
        return (PLACE,)

    try:
        engine(tmp_path, None, type("Bent", (Rod,), {"Twin": broken(RodTwin, "fields", act)}))
    except itouch.SceneError as error:
        assert "device 'arm' failed in its twin's fields: ValueError: not again" in str(error)
    else:
        assert len(calls) < call  # it is not asked so often


COMMANDS = [
    (None, "plugin-failed", "failed in commands: it returned None; a tuple"), ((3,), "plugin-failed", "returned \\(3,\\)"),
    (("nosuch.channel",), "missing-channel", "there is no device 'nosuch'"),
    (("arm.heat",), "missing-channel", "device 'arm' obeys no such channel"),
]  # fmt: skip


@pytest.mark.parametrize(("commands", "code", "why"), COMMANDS, ids=[repr(one[0]) for one in COMMANDS])
def test_commands_that_nobody_obeys_are_a_problem_of_the_scene(
    tmp_path: Path, commands: Any, code: str, why: str
) -> None:
    with pytest.raises(itouch.SceneError, match=f"modality 'hum' .*{why}") as caught:
        engine(tmp_path, broken(Hum, "commands", lambda self, model: commands))
    (problem,) = caught.value.problems
    assert problem.code == code
    assert problem.place is not None and problem.place.line == 9


@dataclass(frozen=True)
class Picky:
    """Nothing, and even that is too much."""

    def __post_init__(self) -> None:
        raise KeyError("absent")


def test_parameters_that_raise_anything_are_a_problem_of_the_scene(tmp_path: Path) -> None:
    for modality, device, what, line in (
        (None, type("Bent", (Rod,), {"Twin": RodTwin, "Params": Picky}), "device 'arm'", 4),
        (type("Bent", (Hum,), {"Params": Picky}), None, "<tone:hum>", 9),
    ):
        with pytest.raises(itouch.SceneError, match=f"{what} failed in its parameters: KeyError: 'absent'") as caught:
            engine(tmp_path, modality, device)
        assert [one.place.line for one in caught.value.problems if one.place] == [line]


def test_a_channel_of_a_standard_name_has_its_size(tmp_path: Path) -> None:
    flat = Channel("wrench", 3, "N", (-1.0,) * 3, (1.0,) * 3, safe=(0.0,) * 3, role=Role.FORCE_ON_OPERATOR)
    with pytest.raises(itouch.SceneError, match="channel 'wrench' of 3 numbers; a .* has 6"):
        engine(tmp_path, None, type("Flat", (Rod,), {"Twin": RodTwin, "commands": (flat,)}))


def test_an_error_without_words_is_told_by_its_kind() -> None:
    assert error_text(ValueError()) == "ValueError"
    assert error_text(ValueError("one\ntwo")) == "ValueError: one"
    assert Contact.BEGIN.name == "BEGIN"


def refused(tmp_path: Path, modality: Any, device: Any) -> str:
    """Return the sentence of the one problem of a scene, which must stand at the plugin's place."""
    with pytest.raises(itouch.SceneError) as caught:
        engine(tmp_path, modality, device)
    (problem,) = caught.value.problems
    assert problem.code == "plugin-failed"
    assert problem.place is not None and problem.place.line == (4 if modality is None else 9)
    return problem.sentence


#: Method of a device class -> an answer that cannot be used, and what is said of it.
ANSWERS: list[tuple[str, Any, str]] = [
    ("motion_duration", np.nan, "it returned nan; a time in seconds"),
    ("motion_duration", np.inf, "it returned inf; a time in seconds"),
    ("motion_duration", None, "it returned None; a time in seconds"),
    ("surface_half_extents", (0.02,), "two half extents"),
    ("surface_half_extents", 0.02, "two half extents"),
    ("exchange_time_for", "3 ms", "it returned '3 ms'; a time in seconds"),
    ("watchdog_for", np.nan, "it returned nan; the seconds after which it makes itself safe"),
    ("watchdog_for", np.inf, "it returned inf; the seconds after which it makes itself safe"),
    ("watchdog_for", -1.0, "it returned -1.0; the seconds after which it makes itself safe"),
    ("watchdog_for", "0.1 s", "it returned '0.1 s'; the seconds after which it makes itself safe"),
    ("bind", None, "it returned None; what driver and twin are made from"),
    ("channels", ((pose(),), wrench(force=2.0)), "each a tuple of Channel"),
    ("channels", None, "it returned None; (reads, commands)"),
]


@pytest.mark.parametrize(("method", "answer", "why"), ANSWERS, ids=[f"{one[0]}={one[1]!r:.12}" for one in ANSWERS])
def test_what_a_device_class_answers_is_a_problem_of_the_scene_if_it_can_not_be_used(
    tmp_path: Path, method: str, answer: Any, why: str
) -> None:
    device = type("Odd", (Rod,), {"Twin": RodTwin, method: classmethod(lambda cls, *rest: answer)})
    told = refused(tmp_path, None, device)
    assert why in told
    assert "(test_plugin_fault_isolation.py, line " in told


@pytest.mark.parametrize(
    "method", ["motion_duration", "surface_half_extents", "exchange_time_for", "watchdog_for", "second_opener_for"]
)
def test_a_device_class_that_fails_when_it_is_asked_is_a_problem_of_the_scene(tmp_path: Path, method: str) -> None:
    def act(cls: Any, *rest: Any) -> None:
        raise SystemExit(7)

    told = refused(tmp_path, None, type("Odd", (Rod,), {"Twin": RodTwin, method: classmethod(act)}))
    assert "SystemExit: 7 (test_plugin_fault_isolation.py, line " in told


@pytest.mark.parametrize(
    "declared",
    [{"watchdog": np.nan}, {"watchdog": "0.1"}, {"period": -1e-3}, {"delay": np.nan}, {"command_wait": "no"}],
    ids=repr,
)
def test_a_time_of_a_device_class_that_is_none_is_a_problem_of_the_scene(tmp_path: Path, declared: Any) -> None:
    told = refused(tmp_path, None, type("Odd", (Rod,), {"Twin": RodTwin, "timing": Timing(**declared)}))
    (name,) = declared
    assert f"its {name} is {declared[name]!r}; " in told


def test_wires_of_hardware_in_one_text_are_not_taken_for_its_letters(tmp_path: Path) -> None:
    device = type("Odd", (Rod,), {"wires": classmethod(lambda cls, params: "COM3"), "watchdog": 0.1})
    text = SCENE.replace('plugin="{plugin}"', 'plugin="{plugin}" twin="no"')
    assert "it returned 'COM3'; a tuple of texts" in refused_text(tmp_path, text, device)


def refused_text(tmp_path: Path, text: str, device: type[Device]) -> str:
    path = tmp_path / "scene.xml"
    path.write_text(text.format(plugin="rod", force='force-to="arm"', modality=""), encoding="utf-8")

    def finder(group: str) -> dict[str, Found]:
        found = dict(find(group))
        if group == "itouch.devices":
            found["rod"] = Found("rod", "itouch-tone", "1.0", Entry(device))  # type: ignore[arg-type]
        return found

    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(path, catalog=Catalog(finder))
    return str(caught.value)


@pytest.mark.parametrize(
    ("method", "answer", "why"),
    [
        ("notices", "careful", "it returned 'careful'; a tuple of sentences"), ("notices", None, "a tuple of sentences"),
        ("reads", "arm.pose", "it returned 'arm.pose'; a tuple of texts"), ("reads", (3,), "a tuple of texts"),
        ("bound_update", 3.0, "it returned 3.0; a Bound"), ("bound_update", (None,), "a Bound, a tuple of them"),
        ("bound_contact", "later", "it returned 'later'; a Bound"),
    ],
)  # fmt: skip
def test_what_a_modality_answers_is_a_problem_of_the_scene_if_it_can_not_be_used(
    tmp_path: Path, method: str, answer: Any, why: str
) -> None:
    told = refused(tmp_path, broken(Hum, method, lambda self, *rest: answer), None)
    assert why in told
    assert "(test_plugin_fault_isolation.py, line " in told


@pytest.mark.parametrize("method", ["notices", "reads"])
def test_a_modality_that_fails_when_it_is_asked_is_a_problem_of_the_scene(tmp_path: Path, method: str) -> None:
    def act(self: Any, *rest: Any) -> None:
        raise SystemExit(7)

    told = refused(tmp_path, broken(Hum, method, act), None)
    assert f"failed in {method}: SystemExit: 7 (test_plugin_fault_isolation.py, line " in told


@pytest.mark.parametrize("method", ["bound_step", "bound_read"])
@pytest.mark.parametrize("fault", ["", '<fault device="arm" kind="freeze" at="9 s"/>'], ids=["as it is", "faulty"])
def test_a_compiled_form_of_a_twin_that_is_none_is_a_problem_of_the_scene(
    tmp_path: Path, method: str, fault: str
) -> None:
    device = type("Odd", (Rod,), {"Twin": broken(RodTwin, method, lambda self, *rest: 3.0)})
    text = SCENE.replace("</itouch>", f"{fault}</itouch>")
    told = refused_text(tmp_path, text, device)
    assert "it returned 3.0; a Bound or None is wanted (test_plugin_fault_isolation.py, line " in told


@pytest.mark.parametrize(
    ("act", "why"),
    [
        (lambda: 3.0, "returned a value of type float; words are wanted (test_plugin_fault_isolation.py, line "),
        (lambda: exit(5), "failed in {}: SystemExit: 5 (test_plugin_fault_isolation.py, line "),
    ],
    ids=["number", "exits"],
)
def test_words_that_fail_are_told_in_their_place(tmp_path: Path, act: Callable[[], Any], why: str) -> None:
    own = {method: (lambda self, model, of: act()) for method in ("contact_summary", "contact_warnings", "status")}
    session = engine(tmp_path, type("Odd", (Hum,), own))
    (one,) = session.model.modalities
    entry: dict[str, Any] = {"probe": "finger", "object": "block"}
    said_by = {
        "contact_summary": contact_report.contact_summary(one, entry), "contact_warnings": " ".join(contact_report.contact_warnings(one, entry)),
        "status": contact_report.status(one, session.state),
    }  # fmt: skip
    for method, words in said_by.items():
        assert words.startswith("hum") and why.format(method) in words


def test_nothing_and_one_text_are_words_too(tmp_path: Path) -> None:
    own = {
        "contact_summary": lambda *rest: None,
        "contact_warnings": lambda *rest: "it was soft",
        "status": lambda *rest: "",
    }
    (one,) = engine(tmp_path, type("Terse", (Hum,), own)).model.modalities
    assert (contact_report.contact_summary(one, {}), contact_report.contact_warnings(one, {})) == ("", ("it was soft",))


@kernel
def counted(count: Any) -> int:
    """Count."""
    count[0] += 1
    return 0


def uncompiled(count: Any) -> int:
    """Do nothing, in Python."""
    return 0


@pytest.mark.skipif(not can_join(), reason=meant("kernels run as Python here"))
@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda view: Bound(uncompiled, view), "'uncompiled' is bound, which is not compiled: write @kernel above it"),
        (lambda view: Bound(3, view), "'3' is bound, which is not compiled"),
        (lambda view: Bound(counted, np.zeros((4, 4))[:, 0]), "an array that is bound must be contiguous"),
        (lambda view: Bound(counted, np.zeros(1, ">f8")), "an array of >f8 has its bytes in the other order"),
        (lambda view: Bound(counted, [1.0]), "'counted' can't be called with what is bound to it"),
        (lambda view: Bound(counted, view, view), "'counted' can't be compiled for what is bound to it"),
    ],
    ids=["python", "number", "column", "order", "list", "too many"],
)
def test_a_call_that_can_not_be_joined_is_a_problem_of_the_scene(tmp_path: Path, make: Any, why: str) -> None:
    modality = broken(Hum, "bound_update", lambda self, model, state, period: make(state["hum.count"]))
    told = refused(tmp_path, modality, None)
    assert why in told
    assert "failed in bound_update: its call cannot be joined: " in told
    assert "(test_plugin_fault_isolation.py, line " in told


DECLARED = [
    ("subscribes_to", Contact.BEGIN), ("subscribes_to", frozenset({"begin"})), ("measured", Measured("a", "1", "a figure")),
    ("persistent_fields", "count"), ("removed_fields", "count"), ("probe_attributes", "clearance"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value"), DECLARED, ids=[f"{one[0]}={one[1]!r:.12}" for one in DECLARED])
def test_an_attribute_of_a_modality_that_is_not_what_it_must_be_is_told_with_what_to_write(
    tmp_path: Path, name: str, value: Any
) -> None:
    with pytest.raises(itouch.SceneError, match=f"class 'Odd' declares {name} = .*: write {name} = "):
        engine(tmp_path, type("Odd", (Hum,), {name: value}))


def test_a_twin_that_is_none_is_told_with_what_to_write(tmp_path: Path) -> None:
    for twin in (int, RodTwin(None)):
        with pytest.raises(itouch.SceneError, match="class 'Odd' declares Twin = .*: write the name of a subclass"):
            engine(tmp_path, None, type("Odd", (Rod,), {"Twin": twin}))


@pytest.mark.parametrize("name", ["max_stiffness", "damping"])
@pytest.mark.parametrize("value", [np.nan, -1.0, "500 N/m"])
def test_mechanics_that_are_no_numbers_are_a_problem_of_the_scene(tmp_path: Path, name: str, value: Any) -> None:
    told = refused(tmp_path, None, type("Odd", (Rod,), {"Twin": RodTwin, "mechanics": Mechanics(**{name: value})}))
    assert f"its {name} is {value!r}; a number is wanted" in told


def test_two_commands_of_one_name_are_a_problem_of_the_scene(tmp_path: Path) -> None:
    twice = (wrench(force=2.0), wrench(force=2.0))
    assert "has two commands named 'wrench'" in refused(
        tmp_path, None, type("Odd", (Rod,), {"Twin": RodTwin, "commands": twice})
    )


@pytest.mark.parametrize("kind", ["O", "U5", "c16", "M8[s]", [("a", "f8"), ("b", "O")]], ids=str)
def test_fields_without_numbers_are_a_problem_of_the_scene(tmp_path: Path, kind: Any) -> None:
    told = refused(tmp_path, broken(Hum, "fields", lambda self, model: (Field("f", kind, 1),)), None)
    assert "field 'f' of type " in told and "has no numbers" in told


@pytest.mark.parametrize("name", ["reads", "commands"])
@pytest.mark.parametrize("value", [pose(), ("pose",)], ids=["no comma", "text"])
def test_channels_that_are_none_are_told_when_the_class_is_defined(name: str, value: Any) -> None:
    with pytest.raises(TypeError, match=rf"device class Odd: {name} = .*: write {name} = \(Channel\(...\),\)"):
        type("Odd", (Rod,), {name: value})


@pytest.mark.parametrize("error", [RuntimeError("no socket"), SystemExit(5)], ids=repr)
def test_a_driver_that_can_not_be_made_is_a_problem_of_the_scene(tmp_path: Path, error: BaseException) -> None:
    def act(self: Any, params: Any) -> None:
        raise error

    device = type("Odd", (Rod,), {"__init__": act, "watchdog": 0.1})
    text = SCENE.replace('plugin="{plugin}"', 'plugin="{plugin}" twin="no"')
    told = refused_text(tmp_path, text, device)
    assert f"device 'arm' failed in the making of its driver: {type(error).__name__}: " in told
    assert "(test_plugin_fault_isolation.py, line " in told
