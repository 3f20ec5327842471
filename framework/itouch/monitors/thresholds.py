"""Constants by which monitors recognise the impossible (rates, frozen sensors): of rules that no scene sets.

What a scene may set, and its bounds, stands in ``limits``.
"""

from __future__ import annotations

# --- a plate: T1 to T6 ---------------------------------------------------------------------------------------------
#: How far ahead [s] a plate's temperature is extrapolated, and over what time [s] its rate is taken for that.
AHEAD, RATE_TIME = 0.1, 0.05
#: T5, T6: the times [s] over which the rate in contact and the flux are averaged.
CONTACT_RATE_TIME, FLUX_TIME = 0.5, 1.0
#: T3: temperature [K] from which dose counts, and that at which a second is a second (Sapareto and Dewey 1984).
DOSE_FROM, DOSE_UNIT = 312.15, 316.15
#: T8: a step between two means of 50 ms [K] that no plate can do.
STEP = 5.0
#: The windows that are looked back, and which is which.
WINDOWS = (RATE_TIME, 2 * RATE_TIME, CONTACT_RATE_TIME, FLUX_TIME)
SHORT, DOUBLE, LONG, MEAN = range(4)
# --- what it has read ----------------------------------------------------------------------------------------------
#: How many readings are kept: more than a second of them, 5 ms apart.
READINGS = 256
#: Times [s] that differ by less are one.
SAME = 1e-7
#: Columns of the ring.
TIME, VALUE, AREA, FLUX = range(4)
# --- its sensor and its drive: T8, T9 ------------------------------------------------------------------------------
#: T8: how long [s] a driven plate may read exactly the same, what part of the drive counts as driven, and how many
#: seconds of full drive are enough by themselves.
FROZEN, DRIVEN, FROZEN_DRIVE = 1.0, 0.02, 0.15
#: T8: seconds of full drive, counted while it is strong, after which a plate cannot read exactly what it read before.
FROZEN_HELD = 0.5
#: T8: a plate that was moving under a steady drive above ``DRIFT_DRIVE`` cannot read exactly the same where it would
#: have gone so far [K], after the one and before the other time [s]; how long [s] its slope is smoothed.
STOPPED, STOPPED_TIME, STOPPED_WITHIN, SLOPE_TIME = 1.0, 0.5, 5.0, 0.3
#: T8: the same of a plate that was faster than this [K/s], after this time [s], however weakly driven: a driver that is
#: stuck at full strength brings it 30 K/s on, and nothing but the sensor tells.
FAST, FAST_TIME = 5.0, 0.2
#: T9: part of the drive in force, for how long [s], and what change of temperature [K] that must have, or must not; the
#: time [s] that drive and sensor may lag.
RUNAWAY_DRIVE, RUNAWAY_TIME, RUNAWAY_STILL, RUNAWAY_WRONG, LAG = 0.5, 2.0, 0.1, 2.0, 0.15
#: T8: a plate that is driven one way, by more than this part, for so long [s] and untouched, is not so far [K] on the
#: other side of its heat sink: its sensor has drifted.
DRIFT_DRIVE, DRIFT_TIME, DRIFT = 0.1, 10.0, 10.0
#: A drive that holds a temperature is at full strength so far [K] from its target.
FULL_STRENGTH = 10.0
#: A target below this [K] is none.
COLDEST_TARGET = 200.0
#: The extremes of the last two seconds are kept by parts of so many seconds.
PART, PARTS = 0.1, 24
# --- a carried surface: K5, T8 -------------------------------------------------------------------------------------
#: Force [N] that counts as a touch of the plate; gap [m] that does, too, once the height is known.
TOUCH_FORCE, TOUCH_GAP = 0.03, 2e-4
#: Gap [m] that counts where nothing measures the force: then the height is known from the mount only.
TOUCH_GUESS = 1e-3
#: A force [N] that cannot be where the finger is so far [m] from the plate, and for how long [s] it may seem so; wider
#: before the height is calibrated.
DOUBT_FORCE, DOUBT_GAP, DOUBT_GAP_UNCALIBRATED, DOUBT_TIME = 0.5, 0.004, 0.015, 0.1
#: Seconds between two of the slower checks, and time [s] that a surface's speed is taken over (K5).
SLOW, SPEED_TIME = 0.010, 0.050
#: A little less: times are sums of periods.
DUE, WINDOW = SLOW - 1e-7, SPEED_TIME - 1e-7
#: Places that are remembered: those of a bit more than the window.
PLACES = 16
