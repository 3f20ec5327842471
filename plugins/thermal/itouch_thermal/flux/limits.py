"""The limits of a plate that every controller keeps to: those that safety sets by default, which a test compares.

Safety's own are in `itouch.monitors.default_limits`, which no plugin imports; it acts whatever a controller does.
"""

from __future__ import annotations

#: The plate's band [K] where no limits are known (T1, T2).
BAND = (288.15, 313.15)
#: Greatest rate of the plate's temperature in a touch [K/s], and the time over which it is averaged [s] (T5).
RATE, RATE_OVER = 10.0, 0.5
