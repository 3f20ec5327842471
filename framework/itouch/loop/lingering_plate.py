"""The notice of a plate that was still felt after the contact in which it was pressed had ended, from State."""

from __future__ import annotations

from itouch.loop.happening import SEPARATION_TIME
from itouch.plugin import Record
from itouch.world import Model


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
                "virtual surface was gone sooner than a plate that is pressed lets go without a step; what it gave or "
                "took after the end is in no contact's figures"
            )
    return tuple(found)
