"""What a modality says in its fields of a surface that it carries, or of a contact, must agree with the contract."""

from __future__ import annotations

import math

import numpy as np

from itouch.plugin import ContactFields, Record, SurfaceFields
from itouch.safety import DeviceFaultError
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.scenario import ModalityHarness

#: How much deeper than its radius a finger may be in the plane of what it is said to touch [m]: rounding.
_ROUNDING = 1e-9


@check("carries", "what it says of its surface can be so")
def carries(harness: ModalityHarness) -> str:
    """Run the scene, and check in every tick the fields that describe its surface."""
    engine = harness.engine()
    owned = [(one.name, one.surface_fields) for one in harness.own(engine) if one.surface_fields is not None]
    if not owned:
        raise NotApplicableError("it carries no surface")
    for _ in range(round(harness.seconds / engine.model.period)):
        engine.tick()
        for name, said in owned:
            wrong = _wrong(name, said, engine.state)
            if wrong is not None:
                field, value, advice = wrong
                seen = f"the field {name}.{field} is {value:g} after {engine.seconds:.3f} s"
                raise CheckError(seen, cause="not what the contract says of it", advice=advice)
    told = ", ".join(name for _, said in owned for name in said.declared)
    return f"{harness.seconds:.2g} s of {told}"


def _wrong(name: str, said: SurfaceFields, state: Record) -> tuple[str, float, str] | None:
    """Return a field with an impossible value, that value and what would be right, or None."""
    value = {field: state[f"{name}.{field}"].item() for field in said.declared}
    for field in (said.renders, said.present):
        if value[field] not in (0.0, 1.0):
            return field, value[field], "write 1 where it is so, else 0"
    if said.fault and value[said.fault] not in (0.0, 1.0, 2.0):
        return said.fault, value[said.fault], "write 0, 1 (not felt where it should be) or 2 (felt below that)"
    if said.fault and value[said.fault] and value[said.renders]:
        return said.renders, value[said.renders], "write 0 as long as it is missed: the contact is the arm's"
    for field, what in (
        (said.remaining_distance, "how far it still has to come"),
        (said.yield_distance, "how far it gives way"),
    ):
        if field and not value[field] < math.inf:
            return field, value[field], f"write {what}, or -1 where that can't be said"
    return None


@check("touches", "what it says of a contact can be so")
def touches(harness: ModalityHarness) -> str:
    """Run the scene, and check in every tick the fields that describe the contact."""
    engine = harness.engine()
    owned = [(one.name, one.contact_fields) for one in harness.own(engine) if one.contact_fields is not None]
    if not owned:
        raise NotApplicableError("it computes no contact")
    touched = 0
    for _ in range(round(harness.seconds / engine.model.period)):
        try:
            engine.tick()
        except DeviceFaultError as fault:  # what can't be is a fault at once
            raise CheckError(fault.cause, cause="not what the contract says of it", advice="write what is so") from None
        for name, said in owned:
            probe = said.probe
            if engine.state[f"{probe}.object"].item() >= 0:
                touched += 1
                _check(name, said, engine.state, engine.seconds)
    told = ", ".join(f"{own}.{name}" for own, said in owned for name in said.declared)
    return f"{harness.seconds:.2g} s of {told}, {touched} ticks in contact"


def _check(name: str, said: ContactFields, state: Record, seconds: float) -> None:
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
