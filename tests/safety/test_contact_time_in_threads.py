"""T4 through the entrance of hardware: arm and table each in a thread, exchanged at odd times; the wall is the judge."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import ClassVar

import campaign
import pytest
from test_third_party_device_supervision import Nothing, catalog

import itouch
from itouch.loop import WallClock
from itouch.plugin import Device, Record, deadman, measured_wrench, pose, pose_target, wrench

CLAMP = 1.2
SCENE = f"""<itouch version="1.0">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices><device name="stick" plugin="arm" twin="no"/><device name="slab" plugin="table" twin="no"/></devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="stick" force-to="stick" surface-to="slab"/>
  </interaction><safety contact-time="{CLAMP} s"/></itouch>"""
#: Lowest point of the finger [m], a millimetre below the top of the object.
LOWEST = 0.019


class Arm(Device):
    """An arm whose finger rests a millimetre deep in the object."""

    Params = Nothing
    watchdog: ClassVar[float | None] = 0.1
    reads = (pose(), deadman("held"))
    commands = (wrench(force=3.0),)

    def open(self) -> None: ...
    def close(self) -> None: ...

    def read(self, reading: Record) -> bool | None:
        reading["pose"] = (1e-6 * (time.monotonic() % 1.0), 0.0, LOWEST + 0.008, 1.0, 0.0, 0.0, 0.0)
        reading["held"] = 1.0
        return True


class Slab(Device):
    """A table that goes where it is sent at 0.25 m/s, and feels the finger as a spring."""

    Params = Nothing
    blocking: ClassVar[bool] = True
    watchdog: ClassVar[float | None] = 0.1
    reads = (pose(locked=(3, 4, 5)), measured_wrench(force=50.0))
    commands = (pose_target(low=(-0.1, -0.1, -0.03), high=(0.1, 0.1, 0.06), speed=0.3),)
    touches: ClassVar[list[tuple[float, bool]]] = []

    def open(self) -> None:
        self.height = self.goal = 0.018
        self.then = time.monotonic()

    def close(self) -> None: ...

    def write(self, command: Record) -> None:
        self.goal = command["pose_target"][2].item()

    def read(self, reading: Record) -> bool | None:
        now = time.monotonic()
        most, self.then = 0.25 * (now - self.then), now
        self.height += max(-most, min(most, self.goal - self.height))
        time.sleep(self.period)
        force = 400.0 * max(0.0, self.height - LOWEST)
        self.touches.append((now, force > 0.03))
        reading["pose"] = (0.0, 0.0, self.height, 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (0.0, 0.0, -force - 1e-6 * (now % 1.0), 0.0, 0.0, 0.0)
        return True


class Stalls:
    """The longest that this machine kept a thread waiting that wanted to run every 5 ms [s]."""

    def __enter__(self) -> Stalls:
        self.longest, self._over = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._over.wait(0.005):
            now = time.monotonic()
            self.longest, before = max(self.longest, now - before), now


def touched(scene: Path, table: type[Slab]) -> list[tuple[float, float, int]]:
    """Run the touch; return the wall's time, T4's clock and whether the plate is withdrawn, a row a tick."""
    clock: list[tuple[float, float, int]] = []
    with itouch.build(scene, catalog=catalog({"arm": Arm, "table": table}), clock=WallClock()) as session:
        session.enable()
        told = session.state["slab.surface.contact_time"], session.state["slab.surface.withdrawn"]
        session.run(4.0, each=lambda: clock.append((time.monotonic(), told[0].item(), told[1].item())))
    return clock


@pytest.mark.punctual
@pytest.mark.parametrize("every", campaign.some([0.020, 0.007, 0.023], 1))
def test_the_clock_of_contact_is_the_walls(tmp_path: Path, every: float) -> None:
    (tmp_path / "s.xml").write_text(SCENE, encoding="utf-8")
    for tries in range(5):
        table = type("Slab", (Slab,), {"touches": [], "period": every})
        with Stalls() as stalls:
            try:
                clock = touched(tmp_path / "s.xml", table)
            except itouch.DeviceFaultError:  # W1, which is right if the machine stood still for longer than it allows
                if stalls.longest < 0.1 or tries == 4:
                    raise
                continue
        break
    begin = next(now for now, felt in table.touches if felt)
    end = next(now for now, felt in table.touches if now > begin and not felt)
    again = next((now for now, felt in table.touches if now > end and felt), end + 4.0)
    first = next(now for now, _, withdrawn in clock if withdrawn)
    assert first - begin == pytest.approx(CLAMP, rel=0.05, abs=2 * every + 0.06)
    assert end - begin < CLAMP + 0.3
    assert again - end > 0.5 * CLAMP - 0.1
    assert max(spent for _, spent, _ in clock) < CLAMP + 0.3
