"""Hardware that a script drives in its own process: who makes it safe when that process dies, hangs or pauses.

The device keeps its last command, and writes each one into a file with the process that gave it and the time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import campaign
import pytest
from punctuality import skip_unless_punctual
from test_harmful_plugin_code import PLUGIN, SCENE
from third_party_plugins import install

import itouch
from itouch.plugin import DeviceError
from itouch.plugin.discovery import Catalog, Found, find
from itouch.servo import own_guardian
from itouch.session import Session

#: Within this time [s] a device must be safe.
PROMPT = 0.2
SCRIPT = """
import os, signal, sys, time, itouch
session = itouch.build(sys.argv[1], clock=itouch.WallClock())
session.enable()
{rest}
"""
#: Pushes, meets what happens, and shows that the operator can go on.
GOES_ON = """
try:
    session.run(1.0)
    {pause}
    session.run(0.1)
    print("nothing was told")
except itouch.DeviceFaultError as fault:
    print(fault)
session.rearm()
session.run(0.3)
guardian = session._guardian._guarded.pid
session.close()
try:
    os.kill(guardian, 0)
    print("the guardian is left over")
except ProcessLookupError:
    print("closed")
"""

Log = list[tuple[float, int, str]]


def begun(folder: Path, act: str, rest: str) -> tuple[subprocess.Popen[str], Path]:
    """Start a script that drives the stick beside this act of a plugin; return it, and the device's log."""
    folder.mkdir()
    log = folder / "log"
    listed = "[itouch.modalities]\nevil.it = evil:Evil\n[itouch.devices]\nstick = evil:Stick\n"
    code = PLUGIN.format(act=f"        {act}", file=str(log)).replace('(handle, f"', '(handle, f"{time.monotonic()} ')
    install(folder, "evil", listed, code=code)
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    (folder / "script.py").write_text(SCRIPT.format(rest=rest), encoding="utf-8")
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    words = [sys.executable, str(folder / "script.py"), str(folder / "scene.xml")]
    pipe = subprocess.PIPE
    done = subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "PYTHONPATH": path})
    return done, log


def entries(log: Path) -> Log:
    """Return what the device was given: when [s], by which process, and what."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    return [(float(at), int(who), what) for at, who, what in (line.split() for line in lines)]


def let_go(log: Log, script: int) -> float:
    """Return after how long [s] another process let go of what the script pushed last before it; fails if none did."""
    others = [index for index, (_, who, what) in enumerate(log) if who != script and what == "0.0"]
    assert others, log[-3:]
    pushed = max(at for at, who, what in log[: others[0]] if who == script and what not in ("open", "close", "0.0"))
    return log[others[0]][0] - pushed


def in_time(folder: Path, act: str, code: int, rest: str = "session.run(1.0)\n") -> tuple[str, Log]:
    """Run a script until it ends with this code and another process has let go in time, thrice at most.

    It returns what the script said, and the log.
    """
    for number in range(3):
        script, log = begun(folder / str(number), act, rest)
        said, _ = script.communicate(timeout=600)
        wait_until(lambda log=log, script=script: any(who != script.pid for _, who, _ in entries(log)))
        told = entries(log)
        if let_go(told, script.pid) < PROMPT and script.returncode == code:
            return said, told
    skip_unless_punctual(0.05)
    pytest.fail(f"let go after {let_go(told, script.pid):.3f} s; the script ended with {script.returncode}")


def wait_until(holds: Any, longest: float = 5.0) -> None:
    """Wait until something holds, or for so long [s]."""
    end = time.monotonic() + longest
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("act", "code"),
    campaign.some([
        ("os._exit(0)", 0), ("ctypes.CDLL(None).exit(0)", 0), ("ctypes.string_at(0)", -signal.SIGSEGV),
        ("os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL), ("os.abort()", -signal.SIGABRT),
    ], lambda one: one[0] == "os._exit(0)"),
)  # fmt: skip
def test_a_script_that_a_plugin_ends_leaves_the_device_safe(tmp_path: Path, act: str, code: int) -> None:
    """The force stood for ever."""
    _, log = in_time(tmp_path, act, code)
    assert log[-1][2] == "0.0"


@pytest.mark.parametrize(
    ("act", "pause"),
    campaign.some([
        ("time.sleep(0.6)", "pass"), ("pass", "time.sleep(0.6)"),
    ], lambda one: one[0] == "pass"),
)  # fmt: skip
def test_while_no_tick_comes_from_a_script_the_device_is_safe_and_the_next_tick_tells_it(
    tmp_path: Path, act: str, pause: str
) -> None:
    """The force stood for as long as that, and then the session went on as if nothing had been."""
    said, log = in_time(tmp_path, act, 0, GOES_ON.format(pause=pause))
    assert "'stick' was made safe by the guardian: no tick came from this process" in said
    assert said.splitlines()[-1] == "closed"
    assert log[-1][2] == "close"


@pytest.mark.punctual
def test_a_script_that_is_suspended_and_woken_finds_the_device_safe(tmp_path: Path) -> None:
    script, log = begun(tmp_path / "one", "pass", GOES_ON.format(pause="pass"))
    wait_until(lambda: sum(what not in ("open", "0.0") for _, _, what in entries(log)) > 200, 60.0)
    os.kill(script.pid, signal.SIGSTOP)
    wait_until(lambda: entries(log)[-1][1] != script.pid)
    _, who, force = entries(log)[-1]
    os.kill(script.pid, signal.SIGCONT)
    said, _ = script.communicate(timeout=600)
    assert who != script.pid and force == "0.0"
    assert "or it was suspended" in said
    assert entries(log)[-1][2] == "close"


@pytest.mark.punctual
def test_a_script_whose_guardian_is_killed_stops(tmp_path: Path) -> None:
    killed = "session.run(0.3)\nos.kill(session._guardian._guarded.pid, signal.SIGKILL)\nsession.run(1.0)\n"
    script, log = begun(tmp_path / "one", "pass", killed)
    _, complained = script.communicate(timeout=600)
    assert script.returncode == 1
    assert "'stick' was made safe: the guardian process has died or hangs" in complained
    assert entries(log)[-1][2] == "0.0"


class Own:
    """Stands for an entry point of this process only."""

    value = "Stick"

    def __init__(self, cls: type) -> None:
        self.load = lambda: cls


def catalog(**attributes: Any) -> Catalog:
    """Return a catalog with a stick that only this process knows."""
    names: dict[str, Any] = {"__name__": "evil"}
    exec(PLUGIN.format(act="        pass", file=os.devnull), names)
    cls = type("Stick", (names["Stick"],), attributes)

    def finder(group: str) -> dict[str, Found]:
        own = {"itouch.devices": {"stick": cls}, "itouch.modalities": {"evil.it": names["Evil"]}}.get(group, {})
        found = {name: Found(name, "evil", "1.0", Own(one)) for name, one in own.items()}  # type: ignore[arg-type]
        return {**find(group), **found}

    return Catalog(finder)


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(Session, "GUARDIAN", f"{own_guardian.__name__}:watch")
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    return lambda **attributes: itouch.build(tmp_path / "scene.xml", catalog=catalog(**attributes))


def test_what_no_guardian_can_open_and_does_not_let_go_by_itself_is_not_enabled(built: Any) -> None:
    session = built()
    with pytest.raises(DeviceError, match="device 'stick' keeps its last command if this program dies, and a guardian"):
        session.enable()
    assert session.status("stick").name == "CLOSED"


@pytest.mark.parametrize(("watchdog", "needs"), [(0.2, False), (0.5, True)])
def test_what_lets_go_by_itself_soon_enough_needs_none(built: Any, watchdog: float, needs: bool) -> None:
    session = built(watchdog=watchdog)
    if needs:
        with pytest.raises(DeviceError, match="a guardian can't open it"):
            session.enable()
        return
    session.enable()
    session.run(0.05)
    session.close()
