"""Notices of plates, from State: one was not where its calibrated height says, or was felt after its contact."""

from __future__ import annotations

from itouch.loop.event_detection import SEPARATION_TIME
from itouch.plugin import Record
from itouch.world import Model


def missed_plates(model: Model, state: Record) -> tuple[str, ...]:
    """Return a sentence for each probe whose plate was not felt where it should be, or was felt where it should not.

    It tells of the first time.
    """
    found = []
    for probe in model.probes:
        name = f"{probe.name}.surface"
        if not probe.scene.surface_to or not state[f"{name}.misses"].item():
            continue
        at, depth, load = (state[f"{name}.{field}"].item() for field in ("missed_at", "missed_depth", "missed_load"))
        plate, finger = f"the plate of '{probe.scene.surface_to}'", f"'{probe.name}'"
        if depth < 0.0:
            what = (
                f"{plate} was felt by {finger} at {at:.3f} s and should not have been: {-depth * 1e3:.1f} mm below it "
                f"by its height, it pressed with {load:.2f} N, and the heat that it gave or took is in no contact's "
                "figures; it stays away now, and the arm gives its force"
            )
        else:
            what = (
                f"{plate} should have been felt by {finger} at {at:.3f} s and was not: {depth * 1e3:.1f} mm deep in it "
                f"by its height, pressed with {load:.2f} N; the arm gives its force"
            )
        found.append(f"{what}; check the height of its mount, or calibrate it by touch-off")
    return tuple(found)


def lingering_plates(model: Model, state: Record) -> tuple[str, ...]:
    """Return a sentence for each probe that felt its plate after the END of a contact, with the longest such time."""
    found = []
    for probe in model.probes:
        name = f"{probe.name}.surface"
        if not probe.scene.surface_to:
            continue
        # END comes in the tick after SEPARATION_TIME, and the plate's force is known a tick late
        after = state[f"{name}.lingered"].item() - SEPARATION_TIME - 2.0 * model.period
        if after > 0.5 * model.period:
            found.append(
                f"'{probe.name}' still felt the plate of '{probe.scene.surface_to}' for {1e3 * after:.0f} ms after a "
                f"contact had ended, until {state[f'{name}.lingered_at'].item():.3f} s (the longest such time): the "
                "virtual surface went away faster than a pressed plate can let go without a step in the force; what it "
                "gave or took after the end is in no contact's figures"
            )
    return tuple(found)
