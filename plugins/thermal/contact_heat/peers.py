"""A peer for comparison, as a careful user writes it with SciPy: method of lines, graded mesh, stiff integrator."""

from __future__ import annotations

import numpy as np

from contact_heat.contact import Contact
from contact_heat.differences import chain_of
from contact_heat.splitting import Chain
from contact_heat.stack import Array

#: Conductances [W/m2K] that represent a held face, and a contact without resistance.
_HELD, _JOINED = 1e8, 1e9


def method_of_lines(
    contact: Contact, times: Array, *, first: float, growth: float, rtol: float, integrator: str
) -> Array:
    """Return the contact flux [W/m2] at times [s], shape (times,); needs SciPy.

    Parameters
    ----------
    contact
        The problem.
    times
        Times in ascending order [s].
    first, growth
        First cell [m], and ratio of neighbouring cells; 1 for equal cells.
    rtol, integrator
        As in `scipy.integrate.solve_ivp`.
    """
    from scipy.integrate import solve_ivp
    from scipy.sparse import diags

    duration = float(times[-1])
    finger, body = (chain_of(side, first, duration, growth=growth) for side in (contact.finger, contact.object))
    link = 1.0 / contact.resistance if contact.resistance > 0.0 else _JOINED
    links = np.concatenate((finger.conductance[::-1], [link], body.conductance))
    capacity = np.concatenate((finger.capacity[::-1], body.capacity))
    loss, gain = (np.concatenate(pair) for pair in zip(_sources(finger, -1), _sources(body, 1), strict=True))
    main = -loss
    main[:-1] -= links
    main[1:] -= links
    matrix = diags([links / capacity[1:], main / capacity, links / capacity[:-1]], [-1, 0, 1], format="csc")
    found = solve_ivp(
        lambda _, state: matrix @ state + gain / capacity,
        (0.0, duration),
        np.concatenate((finger.initial[::-1], body.initial)),
        method=integrator,
        t_eval=times,
        rtol=rtol,
        atol=rtol * 1e-2,
        jac=matrix,
    )
    split = len(finger.initial)
    return np.asarray(link * (found.y[split - 1] - found.y[split]))


def _sources(chain: Chain, order: int) -> tuple[Array, Array]:
    """Return the conductance to blood and back and its heat source, shape (nodes,), by depth or reversed."""
    loss, gain = chain.blood.copy(), chain.blood * chain.arterial
    film = min(chain.back, _HELD)
    loss[-1] += film
    gain[-1] += film * chain.back_temperature
    return loss[::order], gain[::order]
