"""What is true of a plant is found by what its fields are for, whatever they are called."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Field, Role
from itouch.world import truth
from itouch_tools.report.safety.worst import Worst

ROLES = (Role.SKIN_CONTACT_TEMPERATURE, Role.SKIN_TEMPERATURE, Role.HEAT_FLUX)


@pytest.fixture(scope="module")
def session():
    built = itouch.build(SCENES / "four_materials.xml")
    yield built
    built.close()


def declaring(session, *fields):
    """Return the session's model as if its State had these fields."""
    model = replace(session.model)
    model.declared.append({field.name: field for field in fields})
    return model


def test_each_truth_is_found_in_the_twin(session):
    found = [truth(session.model, "peltier", role) for role in ROLES]
    assert all(name.startswith("peltier.twin.") and name in session.state for name in found)
    assert len(set(found)) == 3 and truth(session.model, "arm", Role.HEAT_FLUX) == ""


def test_a_field_without_a_role_is_not_found_by_its_name(session):
    """A field of the right name without its role is not found; one of any name with it is."""
    named = Field("peltier.twin.true_flux", unit="W/m^2", doc="no role")
    meant = Field("peltier.twin.zyx", unit="W/m^2", doc="a role", role=Role.HEAT_FLUX)
    assert truth(declaring(session, named, meant), "peltier", Role.HEAT_FLUX) == "peltier.twin.zyx"
    assert truth(declaring(session, named), "peltier", Role.HEAT_FLUX) == ""


def test_a_field_that_a_fault_keeps_is_not_the_truth(session):
    kept = Field("peltier.twin.fault.kept", unit="W/m^2", doc="a reading held", role=Role.HEAT_FLUX)
    assert truth(declaring(session, kept), "peltier", Role.HEAT_FLUX) == ""


def test_the_worst_values_are_those_of_the_true_fields(session):
    worst = Worst(session)
    session.taps.append(worst.note)
    session.run(0.01)
    for role, what in zip(ROLES, ("plate temperature [K]", "skin temperature [K]", "flux [W/m²]"), strict=True):
        assert worst.high[f"peltier: {what}"] >= session.state[truth(session.model, "peltier", role)].item()
