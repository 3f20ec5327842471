"""Constants by which monitors recognise the impossible (rates, frozen sensors); no scene sets them.

Limits that a scene may set, and their bounds, are in ``limits``.
"""

from __future__ import annotations

# --- a plate: T1 to T6 ---------------------------------------------------------------------------------------------
#: How far ahead [s] a plate's temperature is extrapolated, and over what time [s] its rate is taken for that.
AHEAD, RATE_TIME = 0.1, 0.05
#: T5, T6: the times [s] over which the rate in contact and the flux are averaged.
CONTACT_RATE_TIME, FLUX_TIME = 0.5, 1.0
#: T3: temperature [K] from which dose counts, and that at which a second counts as one (Sapareto and Dewey 1984).
DOSE_FROM, DOSE_UNIT = 312.15, 316.15
#: T8: a step between two means of 50 ms [K] that no plate can make.
STEP = 5.0
#: The windows for looking back [s], and their indices.
WINDOWS = (RATE_TIME, 2 * RATE_TIME, CONTACT_RATE_TIME, FLUX_TIME)
SHORT, DOUBLE, LONG, MEAN = range(4)
# --- what it has read ----------------------------------------------------------------------------------------------
#: How many readings are kept: more than a second of them, 5 ms apart.
READINGS = 256
#: Times [s] that differ by less are the same.
SAME = 1e-7
#: Columns of the ring.
TIME, VALUE, AREA, FLUX = range(4)
# --- its sensor and its drive: T8, T9 ------------------------------------------------------------------------------
#: T8: how long [s] a plate may read exactly the same while its drive changes, by what part of the drive at least, and
#: what integral of that change, in seconds of full drive, is enough by itself.
FROZEN, DRIVEN, FROZEN_DRIVE = 1.0, 0.02, 0.15
#: T8: seconds of full drive, counted while it is strong, after which a plate cannot read exactly what it read before.
FROZEN_HELD = 0.5
#: T8: a plate whose temperature moved under a steady drive above ``DRIFT_DRIVE`` cannot read exactly the same where it
#: would have moved on by this much [K], after the first and before the second time [s]; time [s] to smooth its slope.
STOPPED, STOPPED_TIME, STOPPED_WITHIN, SLOPE_TIME = 1.0, 0.5, 5.0, 0.3
#: T8: the same for a plate that changed faster than this [K/s], after this time [s], however weakly driven: a driver
#: that is stuck at full strength changes it by 30 K/s, and only the sensor can show that.
FAST, FAST_TIME = 5.0, 0.2
#: T9: part of the drive in force, for how long [s], and what change of temperature [K] it must cause, or must not; the
#: time [s] by which drive and sensor may lag.
RUNAWAY_DRIVE, RUNAWAY_TIME, RUNAWAY_STILL, RUNAWAY_WRONG, LAG = 0.5, 2.0, 0.1, 2.0, 0.15
#: T8: an untouched plate that is driven one way by more than this part, for this long [s], cannot be this far [K] on
#: the other side of its heat sink: its sensor must have drifted.
DRIFT_DRIVE, DRIFT_TIME, DRIFT = 0.1, 10.0, 10.0
#: How far [K] from its target a drive that holds a temperature is taken to be at full strength.
FULL_STRENGTH = 10.0
#: A target below this [K] means that there is none.
COLDEST_TARGET = 200.0
#: The extremes of the last two seconds are kept in parts of this many seconds; how many parts are kept.
PART, PARTS = 0.1, 24
# --- a carried surface: K5, T8 -------------------------------------------------------------------------------------
#: Force [N] above which the plate counts as touched; gap [m] below which it does, too, once its height is calibrated.
TOUCH_FORCE, TOUCH_GAP = 0.03, 2e-4
#: The same gap [m] where nothing measures the force: then the height is known from the mount only.
TOUCH_GUESS = 1e-3
#: A force [N] that is impossible with the finger this far [m] from the plate, farther before its height is calibrated,
#: and for how long [s] it may seem so.
DOUBT_FORCE, DOUBT_GAP, DOUBT_GAP_UNCALIBRATED, DOUBT_TIME = 0.5, 0.004, 0.015, 0.1
#: Time [s] between two of the slower checks, and over which a surface's speed is taken (K5).
SLOW, SPEED_TIME = 0.010, 0.050
#: A little less than these, because times are sums of periods.
DUE, WINDOW = SLOW - 1e-7, SPEED_TIME - 1e-7
#: How many positions are remembered: those of a little more than the window.
PLACES = 16
