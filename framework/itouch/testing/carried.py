"""What a modality says in its fields of a surface that it carries must agree with the contract, in every tick."""

from __future__ import annotations

import math

from itouch.plugin import Carries, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.scenario import ModalitySubject


@check("carries", "what it says of its surface can be so")
def carries(subject: ModalitySubject) -> str:
    """Run the scene, and check in every tick the fields that describe its surface."""
    engine = subject.engine()
    owned = [(one.name, one.carries) for one in subject.own(engine) if one.carries is not None]
    if not owned:
        raise NotApplicableError("it carries no surface")
    for _ in range(round(subject.seconds / engine.model.period)):
        engine.tick()
        for name, said in owned:
            wrong = _wrong(name, said, engine.state)
            if wrong is not None:
                field, value, advice = wrong
                seen = f"the field {name}.{field} is {value:g} after {engine.seconds:.3f} s"
                raise CheckError(seen, cause="not what the contract says of it", advice=advice)
    told = ", ".join(name for _, said in owned for name in said.said)
    return f"{subject.seconds:.2g} s of {told}"


def _wrong(name: str, said: Carries, state: Record) -> tuple[str, float, str] | None:
    """Return a field with an impossible value, that value and what would be right, or None."""
    value = {field: state[f"{name}.{field}"].item() for field in said.said}
    for field in (said.renders, said.present):
        if value[field] not in (0.0, 1.0):
            return field, value[field], "write 1 where it is so, else 0"
    if said.missed and value[said.missed] not in (0.0, 1.0, 2.0):
        return said.missed, value[said.missed], "write 0, 1 (not felt where it should be) or 2 (felt below that)"
    if said.missed and value[said.missed] and value[said.renders]:
        return said.renders, value[said.renders], "write 0 as long as it is missed: the contact is the arm's"
    for field, what in ((said.coming, "how far it still has to come"), (said.yields, "how far it gives way")):
        if field and not value[field] < math.inf:
            return field, value[field], f"write {what}, or -1 where that can't be said"
    return None
