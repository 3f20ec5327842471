"""Supervision at its edges: what it prints word for word, what it knows before it knows anything, and exact limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from small_devices import ARM, LIMITS, PERIOD, PLATE, TABLE, FakeTwin, model, record, state

from itouch.monitors import Heat, Readings, Surface, heat_kernels, history_kernels, own_monitors, surface_kernels
from itouch.monitors.heat import History
from itouch.monitors.surface_kernels import SurfaceObservation, pace
from itouch.monitors.thresholds import READINGS
from itouch.plugin import Channel, Record
from itouch.safety import Finger, Gate
from itouch.world.supervision import watched

#: What is printed of each: number, quantity, limit, trip, never.
SAID = {
    "arm": """T8 plausibility of its readings||not a number, 2 m from the device's origin, faster than it can move, outside its range|
K1 force on the finger|3 N||8 N
K1 force of all that pushes on one finger|3 N||
K2 speed of the finger|forces fade above 0.8 m/s|1.2 m/s|
K3 increase of force|1000 N/s||
W1 age of its reading||20 ms|""",
    "table": """T8 plausibility of its readings||not a number, 2 m from the device's origin, faster than it can move, outside its range|
T4 time in contact, less the time out of it|withdraws after 10 s|60 s|120 s
K4 force of the surface on the finger, in all directions|yields above 2 N|5 N|10 N
K5 speed towards a finger nearer than 20 mm, or past one that touches|0.1 m/s|0.15 m/s|
K5 speed otherwise|0.25 m/s|0.3 m/s|
K6 distance from its command|approach stops at 3 mm|5 mm for 100 ms|
T8 force without a finger||0.5 N with the finger 4 mm away for 0.1 s|
K6 travel|-100..100 × -100..100 × 0..60 mm||""",
    "plate": """T1 plate temperature, high|40 °C|42 °C|45 °C
T2 plate temperature, low|15 °C|12 °C|8 °C
T5 rate of plate temperature in contact, mean of 0.5 s|10 K/s|20 K/s|
T6 heat flux, mean of 1 s|15 kW/m²|20 kW/m²|
T7 heat sink|50 °C|55 °C|60 °C
W1 age of its reading||20 ms|""",
}
CHANNELS = {"arm": ARM, "table": TABLE, "plate": PLATE}


@pytest.mark.parametrize("what", SAID)
def test_what_is_printed_of_a_device(what: str) -> None:
    device = watched("it", "fake", None, CHANNELS[what], LIMITS, twin=False)
    rules = [rule for monitor in own_monitors(device) for rule in monitor.rules()]
    said = [f"{r.number} {r.quantity}|{r.limit}|{r.trip}|{r.absolute}" for r in rules]
    assert [line for line in SAID[what].splitlines() if line not in said] == [], said


@pytest.mark.parametrize(
    ("low", "high", "said"), [((), (), False), ((0.0,), (math.inf,), True), ((-math.inf,), (9.0,), True)]
)
def test_a_range_is_printed_where_there_is_one(low: tuple[float, ...], high: tuple[float, ...], said: bool) -> None:
    channel = Channel("hum", 1, "1", low, high, doc="a hum")
    (readings,) = Readings.of(watched("it", "fake", None, ((channel,), ()), LIMITS, twin=False))
    (rule,) = readings.rules()
    assert ("outside its range" in rule.trip) is said


def test_exactly_at_its_trip_a_rate_is_let_pass() -> None:
    (heat,) = Heat.of(watched("it", "fake", None, PLATE, LIMITS, twin=False))
    memory = Record.of(heat.fields())
    heat.reset(memory)
    for step in range(201):  # 16 K/s for a second: 8 K in each half
        history_kernels.add(heat.memory(memory).past, 0.005 * step, 296.0 + 0.08 * step, 0.0)
    memory["since"] = 0.0
    kelvin, kept = 296.0 + 0.08 * 200, heat.memory(memory)
    rate = abs(kelvin - history_kernels.value_at(kept.past, 0.5, 2)) / 0.5
    allowed = heat.allowed._replace(rate=rate / 2.0)
    assert (
        heat_kernels.near_rate(allowed, kept, kelvin, True) == 0.0
    )  # nothing is left of the drive, and it does not trip
    allowed = heat.allowed._replace(rate=rate / 2.0 * (1.0 - 1e-9))
    assert heat_kernels.near_rate(allowed, kept, kelvin, True) < 0.0


def memory_of(monitor: Surface | Readings | Heat) -> Record:
    found = Record.of(monitor.fields())
    monitor.reset(found)
    return found


def of(kind: type, channels: object) -> Surface:
    (found,) = kind.of(watched("it", "fake", None, channels, LIMITS, twin=False))
    return found  # type: ignore[no-any-return]


def test_the_first_look_at_the_clock_of_contact_adds_nothing() -> None:
    surface = of(Surface, TABLE)
    memory = memory_of(surface)
    assert surface.count(memory, 7.0, touched=True) == 1.0
    assert memory["contact_time"].item() == 0.0
    assert surface.count(memory, 7.005, touched=True) == 1.0  # not its turn
    assert memory["contact_time"].item() == 0.0
    assert surface.count(memory, 7.5, touched=True) == 1.0
    assert memory["contact_time"].item() == pytest.approx(0.5)


def test_a_force_that_is_doubted_for_a_moment_leaves_no_doubt() -> None:
    surface = of(Surface, TABLE)
    memory = memory_of(surface)
    memory["doubted"] = 0.07
    near = SurfaceObservation(0.0, 0.0, 0.0, 0.0, 0.001, True)
    assert surface_kernels.doubt(surface.allowed, surface.memory(memory), 2.0, 0.01, near) == 0.0
    assert memory["doubted"].item() == 0.0


@pytest.mark.parametrize(("pause", "places"), [(0.19, 4), (0.21, 1)])
def test_places_from_before_a_pause_are_forgotten(pause: float, places: int) -> None:
    surface = of(Surface, TABLE)
    memory = memory_of(surface)
    for time in (0.0, 0.02, 0.04, 0.04 + pause):
        surface_kernels._before(surface.memory(memory), np.zeros(7), (0.0,) * 3, time)
    assert memory["places"].item() == places


def test_where_a_surface_was_is_known_after_its_ring_is_full() -> None:
    surface = of(Surface, TABLE)
    memory = memory_of(surface)
    for step in range(60):
        pose = np.array([0.001 * step, *(0.0,) * 6])
        row = surface_kernels._before(surface.memory(memory), pose, (0.0,) * 3, 0.02 * step)
    assert row >= 0
    assert memory["track"][row, :2].tolist() == pytest.approx([0.02 * 56, 0.056])


def test_at_its_edge_a_surface_is_not_near_and_not_astray() -> None:
    assert pace(0.020, 0.003, 0.003, 0.020, 0.1, 0.25) == 0.25
    assert pace(0.0199, 0.003, 0.003, 0.020, 0.1, 0.25) == 0.1
    assert pace(0.1, 0.0031, 0.003, 0.020, 0.1, 0.25) == 0.0


def test_a_history_knows_nothing_at_first() -> None:
    history = History((0.05, 0.1, 0.5, 1.0))
    memory = Record.of(history.fields())
    history.clear(memory)
    past = history.past(memory)
    assert history_kernels.newest(past) == 0.0
    assert history_kernels.step(past, 0, 1) == 0.0
    assert history_kernels.mean_flux(past, 3) == 0.0
    assert not history_kernels.before(past, 0)[0]
    history_kernels.add(past, 0.0, 300.0, 0.0)
    assert history_kernels.step(past, 0, 1) == 0.0


def test_a_history_looks_back_through_a_full_ring() -> None:
    history = History((0.05, 0.1, 0.5, 1.0))
    memory = Record.of(history.fields())
    history.clear(memory)
    past = history.past(memory)
    for step in range(2 * READINGS + 7):
        history_kernels.add(past, 0.005 * step, 300.0 + 0.01 * step, 100.0)
    assert history_kernels.before(past, 0) == (True, pytest.approx(300.0 + 0.01 * (2 * READINGS + 6 - 10)))
    assert history_kernels.mean_flux(past, 3) == pytest.approx(100.0)
    assert history_kernels.step(past, 0, 1) == pytest.approx(0.1)


def test_a_reading_at_the_edge_of_sense_can_be_worked_with() -> None:
    readings = of(Readings, PLATE)
    reading = record(PLATE[0])
    for kelvin, usable in ((263.15, True), (353.15, True), (263.14, False), (353.16, False), (math.nan, False)):
        reading["plate_temperature"], reading["sink_temperature"], reading["heat_flux"] = kelvin, 300.0, 0.0
        assert readings.usable(reading) is usable  # type: ignore[attr-defined]


def test_no_monitors_turn_is_before_a_reading_has_come() -> None:
    made = model(PLATE, twin=True)
    supervisor = Gate(made, state(made), PERIOD, twin=FakeTwin())
    supervisor.reset()
    assert supervisor.device_monitors.due[0] < 0
    assert supervisor.device_monitors.share == 1.0


def test_what_is_simple_has_one_of_each_kind() -> None:
    models = [model(kind, name=name, twin=True) for name, kind in
              (("arm", ARM), ("arm2", ARM), ("table", TABLE), ("one", PLATE), ("two", PLATE))]  # fmt: skip
    memory = state(*models)
    arm, arm2, table, one, two = (Gate(made, memory, PERIOD, twin=FakeTwin()) for made in models)
    assert Finger("finger", [arm, table, one]).simple
    assert not Finger("finger", [arm, table, one, two]).simple
    assert not Finger("finger", [arm, arm2, table]).simple
