"""The derivatives that the estimator learns by are those of the column that it steps."""

from __future__ import annotations

import numpy as np
import pytest

from itouch.plugin import Record
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux import observer as at
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.heat import FINGER

PERIOD, STEPS, APART = 1e-3, 300, 1e-4
NAMES = ("RESISTANCE", "SEEBECK", "LEGS", "OHMIC", "PLATE", "TISSUE", "LAG", "OFFSET", "FLUX", "PRESS", "DELAY")


def stepped(touching: bool, moved: int = -1, by: float = 0.0) -> np.ndarray:
    """Return column and derivatives after some steps under changing currents and a press, one parameter moved."""
    law = ModelLaw(
        DisplayParams(), FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4, longest=9
    )
    state = Record.of(law.fields())
    law.reset(state)
    constants, x, theta, memory = law.constants.copy(), state["x"], state["theta"], state["memory"]
    constants[at.O_SINK_CAPACITY] = 1e12  # its sensor says how warm the sink is: no derivative goes by way of it
    theta[:] = 0.01
    theta[at.DELAY] = 1e-3
    if moved >= 0:
        theta[moved] += by
    memory[at.M_TOUCHING], memory[at.M_PART] = float(touching), 0.7
    for k in range(STEPS):
        current, scale = 2.0 * np.sin(0.05 * k), 1.0 + 3.0 * np.exp(-k / 50)
        at.advance(constants, law.fine.tissue, law.fine.plate, x, theta, memory, current, scale)
    return np.array(x)


@pytest.mark.parametrize("touching", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_a_derivative_is_what_the_column_does_when_its_parameter_is_another(name: str, touching: bool) -> None:
    which = int(getattr(at, name))
    apart = APART * (1e-2 if name == "DELAY" else 1e3 if name == "FLUX" else 1.0)
    expected = (stepped(touching, which, apart)[0] - stepped(touching, which, -apart)[0]) / (2.0 * apart)
    found = stepped(touching)[1 + which]
    assert np.abs(found - expected).max() <= 2e-5 * np.abs(expected).max() + 1e-9
    felt = name not in ("RESISTANCE", "TISSUE", "PRESS") if not touching else True
    assert bool(np.abs(found).max() > 0.0) == (felt and name != "OFFSET")
