"""A servo process that lives and does nothing: the guardian makes its devices safe and ends it."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import pytest

import itouch
from itouch.bench.deaths.observer import Observer
from itouch.bench.deaths.scene import scene

_CUSTOM = """
import signal

def hang(number, frame):
    while True:
        pass

signal.signal(signal.SIGUSR1, hang)
"""


def test_a_loop_that_hangs_is_ended_and_the_devices_are_safe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(_CUSTOM, encoding="utf-8")
    path = tmp_path / "hang.xml"
    path.write_text(scene(hold=False), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    assert str(tmp_path) in sys.path
    with itouch.launch(path) as handle:
        observer = Observer(handle.name, ("arm", "table", "peltier"))
        while handle.link.tick < 50:  # before, nothing obeys and nothing need be made safe
            time.sleep(0.02)
        os.kill(handle.pid, signal.SIGUSR1)
        with pytest.raises(
            itouch.ServoError, match="killed by SIGKILL; the servo process hung; arm, table, peltier made"
        ):
            handle.wait(60)
        assert observer.wait(30)
        assert all(time is not None for time in observer.safe_after(0).values())
