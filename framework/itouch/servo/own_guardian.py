"""A guardian for hardware that is driven by a script's own process, as after ``itouch.build``.

A device whose watchdog makes it safe within 200 ms needs none.  Any other device keeps its last command if the process
dies, is suspended, or no longer ticks.  The process belongs to the script: the guardian makes the devices safe, and
does not end it.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence

from itouch.platforms import SERVO_PROCESS
from itouch.plugin import DeviceError
from itouch.plugin.discovery import Catalog
from itouch.safety import DeviceFaultError, Trip
from itouch.scene import loads, write
from itouch.schema import ItouchError
from itouch.servo import control_block as at
from itouch.servo.guardian_link import OWN, Guarded, child_environment
from itouch.servo.parent_process import ProcessEnd
from itouch.servo.publish import ORDERED, Publisher
from itouch.servo.serve import GUARDIAN_SILENCE, GUARDIAN_START, meta_of, unsent
from itouch.servo.shared_memory import SharedMemory, monotonic
from itouch.session import Session
from itouch.world import DeviceModel
from itouch.world.rig import build_devices

#: A device that makes itself safe within this time [s] needs no guardian.
PROMPT = 0.2
#: How many States the memory holds; every how many ticks it is checked that the guardian lives.
_SLOTS, _EVERY = 64, 20
_LOOK = 0.005
_ACTED = (
    "was made safe by the guardian: no tick came from this process for 120 ms or more, or it was suspended (hardware "
    "without a watchdog of its own must be ticked without a pause while it is enabled)"
)


def watch(session: Session) -> OwnGuardian | None:
    """Start the guardian that the session's hardware needs; None: it needs none.

    Raises
    ------
    DeviceError
        If the hardware needs one and there can't be one.
    """
    names = [device.name for device in session.model.devices.values() if _needs(device)]
    if not names or not SERVO_PROCESS:  # elsewhere no hardware is opened
        return None
    _check_known(session, names)
    return OwnGuardian(session, names)


def _needs(device: DeviceModel) -> bool:
    if device.twin or not device.commands or not device.cls.second_opener_for(device.params):
        return False
    lets_go = device.cls.watchdog_for(device.params)
    return lets_go is None or lets_go > PROMPT


def _check_known(session: Session, names: Sequence[str]) -> None:
    """Check that another process finds the drivers, which it does not if only the script's own catalog has them.

    Raises
    ------
    DeviceError
        Naming each device whose driver it does not find.
    """
    catalog, own = Catalog(), session.model
    try:
        found = build_devices(loads(write(own.scene).encode(), catalog, shown=own.scene.source), catalog, [])
    except ItouchError:
        found = {}
    unknown = [name for name in names if name not in found or found[name].cls is not own.devices[name].cls]
    if unknown:
        raise DeviceError("\n".join(
            f"device '{name}' keeps its last command if this program dies, and a guardian can't open it: its plugin "
            "is known to this process only (`catalog=`); install the plugin, or let it state its own `watchdog`"
            for name in unknown
        ))  # fmt: skip


class OwnGuardian:
    """Tells a guardian after each tick that this process lives, and what was sent; notices if the guardian acted."""

    def __init__(self, session: Session, names: Sequence[str]) -> None:
        self._session, self._names = session, names
        self._hardware = [one for one in session.runners if not one.model.twin]
        self._stopping = session.state["stopping"]
        segment = SharedMemory.create(f"{os.path.basename(session.model.scene.source) or 'scene'}-{os.getpid()}")
        state, timing = session.state, session.times
        meta = meta_of(session, {}, sys.path)
        meta["second_openers"] = [name for name in meta["second_openers"] if name in names]
        segment.words[at.SERVO] = os.getpid()
        segment.grow(meta, state.nbytes, timing.record.nbytes, _SLOTS, not ORDERED, session.model.scene.files)
        self._segment, self._words = segment, segment.words
        self._publisher = Publisher(segment, state, timing)
        self._publisher.publish(session.ticks)
        self._words[at.BEAT] = monotonic()
        self._words[at.PHASE] = at.RUNNING
        self._guarded = Guarded(os.getpid(), segment, child_environment(), OWN)
        for runner in self._hardware:
            runner.lifecycle.guardian = lambda: self._guarded.pid
        self._end = ProcessEnd(lambda: self._guarded.pid)
        self._await()
        session.taps.append(self.tap)

    def _await(self) -> None:
        """Wait until the guardian is ready to act.

        Raises
        ------
        DeviceError
            If it does not get that far.
        """
        deadline = time.monotonic() + GUARDIAN_START
        while not self._words[at.GUARDIAN_BEAT]:
            if self._guarded.ended or time.monotonic() > deadline:
                self.end()
                raise DeviceError("the guardian process did not start: nothing is enabled without it")
            time.sleep(_LOOK)

    def tap(self, tick: int) -> None:
        """Tell the guardian of a tick; also called in the safe sequence.

        Raises
        ------
        DeviceFaultError
            If the guardian had to act, or is gone; all has been made safe.
        """
        words = self._words
        words[at.BEAT] = monotonic()
        self._arm()
        self._publisher.publish(tick)
        words[at.UNSENT] = unsent(self._session)
        if words[at.STOP]:
            words[at.STOP] = 0
            self._stop(tick, _ACTED)
        if tick % _EVERY == 0 and words[at.ARMED]:
            silent = monotonic() - int(words[at.GUARDIAN_BEAT]) > GUARDIAN_SILENCE
            if silent or self._end.seen():
                self._stop(tick, "was made safe: the guardian process has died or hangs")

    def _arm(self) -> None:
        """Tell the guardian whether silence means danger."""
        acts = bool(self._stopping.item()) or any(one.latch.enabled for one in self._hardware)
        self._words[at.ARMED] = int(acts)

    def _stop(self, tick: int, cause: str) -> None:
        if self._session.fault is not None and not any(one.latch.enabled for one in self._hardware):
            return  # it is being made safe already
        fault = DeviceFaultError(self._names[0], tick, Trip.OVERRUN, cause)
        self._session.make_safe(fault)
        raise fault

    def rest(self) -> None:
        """Note that all has been made safe: unless a device is still enabled, nothing need be watched until a tick."""
        self._words[at.BEAT] = monotonic()
        self._arm()

    def end(self) -> None:
        """Let the guardian end; before that it makes safe what could not be released."""
        self.rest()
        self._words[at.PHASE] = at.ENDED
        if self.tap in self._session.taps:
            self._session.taps.remove(self.tap)
        self._guarded.wait()
        for runner in self._hardware:
            runner.lifecycle.guardian = int
        self._segment.close()
