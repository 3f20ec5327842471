"""The paper's controller: proportional and integral action on the measured flux, with a bumpless start.

The integral stops while the command is at a limit and the error would drive it further (conditional anti-windup).
"""

from __future__ import annotations

from itouch.plugin import Record


def proportional_integral(
    state: Record, name: str, error: float, gains: tuple[float, float], limit: float, period: float
) -> float:
    """Return the flux to pump [W/m2] for an error [W/m2], clipped to ``limit``; the integral is State."""
    kp, ki = gains
    integral: float = state[f"{name}.integral"].item()
    wanted = kp * error + integral
    if abs(wanted) < limit or wanted * error < 0.0:
        integral += ki * error * period
        state[f"{name}.integral"] = integral
        wanted = kp * error + integral
    return min(limit, max(-limit, wanted))
