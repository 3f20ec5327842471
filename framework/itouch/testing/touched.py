"""What a modality says in its fields of a contact that it computes must agree with the contract, in every tick."""

from __future__ import annotations

import numpy as np

from itouch.plugin import Record, Touches
from itouch.safety import DeviceFaultError
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.scenario import ModalitySubject

#: How much deeper than its radius a finger may be in the plane of what it is said to touch [m]: rounding.
_ROUNDING = 1e-9


@check("touches", "what it says of a contact can be so")
def touches(subject: ModalitySubject) -> str:
    """Run the scene, and check in every tick the fields that describe the contact."""
    engine = subject.engine()
    owned = [(one.name, one.touches) for one in subject.own(engine) if one.touches is not None]
    if not owned:
        raise NotApplicableError("it computes no contact")
    touched = 0
    for _ in range(round(subject.seconds / engine.model.period)):
        try:
            engine.tick()
        except DeviceFaultError as fault:  # what can't be is a fault at once
            raise CheckError(fault.cause, cause="not what the contract says of it", advice="write what is so") from None
        for name, said in owned:
            probe = said.probe
            if engine.state[f"{probe}.object"].item() >= 0:
                touched += 1
                _check(name, said, engine.state, engine.seconds)
    told = ", ".join(f"{own}.{name}" for own, said in owned for name in said.said)
    return f"{subject.seconds:.2g} s of {told}, {touched} ticks in contact"


def _check(name: str, said: Touches, state: Record, seconds: float) -> None:
    """Check what is said of a touch against the finger's place.

    Raises
    ------
    CheckError
        If the finger is pushed by what it does not touch, or what it says has the wrong direction.
    """
    probe = said.probe
    force, normal = state[f"{probe}.force"], state[f"{probe}.normal"]
    if force @ normal < 0.0:
        field = said.force or said.found
        seen = f"the force in {name}.{field} pulls the finger in by {-(force @ normal):.3g} N after {seconds:.3f} s"
        raise CheckError(seen, cause="it is cut off", advice="write 0 where the surface would pull")
    away = float(normal @ (state[f"{probe}.proxy"] - state[f"{probe}.hip"]))
    if away < -_ROUNDING and np.isfinite(away):
        seen = f"the proxy is {-away:.3g} m deeper in the object than the finger after {seconds:.3f} s"
        raise CheckError(seen, cause="a proxy stays outside", advice="check the direction of the normal")
