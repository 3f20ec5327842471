"""A session that is saved while faults are in flight goes on in another process as if it had not stopped."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import campaign
import pytest

import itouch

SAVED, END = 6100, 6600
_GO_ON = """
import hashlib, sys, itouch
session = itouch.restore(sys.argv[1])
try:
    session.run(float(sys.argv[2]))
except itouch.DeviceFaultError as fault:
    print(fault.trip.label, fault.tick, end=" ")
print(hashlib.sha256(session.state.tobytes()).hexdigest())
"""


def told(session: itouch.Session, seconds: float) -> str:
    """Return how a session ends: the trip if there is one, and the digest of its State."""
    said = ""
    try:
        session.run(seconds)
    except itouch.DeviceFaultError as fault:
        said = f"{fault.trip.label} {fault.tick} "
    return said + hashlib.sha256(session.state.tobytes()).hexdigest()


@pytest.mark.parametrize(
    "faults",
    campaign.some(
        [
            '<fault device="arm" kind="delay" at="6 s"/>',
            '<fault device="peltier" kind="drift" at="6 s" channel="plate_temperature" amount="1 K"/>',
            '<fault device="table" kind="drop" at="6 s"/>',
            '<fault device="arm" kind="freeze" at="6.09 s" for="100 ms"/>',
            '<fault device="table" kind="bias" at="6.4 s" channel="wrench" amount="6 N"/>',  # comes after the restart
        ],
        1,
    ),
)
def test_a_session_with_active_faults_goes_on_in_another_process(scenes: Path, faults: str) -> None:
    path = scenes / "faults.xml"
    text = path.read_text(encoding="utf-8")
    planned = '<fault device="table" kind="disconnect" at="8 s"/>'
    assert planned in text
    path.write_text(text.replace(planned, faults), encoding="utf-8")
    straight = itouch.build(path, seed=7)
    straight.run(SAVED * 1e-3)
    straight.save(scenes / "flying.itouch")
    expected = told(straight, (END - SAVED) * 1e-3)
    done = subprocess.run(
        [sys.executable, "-c", _GO_ON, str(scenes / "flying.itouch"), str((END - SAVED) * 1e-3)],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == expected
