"""The safety report of a scene, for an ethics board: limits in force, what trips, the worst case, the tests passed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from itouch.world import Model
from itouch.world import limits as default
from itouch_tools.report.safety.document_blocks import Block, Heading, Items, Paragraph, Table, html, markdown
from itouch_tools.report.safety.rules import K0, rules
from itouch_tools.report.safety.worst import Worst, run

__all__ = ["Tested", "Worst", "document", "html", "markdown", "run"]


class Tested(NamedTuple):
    """An injected fault: its phase, what stopped it, after how long [s] all was safe, and whether the test passed."""

    fault: str
    phase: str
    trip: str
    safe_after: float | None
    good: bool


def document(
    model: Model, worst: Worst | None, fault: str, tested: Sequence[Tested], *, made: str, program: str
) -> Iterator[Block]:
    """Yield the report, block by block.

    Parameters
    ----------
    model
        The compiled scene.
    worst, fault
        The extremes seen while the scene's script ran on the twin, and the fault that ended it ("": none).
    tested
        The faults that were injected, with what came of them.
    made, program
        When the report was made, and by which program.
    """
    yield Heading("Safety report", 1)
    if fault:
        yield Paragraph(
            f"THE SCRIPT TRIPS: {fault}. What the scene asks for can't be given to a person as it is.", "bad"
        )
    yield Paragraph(f"Scene {model.scene.source}. {program}, {made}.")
    yield Paragraph(_SCOPE, "note")
    yield from _rig(model)
    yield from _limits(model)
    yield from _conduct(model)
    yield from _worst_case(model, worst, fault)
    yield from _tests(tested)
    yield Heading("What this does not cover")
    yield Items(_RESIDUAL)


_SCOPE = (
    "itouch-py is not a medical device. The limits are for healthy adults with normal feeling in the hand who touch "
    "with a fingertip and can take it away. All figures of this report come from the simulated twin of the rig, not "
    "from hardware and not from people. The laboratory keeps its own duty of care: inclusion criteria, supervision, "
    "the electrical safety of its apparatus, and a test of the limits on the real apparatus before anybody touches it."
)

_RESIDUAL = (
    "A slow drift of the only sensor of a quantity: the plate's temperature may be wrong by what its sensor is wrong. "
    "Trips stand 3 K (hot) and 4 K (cold) inside the absolute limits for this; calibrate it, or fit a second sensor.",
    "Mechanical failures that no sensor sees, pinching beside the plate, electrical faults of the apparatus.",
    "A device that neither obeys commands nor has a watchdog or an emergency switch of its own.",
    "People with reduced feeling, poor circulation, broken skin, or who are younger than adults.",
    "Twins stand for the devices here; their parameters are in the scene and in the documentation.",
)


def _rig(model: Model) -> Iterator[Block]:
    yield Heading("The rig")
    rows = []
    for device in model.devices.values():
        moves = ", ".join(channel.name.replace("_", " ") for channel in device.commands) or "nothing"
        kind = "simulated twin" if device.twin else "hardware"
        rows.append((device.name, device.plugin, kind, moves, "yes" if device.optional else "no"))
    yield Table(("device", "plugin", "runs as", "commands", "optional"), tuple(rows))


def _limits(model: Model) -> Iterator[Block]:
    yield Heading("Limits in force, and what trips at what")
    yield Paragraph(
        "Every command is limited and every reading checked in each tick of the loop by one supervisor, which alone "
        "writes to devices. A scene can only tighten. Between limit and trip the drive is cut down in proportion; a "
        "trip stops everything and latches. What is not a number stops at once, anywhere."
    )
    header = ("", "device", "quantity", "limit", "trip", "never", "set by")
    yield Table(header, tuple(tuple(rule) for rule in rules(model)))


def _conduct(model: Model) -> Iterator[Block]:
    safety = model.scene.safety
    hardware = any(not device.twin for device in model.devices.values())
    yield Heading("What happens when anything stops")
    yield Items(
        (
            "Forces go to zero and carried surfaces retract, in the same tick.",
            "A carried plate keeps its drive until the finger has left it (under 0.1 N) or 300 ms have passed: cut off "
            "under a finger it would take on the temperature of its heat sink.",
            "Then its drive is cut. The supervisor verifies within 500 ms, by measurement, that each device is safe, "
            "and reports one that is not.",
            "The trip latches. Only an operator's act re-arms, from where the devices stand, with a ramp of "
            f"{default.RAMP:g} s. A thermal dose that is used up is not given back in a session.",
        ),
        numbered=True,
    )
    needed = hardware or safety.hold_to_run
    yield Paragraph(
        "Hold-to-run: " + ("required; letting go retracts in the same tick." if needed else
        "not asked for on twins; hardware always requires it. hold-to-run=\"yes\" asks for it here, too.")
    )  # fmt: skip
    yield Paragraph(f"If the loop falls behind real time: {safety.servo_overrun}.")


def _worst_case(model: Model, worst: Worst | None, fault: str) -> Iterator[Block]:
    yield Heading("The worst that the script does")
    if worst is None or not worst.high:
        yield Paragraph(
            "The scene has no operator twin with a script: its worst case is that of the limits above.", "note"
        )
        return
    yield Paragraph(f"The script was run on the twin for {worst.session.seconds:.1f} s; true values of the plant.")
    if fault:
        yield Paragraph(f"The run ended with a fault: {fault}", "bad")
    else:
        yield Paragraph("No limit tripped.", "good")
    rows = [(name.split(" [")[0], *_extremes(name, worst)) for name in worst.high]
    rows.append(("thermal dose of the skin", "0", f"{worst.dose / 60:.3g} CEM43"))
    rows.append(("longest contact with the plate", "", f"{worst.longest:.2f} s"))
    yield Table(("quantity", "least", "greatest"), tuple(rows))


def _extremes(name: str, worst: Worst) -> tuple[str, str]:
    low, high = worst.low[name], worst.high[name]
    unit = name[name.rindex("[") + 1 : -1]
    if unit == "K":
        return f"{low - K0:.2f} °C", f"{high - K0:.2f} °C"
    return f"{low:.3g} {unit}", f"{high:.3g} {unit}"


def _tests(tested: Sequence[Tested]) -> Iterator[Block]:
    yield Heading("Tests passed by this scene")
    if not tested:
        yield Paragraph("No fault was injected.", "note")
        return
    wrong = [index for index, one in enumerate(tested) if not one.good]
    phases = ", ".join(dict.fromkeys(one.phase for one in tested))
    sentence = (
        f"{len(tested)} faults were injected into the twins ({phases}): in {len(tested) - len(wrong)} of them the true "
        "temperature, force and speed stayed inside the absolute limits, the safe state was reached in time, and the "
        "report named the fault."
    )
    yield Paragraph(sentence, "bad" if wrong else "good")
    rows = tuple(
        (one.fault, one.phase, one.trip or "none: stayed inside the limits",
         "" if one.safe_after is None else f"{one.safe_after * 1e3:.0f} ms", "yes" if one.good else "NO")
        for one in tested
    )  # fmt: skip
    yield Table(("fault", "phase", "stopped by", "safe after", "passed"), rows, frozenset(wrong))
    yield Paragraph(
        "The supervisor's own tests cover every branch of it, and a mutation run shows that they notice changes; the "
        "figures are in the documentation, with the commands that print them."
    )
