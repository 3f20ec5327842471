"""Devices of strangers: supervised by what they declare, whatever they call it; refused where nothing would watch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import itouch
from itouch.plugin import (
    Channel,
    Device,
    DeviceError,
    Field,
    Monitor,
    Record,
    Role,
    Rule,
    Twin,
    TwinInputs,
    current,
    temperature,
    temperature_target,
)
from itouch.plugin.discovery import Catalog, Found
from itouch.schema import SceneError
from itouch_tools.cli.check import main as check
from itouch_tools.report.limits_in_words import limit_rows
from itouch_tools.report.safety.rules import rules

K0, ROOM = 273.15, 296.15
ABSOLUTE = (281.15, 318.15)


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Entry:
    """An entry point that a test makes."""

    def __init__(self, value: Any) -> None:
        self.loaded, self.value = value, "a test's"

    def load(self) -> Any:
        return self.loaded


def catalog(devices: dict[str, Any], monitors: dict[str, Any] | None = None) -> Catalog:
    groups = {"itouch.devices": devices, "itouch.monitors": monitors or {}}
    return Catalog(lambda group: {n: Found(n, "t", "1", Entry(v)) for n, v in groups.get(group, {}).items()})  # type: ignore[arg-type]


class Plate(Twin):
    """A Peltier plate of 20 J/K, 30 W at full current, and 0.1 W/K to the room; what its sensor says can be wrong."""

    channel: ClassVar[str] = ""
    command: ClassVar[str] = ""
    wrong: ClassVar[str] = ""

    def fields(self) -> tuple[Field, ...]:
        return (Field("true"), Field("ticks", "i8"))

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        state["true"] = ROOM

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        true, drive = state["true"].item(), command[self.command].item()
        if drive > 100.0:  # a target, held by its own control
            power = max(-30.0, min(30.0, 20.0 * (drive - true)))
        else:
            power = -12.0 * drive
        state["true"] = true + (power - 0.1 * (true - ROOM)) * period / 20.0
        state["ticks"] += 1

    def read(self, state: Record, reading: Record) -> bool | None:
        true, tick = state["true"].item(), state["ticks"].item()
        said = true + 1e-4 * (tick % 5)
        if self.wrong == "reversed":
            said = 2.0 * ROOM - said
        elif self.wrong == "frozen" and tick > 200:
            said = ROOM
        elif self.wrong == "spiky" and tick % 97 == 96:
            said += 25.0
        elif self.wrong == "degC":
            said -= K0
        if self.channel:
            reading[self.channel] = said
        return True


def plate(reads: str, obeys: str, *, target: bool = False, wrong: str = "", limit: float = 2.5) -> Any:
    """Return the class of a plate with these names; without a name of its reading it has none."""
    command = temperature_target(obeys, low=250.0, high=400.0) if target else current(obeys, limit=limit)
    seen = (temperature(reads, Role.SKIN_CONTACT_TEMPERATURE),) if reads else (Channel("hum", 1, "1", doc="a hum"),)
    twin = type("Inner", (Plate,), {"channel": reads, "command": obeys, "wrong": wrong})

    class Stranger(Device):
        """A plate of a stranger."""

        Params = Nothing
        reads: ClassVar[tuple[Channel, ...]] = seen
        commands: ClassVar[tuple[Channel, ...]] = (command,)
        Twin = twin
        watchdog: ClassVar[float | None] = 0.5

        def open(self) -> None: ...
        def close(self) -> None: ...
        def read(self, reading: Record) -> bool | None: ...

    return Stranger


def scene(folder: Path, *names: str, plugin: str = "stranger", twin: str = "yes", more: str = "") -> Path:
    devices = "".join(f'<device name="{name}" plugin="{plugin}" twin="{twin}"/>' for name in names)
    (folder / "scene.xml").write_text(f'<itouch version="1.0"><devices>{devices}</devices>{more}</itouch>\n', "utf-8")
    return folder / "scene.xml"


def driven(session: itouch.Session, drives: dict[str, float], seconds: float) -> tuple[list[float], str]:
    """Drive for a time, as a modality would; return the extremes of the true temperatures, and the fault."""
    true = [session.state[f"{name.split('.')[0]}.twin.true"] for name in drives]
    seen = [ROOM, ROOM]

    def note(tick: int) -> None:
        for name, value in drives.items():
            device, channel = name.split(".")
            session.state[f"{device}.command.{channel}"] = value
        seen[0], seen[1] = min(seen[0], *(t.item() for t in true)), max(seen[1], *(t.item() for t in true))

    session.taps.append(note)
    try:
        session.run(seconds)
    except (itouch.DeviceFaultError, DeviceError) as fault:
        return seen, str(fault)
    return seen, ""


WORD = st.text("abcdefghijklmnopqrstuvwxyz", min_size=3, max_size=9)


@settings(max_examples=4, deadline=None)
@given(WORD, WORD, WORD, st.booleans())
def test_a_plate_of_any_name_at_full_current_for_a_minute(
    device: str, reads: str, obeys: str, heats: bool
) -> None:  # fmt: skip
    import tempfile

    if len({device, reads, obeys}) < 3:
        return
    with tempfile.TemporaryDirectory() as folder:
        session = itouch.build(scene(Path(folder), device), catalog=catalog({"stranger": plate(reads, obeys)}))
    seen, fault = driven(session, {f"{device}.{obeys}": -2.5 if heats else 2.5}, 60.0)
    assert ABSOLUTE[0] < seen[0] <= seen[1] < ABSOLUTE[1]
    agree(session, fault)


def agree(session: itouch.Session, fault: str) -> None:
    """Check that what `check` and the safety report say is the same, and that a fault quotes it."""
    model = session.model
    checked = [(row.name, row.source) for one in model.devices.values() for row in limit_rows(one)]
    reported = [(f"{r.number} {r.quantity}".lstrip(), r.source) for r in rules(model) if r.device != "all"]
    assert checked == reported
    assert {name.split(" ")[0] for name, _ in checked} >= {"T1", "T2", "T3", "T5", "T8"}
    if fault:
        quoted = fault[fault.rindex(" (") + 2 : fault.rindex(")")]
        name, _, trip = quoted.rpartition(": trips at ")
        assert name in dict(checked), fault
        assert any(rule.trip == trip for rule in rules(model)), fault


@pytest.mark.parametrize("target", [310.0, 353.15, 253.15])
def test_a_device_that_holds_a_temperature_is_supervised_too(tmp_path: Path, target: float) -> None:
    cls = plate("warmth", "goal", target=True)
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": cls}))
    seen, fault = driven(session, {"pad.goal": target}, 20.0)
    assert ABSOLUTE[0] < seen[0] <= seen[1] < ABSOLUTE[1]
    agree(session, fault)


@pytest.mark.parametrize("wrong", ["reversed", "frozen", "spiky", "degC"])
@pytest.mark.parametrize("drive", [-2.5, 2.5])
def test_a_sensor_that_is_wrong_is_noticed_in_time(tmp_path: Path, wrong: str, drive: float) -> None:
    cls = plate("t", "i", wrong=wrong)
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": cls}))
    seen, fault = driven(session, {"pad.i": drive}, 20.0)
    assert fault
    assert ABSOLUTE[0] < seen[0] <= seen[1] < ABSOLUTE[1]
    agree(session, fault)


def test_two_plates_on_one_finger_share_its_dose(tmp_path: Path) -> None:
    cls = plate("t", "i")
    path = scene(tmp_path, "left", "right", more='<safety dose="4 s"/>')
    session = itouch.build(path, catalog=catalog({"stranger": cls}))
    session.state["left.heat.dose"] = 2.1
    session.state["right.heat.dose"] = 1.89
    for name in ("left", "right"):
        session.state[f"{name}.twin.true"] = K0 + 39.8
    _, fault = driven(session, {"left.i": -0.1, "right.i": -0.1}, 20.0)
    assert "with others on the same finger, a thermal dose of 0.07 CEM43" in fault
    with pytest.raises(itouch.DeviceError, match="with others on the same finger"):
        session.rearm()


def test_a_plate_without_a_reading_is_refused_as_hardware_and_told_as_a_twin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    found = catalog({"stranger": plate("", "i")})
    with pytest.raises(SceneError) as caught:
        itouch.build(scene(tmp_path, "pad", twin="no"), catalog=found)
    (problem,) = [one for one in caught.value.problems if one.code == "unmonitored-drive"]
    assert "command 'i' [A], a drive, is unmonitored" in problem.sentence
    assert "temperature(NAME, Role.SKIN_CONTACT_TEMPERATURE)" in problem.advice
    session = itouch.build(scene(tmp_path, "pad"), catalog=found)
    assert any("is unmonitored" in notice for notice in session.notices)
    monkeypatch.setattr("itouch.plugin.discovery.find", lambda group: {})
    monkeypatch.setattr("itouch.plugin.discovery.Catalog", lambda: found)
    assert check([str(scene(tmp_path, "pad"))]) == 0
    assert "warning[unmonitored-drive]" in capsys.readouterr().err


def with_commands(*commands: Channel, reads: tuple[Channel, ...] = ()) -> Any:
    return type("Other", (plate("t", "i"),), {"commands": commands, "reads": reads, "Twin": None})


def problems(folder: Path, cls: Any, twin: str, monitors: dict[str, Any] | None = None) -> dict[str, str]:
    try:
        itouch.build(scene(folder, "it", twin=twin), catalog=catalog({"stranger": cls}, monitors))
    except SceneError as error:
        return {one.code: one.severity for one in error.problems}
    return {}


@pytest.mark.parametrize("role", [Role.DRIVE, Role.PRESSURE, Role.ELECTRODE, Role.ULTRASOUND, Role.TEMPERATURE_TARGET])
def test_a_drive_that_can_hurt_needs_a_monitor(tmp_path: Path, role: Role) -> None:
    drive = Channel("x", 1, "K" if role is Role.TEMPERATURE_TARGET else "V", (0.0,), (1.0,), safe=(0.0,), role=role)
    assert problems(tmp_path, with_commands(drive), "no") == {"unmonitored-drive": "error"}
    assert problems(tmp_path, with_commands(drive), "yes") == {}


def test_a_command_in_amperes_must_say_what_it_is_for(tmp_path: Path) -> None:
    for unit in ("A", "V", "W", "K", "N", "Pa"):
        drive = Channel("x", 1, unit, (0.0,), (1.0,), safe=(0.0,))
        assert problems(tmp_path, with_commands(drive), "yes") == {"missing-role": "error"}
    assert problems(tmp_path, with_commands(Channel("x", 1, "m/s^2", safe=(0.0,))), "yes") == {}


def test_harmless_silences_the_error_is_printed_and_has_its_limits(tmp_path: Path) -> None:
    why = "it shakes a coil of 2 g by 0.1 mm"
    coil = Channel("x", 1, "V", (-1.0,), (1.0,), safe=(0.0,), role=Role.DRIVE, harmless=why)
    cls = with_commands(coil)
    assert problems(tmp_path, cls, "no") == {}
    session = itouch.build(scene(tmp_path, "it"), catalog=catalog({"stranger": cls}))
    assert any(why in row.value for row in limit_rows(session.model.devices["it"]))
    assert any(why in rule.limit for rule in rules(session.model))
    electrode = Channel("x", 1, "A", (-1.0,), (1.0,), safe=(0.0,), role=Role.ELECTRODE, harmless=why)
    assert problems(tmp_path, with_commands(electrode), "yes") == {"harmless-refused": "error"}


class Charge(Monitor):
    """Charge through the skin: at most 1 C."""

    name = "charge"
    trips: ClassVar[dict[int, str]] = {1: "charge"}
    returns: ClassVar[Any] = None

    @classmethod
    def of(cls, device: Any) -> Iterator[Monitor]:
        if device.command(Role.ELECTRODE) is not None:
            yield cls(device)

    @property
    def watches(self) -> tuple[str, ...]:
        return ("x",)

    def fields(self) -> tuple[Field, ...]:
        return (Field("coulomb", unit="A*s", doc="charge so far"),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Any) -> float:
        if self.returns is not None:
            found = self.returns
            return found() if callable(found) else found
        state["coulomb"] += abs(sent["x"].item()) * moment.seconds
        return -1.0 if state["coulomb"].item() > 1.0 else 1.0

    def sentence(self, code: int, state: Record, reading: Record, moment: Any) -> str:
        return f"has given {state['coulomb'].item():.2f} C"

    def rule(self, code: int, reading: Record) -> str:
        return "charge of a session"

    def rules(self) -> tuple[Rule, ...]:
        return (Rule("", "charge of a session", trip="1 C"),)


ELECTRODE = Channel("x", 1, "A", (-1.0,), (1.0,), safe=(0.0,), role=Role.ELECTRODE)
PULSE = (Channel("hum", 1, "1", doc="a hum"),)


def with_monitor(folder: Path, returns: Any = None) -> itouch.Session:
    cls, monitor = with_commands(ELECTRODE, reads=PULSE), type("Mine", (Charge,), {"returns": returns})
    return itouch.build(scene(folder, "it"), catalog=catalog({"stranger": cls}, {"mine": monitor}))


def test_a_monitor_of_a_plugin_watches_its_drive(tmp_path: Path) -> None:
    monitors = {"mine": Charge}
    assert problems(tmp_path, with_commands(ELECTRODE, reads=PULSE), "no", monitors) == {}
    session = with_monitor(tmp_path)
    with pytest.raises(itouch.DeviceFaultError) as caught:
        session.run(3.0, each=lambda: session.state["it.command.x"].fill(0.5))
    assert 2.0 < session.seconds < 2.05
    assert str(caught.value).startswith("device 'it' has given 1.00 C (charge of a session: trips at 1 C)")
    assert session.report()["faults"][0]["trip"] == "monitor"


@pytest.mark.parametrize(
    "returns",
    [1.5, -7.0, float("nan"), -0.5, staticmethod(lambda: 1 / 0), "much"],
    ids=["1.5", "-7", "nan", "-0.5", "error", "word"],
)
def test_a_monitor_that_errs_or_loosens_stops_the_device(tmp_path: Path, returns: Any) -> None:
    session = with_monitor(tmp_path, returns)
    with pytest.raises((itouch.DeviceFaultError, DeviceError), match="was stopped because its monitor 'charge'"):
        session.run(0.1)
    assert session.state["it.sent.x"].item() == 0.0


def test_the_smallest_share_counts(tmp_path: Path) -> None:
    session = with_monitor(tmp_path, 0.25)
    session.run(0.02, each=lambda: session.state["it.command.x"].fill(0.9))
    assert session.state["it.sent.x"].item() == pytest.approx(0.25)


def test_a_monitor_that_cannot_be_loaded_keeps_hardware_back(tmp_path: Path) -> None:
    cls = plate("t", "i")
    assert problems(tmp_path, cls, "no", {"broken": 7}) == {"monitor-failed": "error"}
    assert problems(tmp_path, cls, "yes", {"broken": 7}) == {}
