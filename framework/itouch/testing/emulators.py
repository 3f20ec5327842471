"""Checks of an emulator: through it, the unmodified driver must read what the twin does."""

from __future__ import annotations

import contextlib
import time

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Channel, DeviceError, Role
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import DeviceHarness, limits
from itouch.testing.open_device import Opened, Served, emulated

#: Offsets [m] from a reachable position to which the finger leads a device that tracks it, and time for that [s].
_ABOUT = tuple(np.array(away) for away in ((0.0, 0.0, 0.0), (0.008, -0.005, 0.004), (-0.006, 0.007, -0.009)))
_SETTLE = 0.1


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("twin-and-driver-agree", "the driver reads what the twin is")
def agree(harness: DeviceHarness) -> str:
    """Compare the driver's readings with those of the twin behind the wire, for a tracking device at some positions."""
    with emulated(harness) as (emulator, opened):
        opened.fresh(5.0)
        if not emulator.tracks:
            return f"within {100 * _agreed(emulator, opened):.0f} % of the tolerance"
        middle, worst = emulator.bench.touch.finger_pose[:3].copy(), 0.0
        for away in _ABOUT:
            emulator.hold(middle + away)
            time.sleep(_SETTLE)
            worst = max(worst, _agreed(emulator, opened))
        return f"within {100 * worst:.0f} % of the tolerance at {len(_ABOUT)} places"


def _agreed(emulator: Served, opened: Opened) -> float:
    """Wait until driver and twin agree; return the difference between them as a share of the tolerance."""
    deadline = time.perf_counter() + 5.0
    worst, where = 0.0, ""
    while time.perf_counter() < deadline:
        opened.device.read(opened.reading)
        worst, where = 0.0, ""
        for channel in emulator.bench.reads:
            theirs = emulator.bench.reading[channel.name]
            scale = max(1e-3, 0.02 * float(np.abs(theirs).max(initial=0.0)))
            difference = float(np.abs(opened.reading[channel.name] - theirs).max()) / scale
            if difference > worst:
                worst, where = difference, channel.name
        if worst <= 1.0:
            return worst
        time.sleep(0.01)
    raise _fail(
        f"'{where}' reads {opened.reading[where]} through the wire, the twin has {emulator.bench.reading[where]}",
        "another scale, frame or unit in driver or emulator",
        "convert at the wire: SI on our side",
    )


@check("disabled-is-still", "nothing is driven before the first command")
def still(harness: DeviceHarness) -> None:
    """Open and read; the driver must send no command but the safe one."""
    with emulated(harness) as (emulator, opened):
        for _ in range(20):
            with contextlib.suppress(CheckError):
                opened.fresh(0.2, silent=True)
        for channel in emulator.bench.commands:
            if not isinstance(channel.safe, tuple) or not emulator.driven:
                continue
            asked = emulator.asked[channel.name]
            if np.abs(asked - np.array(channel.safe)).max() > 1e-6:
                raise _fail(
                    f"after open it drives '{channel.name}' to {asked}",
                    "open or read moves the device",
                    "only write may move it",
                )


@check("commands-arrive", "what is commanded arrives")
def arrive(harness: DeviceHarness) -> str:
    """Send commands within what is allowed, and compare with what arrives at the emulator."""
    with emulated(harness) as (emulator, opened):
        opened.fresh(5.0)
        wanted = {c.name: _half(c) for c in opened.commands if c.role is not Role.SURFACE_POSE and c.low}
        if not wanted:
            raise NotApplicableError("it obeys no command but a place to go to")
        worst = 0.0
        for name, value in wanted.items():
            opened.be_safe()
            opened.command[name] = value
            worst = max(worst, _arrived(emulator, opened, name))
        return f"within {100 * worst:.0f} % of the tolerance"


def _half(channel: Channel) -> NDArray[np.float64]:
    """Return a command well within what is allowed, different in each component; zero on locked axes."""
    low, high = limits(channel.low, channel.size), limits(channel.high, channel.size)
    shares = np.resize([0.75, 0.3, 0.6], channel.size)
    value = low + shares * (high - low)
    if channel.magnitude is not None:
        value[:3] *= min(1.0, 0.5 * channel.magnitude / max(float(np.linalg.norm(value[:3])), 1e-12))
    value[list(channel.locked)] = 0.0
    return value


def _arrived(emulator: Served, opened: Opened, name: str) -> float:
    """Send the command until it has arrived; return the difference as a share of the tolerance."""
    wanted, told = opened.command[name].copy(), emulator.asked[name]
    scale = 0.03 * float(np.abs(wanted).max())
    deadline, error = time.perf_counter() + 3.0, np.inf
    while time.perf_counter() < deadline:
        opened.device.write(opened.command)
        opened.device.read(opened.reading)
        error = float(np.abs(told - wanted).max()) / scale
        if error <= 1.0:
            return error
        time.sleep(2e-3)
    silent = [axis for axis in range(len(wanted)) if wanted[axis] and not told[axis]]
    if silent and np.abs((told - wanted)[told != 0.0]).max(initial=0.0) < scale:
        raise _fail(
            f"of '{name}' {np.round(wanted, 6)} is commanded, but nothing arrives on the axes {silent}",
            "the device has no drive there, or write forgets them",
            f"send them, or lock them: locked={tuple(silent)}",
        )
    ratio = float((told * wanted).sum() / (wanted * wanted).sum())
    raise _fail(
        f"of '{name}' {np.round(wanted, 6)} is commanded, {np.round(told, 6)} arrives: {ratio:.3g} times it",
        "another unit (milliamperes, millinewtons), a sign, or axes that are swapped, in write or in the emulator",
        "convert at the wire: SI on our side",
    )


@check("unplug", "an unplugged device is reported; close works")
def unplug(harness: DeviceHarness) -> str:
    """Disconnect the emulator while the driver reads."""
    with emulated(harness) as (emulator, opened):
        opened.fresh(5.0)
        emulator.hang_up()
        told = _unplugged(opened)
    if harness.shared is not None:
        harness.shared.end()  # close must still work
    return told


def _unplugged(opened: Opened) -> str:
    """Read from a device that is gone; return how the driver reports that."""
    begin = time.perf_counter()
    while time.perf_counter() - begin < 3.0:
        try:
            if opened.device.read(opened.reading) is False:
                time.sleep(1e-3)
                continue
        except DeviceError:
            return f"reported after {1e3 * (time.perf_counter() - begin):.0f} ms"
        _no_nan(opened)
        if time.perf_counter() - begin > 1.0:
            break
    if time.perf_counter() - begin >= 3.0:
        return "reported as silence: the watchdog stops it"
    raise _fail(
        "it goes on reading from a device that is gone",
        "errors of the wire are swallowed",
        "raise DeviceError from read; or return False when nothing came",
    )


def _no_nan(opened: Opened) -> None:
    wrong = [name for name, view in opened.reading.items() if not np.isfinite(view).all()]
    if wrong:
        raise _fail(
            f"unplugged, it goes on and reads '{wrong[0]}' as {opened.reading[wrong[0]]}",
            "an error of the wire is turned into NaN",
            "raise DeviceError from read: it says what happened, and safety acts upon it",
        )
