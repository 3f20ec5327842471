"""Names that State and recordings use themselves: refused at their place, or kept apart, and never a traceback."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

import itouch
from itouch.plugin import Channel, Device, Field, Twin, discovery
from itouch.recording import read
from itouch.schema import SceneError
from itouch.session.replaying import replay
from itouch.world.state import _device, layout


@dataclass(frozen=True, slots=True)
class Nothing:
    """Nothing to choose."""


class RampTwin(Twin):
    """A number that rises."""

    reading: str = ""

    def fields(self):
        """Return the number."""
        return (Field("level", unit="Pa", doc="a level"),)

    def step(self, state, command, touch, period):
        """Rise."""
        state["level"] += period

    def read(self, state, reading):
        """Tell."""
        for name in reading:
            reading[name] = state["level"]
        return True


def ramp(*names: str) -> type[Device]:
    """Return the class of a device with readings of these names."""

    class Ramp(Device):
        """A device with readings of any names."""

        Params, Twin = Nothing, RampTwin
        reads = tuple(Channel(name, 1, "Pa", doc="a level") for name in names)

        def open(self): ...

        def close(self): ...

        def read(self, reading):
            return False

    return Ramp


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def make(device: str, *names: str) -> Path:
        cls = ramp(*names)
        monkeypatch.setattr(discovery.Catalog, "device", lambda self, name: cls)
        (tmp_path / "scene.xml").write_text(
            f'<itouch version="1.0">\n<devices><device name="{device}" plugin="ramp"/></devices>\n</itouch>'
        )
        return tmp_path / "scene.xml"

    return make


def kept(scene) -> set[str]:
    """Return the names without a dot that State keeps of a device beside its channels."""
    session = itouch.build(scene("it", "level"))
    fields = {field.name.removeprefix("it.") for field in _device(session.model.devices["it"], framed=True)}
    session.close()
    return {name for name in fields if "." not in name} - {"level"}


def test_a_reading_with_a_name_that_state_keeps_is_refused(scene) -> None:
    names = kept(scene)
    assert {"age", "sequence", "status", "measured"} <= names
    for name in sorted(names | {"left"}):
        with pytest.raises(SceneError) as caught:
            itouch.build(scene("it", "level", name))
        (problem,) = caught.value.problems
        assert problem.code == "plugin-failed" and f"calls a reading '{name}'" in problem.sentence
        assert problem.place is not None and problem.place.line == 2


def test_two_readings_of_one_name_are_refused(scene) -> None:
    with pytest.raises(SceneError, match="has two readings named 'level'"):
        itouch.build(scene("it", "level", "level"))


@pytest.mark.parametrize("name", ["objects", "events", "marks", "session"])
def test_a_device_with_a_name_that_state_keeps_is_refused(scene, name: str) -> None:
    with pytest.raises(SceneError) as caught:
        itouch.build(scene(name, "level"))
    assert [problem.code for problem in caught.value.problems] == ["duplicate-name"]


def test_no_other_owner_of_state_is_unnamed(scene) -> None:
    session = itouch.build(scene("it", "level"))
    owners = {field.name.split(".")[0] for field in layout(session.model) if "." in field.name}
    session.close()
    assert owners - {"it"} <= {"objects", "events", "marks"}


@pytest.mark.parametrize("name", ["tick", "time", "twin", "command", "out", "heat"])
@pytest.mark.parametrize("device", ["faults", "tick", "ready"])
def test_every_other_name_is_recorded_and_replayed(scene, tmp_path: Path, name: str, device: str) -> None:
    session = itouch.build(scene(device, name, "level"))
    session.record(tmp_path / "run.mcap")
    session.run(0.05)
    session.close()
    recording = read(str(tmp_path / "run.mcap"))
    column = f"{name}_" if name in ("tick", "time") else name
    assert recording[device][column][-1] == pytest.approx(0.05, abs=2e-3)
    found = replay(tmp_path / "run.mcap")
    assert found.compared > 0 and found.mismatches == 0
