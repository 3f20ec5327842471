"""A replay knows which readings were new: their age comes out as it was, from the first tick to the safe sequence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES
from test_hardware import SCENE, Params, catalog, stick

import itouch
from itouch.plugin import Channel, Device, Field, Record, Timing, Twin, TwinInputs
from itouch.recording import read
from itouch.session.replaying import Replay


@pytest.mark.parametrize("every", [1, 3, 7])
@pytest.mark.parametrize("phase", [0, 1, 2])
def test_ages_of_readings_are_replayed(tmp_path: Path, every: int, phase: int) -> None:
    class Slow(stick()):  # type: ignore[misc]
        """Has something new in one tick of some."""

        def open(self) -> None:
            super().open()
            self.calls = -1

        def read(self, reading: Record) -> bool | None:
            self.calls += 1
            return super().read(reading) if self.calls == 0 or (self.calls + phase) % every == 0 else False

    plugins = catalog(Slow)
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    session = itouch.build(tmp_path / "scene.xml", catalog=plugins)
    session.record(tmp_path / "run.mcap")
    with session:
        session.enable()
        session.run(0.4)
    recording = read(tmp_path / "run.mcap")
    work, ages = Replay(recording, catalog=plugins), []
    work.session.taps.append(lambda tick: ages.append(int(work.session.state["stick.age"])))
    while work.step():
        pass
    outcome = work.outcome()
    assert outcome.mismatches == outcome.skipped == 0 and outcome.ticks == len(recording.ticks)
    assert ages == recording["stick"]["age"].tolist()


class Hasty(Twin):
    """A twin that fills in its reading before anything has come, and says in every fifth tick that it has."""

    def fields(self) -> tuple[Field, ...]:
        return (Field("calls", "i8", unit="1", doc="how often it was read"),)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Do nothing."""

    def read(self, state: Record, reading: Record) -> bool | None:
        reading["pressure"] = np.nan
        state["calls"] += 1
        if state["calls"] % 5 != 1:
            return False
        reading["pressure"] = 1e5 + state["calls"]
        return True


def gauge(timing: Timing, twin: type[Twin] | None = None) -> type[Device]:
    class Gauge(Device):
        """A gauge at the end of a wire."""

        reads = (Channel("pressure", 1, "Pa", low=(0.0,), high=(1e6,), doc="pressure"),)

        def open(self) -> None:
            """Do nothing."""

        def close(self) -> None:
            """Do nothing."""

        def read(self, reading: Record) -> bool | None:
            """Read an atmosphere."""
            reading["pressure"] = 1e5
            return True

    Gauge.timing, Gauge.Twin, Gauge.Params = timing, twin, Params
    return type("Gauge", (Gauge,), {"timing": timing})


def gauged(tmp_path: Path, *faults: str) -> Path:
    text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    text = text.replace("</devices>", '<device name="gauge" plugin="stick"/></devices>')
    (tmp_path / "scene.xml").write_text(text.replace("</itouch>", "".join([*faults, "</itouch>"])), encoding="utf-8")
    return tmp_path / "scene.xml"


def test_nobody_sees_what_a_twin_has_filled_in_without_having_a_reading(tmp_path: Path) -> None:
    seen = []
    with itouch.build(gauged(tmp_path), catalog=catalog(gauge(Timing(), Hasty))) as session:
        session.taps.append(lambda _tick: seen.append(float(session.state["gauge.pressure"][0])))
        session.run(0.1)
        assert int(session.state["gauge.sequence"]) == 21  # with that before the first tick
    assert np.isfinite(seen).all() and len(set(seen)) == 21


@pytest.mark.parametrize("kind", ["nan", "bias"])
def test_a_fault_between_two_readings_of_a_slow_device_is_replayed(kind: str, tmp_path: Path) -> None:
    plugins = catalog(gauge(Timing(blocking=True, period=0.013, delay=0.004)))
    amount = ' channel="pressure" amount="40000"' if kind == "bias" else ""
    scene = gauged(tmp_path, f'<fault device="gauge" kind="{kind}" at="0.201 s" for="30 ms"{amount}/>')
    with itouch.build(scene, catalog=plugins) as session:
        session.record(tmp_path / "run.mcap")
        if kind == "nan":
            with pytest.raises(itouch.DeviceFaultError, match="reads NaN"):
                session.run(0.3)
        else:
            session.run(0.3)
    recording = read(tmp_path / "run.mcap")
    assert set(np.unique(recording["gauge"]["pressure"])) <= {0.0, 4e4}
    work = Replay(recording, catalog=plugins)
    while work.step():
        pass
    assert work.outcome().mismatches == 0 and work.outcome().ticks == len(recording.ticks)
