"""What the doctor examines on the machine: system, processors, timer, priority, memory, graphics, sound, USB, disk."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from itouch.platforms import SERVO_PROCESS, cores, limit
from itouch.plugin.usb_permission import permission_advice
from itouch_tools.cli.doctor.diagnosis import Diagnosis
from itouch_tools.cli.doctor.disk_caches import compile_cache, kept_meshes, kept_results

_LIMITS = "as root write '@realtime - rtprio 90' and '@realtime - memlock unlimited' to "
_ADVICE = _LIMITS + "/etc/security/limits.d/99-realtime.conf, join that group, log in again"
#: Free disk space [bytes] below which the doctor says that recordings lack room.
ROOM = 1e9
#: Asks for OpenGL in a process of its own: a broken driver may take its process with it.
_ASK = """
from itouch_tools.viewer import offscreen
offscreen.open_context(64, 64)
from pyglet.gl import gl_info
print(gl_info.get_renderer(), "|", gl_info.get_version_string())
"""
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")

#: Extras for people who work on itouch-py itself.
_OWN = frozenset({"test", "lint", "docs", "mutation", "bids"})
_NEEDS = re.compile(r"^([A-Za-z0-9._-]+).*;.*extra\s*==\s*['\"]([A-Za-z0-9._-]+)['\"]")


def examine() -> list[Diagnosis]:
    """Return the findings on everything, the most important first."""
    looks: list[tuple[str, Callable[[], Diagnosis]]] = [
        ("system", system), ("processors", processors), ("kernel", kernel), ("timer", timer), ("priority", priority),
        ("memory lock", memory_lock), ("shared memory", shared_memory), ("compile cache", compile_cache),
        ("kept results", kept_results), ("kept meshes", kept_meshes), ("display", display), ("graphics", graphics),
        ("sound", sound), ("usb", usb), ("disk", disk), ("extras", extras),
    ]  # fmt: skip
    return [_safely(name, look) for name, look in looks]


def _safely(name: str, look: Callable[[], Diagnosis]) -> Diagnosis:
    try:
        return look()
    except Exception as error:
        return Diagnosis(name, "note", f"could not be examined: {type(error).__name__}: {error}")


def system() -> Diagnosis:
    """Operating system and Python."""
    found = f"{platform.system()} {platform.release()}, {platform.machine()}, Python {platform.python_version()}"
    if platform.system() != "Linux":
        return Diagnosis("system", "lack", found, "the servo process needs Linux; simulated sessions run elsewhere too")
    return Diagnosis("system", "ok", found)


def processors() -> Diagnosis:
    """How many processors there are, how many are isolated, and by which governors their clocks change."""
    from itouch.servo.realtime import isolated_cpus

    count, free = cores(), isolated_cpus()
    governors = {p.read_text().strip() for p in Path("/sys/devices/system/cpu").glob("cpu*/cpufreq/scaling_governor")}
    found = f"{count}" + (f", {len(free)} isolated" if free else ", none isolated")
    found += f", clock: {', '.join(sorted(governors))}" if governors else ""
    if count < 2:
        return Diagnosis("processors", "lack", found, "the loop and a window need a processor each: use two or more")
    if governors - {"performance"}:
        return Diagnosis("processors", "note", found, "as root: cpupower frequency-set -g performance")
    return Diagnosis("processors", "ok", found)


def kernel() -> Diagnosis:
    """Whether the kernel can be preempted everywhere."""
    version = platform.version()
    real = Path("/sys/kernel/realtime")
    if "PREEMPT_RT" in version or (real.exists() and real.read_text().strip() == "1"):
        return Diagnosis("kernel", "ok", "PREEMPT_RT")
    advice = "a PREEMPT_RT kernel bounds the rare late ticks; see the page on real-time kernels"
    return Diagnosis("kernel", "note", f"not PREEMPT_RT ({' '.join(version.split()[:3])})", advice)


def timer() -> Diagnosis:
    """How late a sleep of a millisecond ends."""
    resolution = time.clock_getres(time.CLOCK_MONOTONIC)
    late = []
    for _ in range(200):
        due = time.perf_counter() + 1e-3
        time.sleep(1e-3)
        late.append((time.perf_counter() - due) * 1e6)
    late.sort()
    found = (
        f"resolution {resolution * 1e9:.0f} ns; a sleep of 1 ms ends {late[100]:.0f} us late, at worst {late[-1]:.0f}"
    )
    if resolution > 1e-6 or late[100] > 500:
        return Diagnosis(
            "timer", "lack", found, "the kernel has no high-resolution timers: a 1 kHz loop can't be paced"
        )
    return Diagnosis("timer", "ok", found)


def priority() -> Diagnosis:
    """Whether the loop may have real-time priority."""
    from itouch_tools.cli.doctor.measured_loop import may_have_priority

    allowed = limit("RLIMIT_RTPRIO")
    if may_have_priority():
        return Diagnosis("priority", "ok", "SCHED_FIFO is given")
    return Diagnosis("priority", "lack", f"SCHED_FIFO is refused (limit {allowed})", _ADVICE)


def memory_lock() -> Diagnosis:
    """Whether the servo process may keep its pages in memory; it takes about 400 MiB."""
    allowed = limit("RLIMIT_MEMLOCK")
    if (hasattr(os, "geteuid") and os.geteuid() == 0) or allowed < 0 or allowed >= 1 << 30:
        return Diagnosis("memory lock", "ok", "as much as is needed")
    return Diagnosis("memory lock", "lack", f"at most {allowed >> 20} MiB", _ADVICE)


def shared_memory() -> Diagnosis:
    """Whether processes can share anonymous memory and find it."""
    if not SERVO_PROCESS:
        said = "processes can't find any here: the loop runs in a thread, on twins only; hardware needs Linux"
        return Diagnosis("shared memory", "note", said)
    handle = os.memfd_create("itouch-doctor")
    try:
        os.ftruncate(handle, 1 << 20)
        os.close(os.open(f"/proc/{os.getpid()}/fd/{handle}", os.O_RDWR))
    finally:
        os.close(handle)
    return Diagnosis("shared memory", "ok", "anonymous files, found through /proc")


def display() -> Diagnosis:
    """Whether a window can be shown."""
    wayland, x11 = os.environ.get("WAYLAND_DISPLAY"), os.environ.get("DISPLAY")
    if wayland or x11:
        return Diagnosis("display", "ok", f"WAYLAND_DISPLAY={wayland}" if wayland and not x11 else f"DISPLAY={x11}")
    advice = "log in on the machine's screen, or use ssh -X; without one, --screenshot and --film still draw"
    return Diagnosis("display", "lack", "none: sessions run without a window", advice)


def graphics() -> Diagnosis:
    """Which OpenGL driver draws, if any."""
    words = [sys.executable, "-P", "-c", _ASK]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    except subprocess.TimeoutExpired:
        return Diagnosis("graphics", "lack", "OpenGL does not answer", "update the graphics driver")
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no OpenGL 3.3"])[-1]
        return Diagnosis(
            "graphics", "lack", said, "install a driver with OpenGL 3.3, for example libgl1-mesa-dri, libegl1"
        )
    found = done.stdout.strip()
    if any(word in found.lower() for word in _SOFTWARE):
        return Diagnosis("graphics", "note", f"{found}: drawn by the processor", "the loop needs priority beside it")
    return Diagnosis("graphics", "ok", found)


def sound() -> Diagnosis:
    """Whether there is a sound card or a sound server."""
    cards = Path("/proc/asound/cards")
    listed = [line for line in cards.read_text().splitlines() if "[" in line] if cards.exists() else []
    runtime = Path(os.environ.get("XDG_RUNTIME_DIR", "/nonexistent"))
    servers = [name for name in ("pipewire-0", "pulse/native") if (runtime / name).exists()]
    if listed or servers:
        found = ", ".join([f"{len(listed)} cards"] * bool(listed) + servers)
        return Diagnosis("sound", "ok", found)
    return Diagnosis(
        "sound", "lack", "no card and no sound server", "sessions run silently; plug in a headset or a card"
    )


def usb() -> Diagnosis:
    """Whether this user may open the USB devices that are attached."""
    nodes = sorted(Path("/dev/bus/usb").glob("*/*"))
    if not nodes:
        return Diagnosis(
            "usb", "note", "no device is attached", "`itouch-py devices --probe` tells what a driver looks for"
        )
    shut = [str(node) for node in nodes if not os.access(node, os.W_OK)]
    if len(shut) < len(nodes):
        return Diagnosis("usb", "ok", f"{len(nodes) - len(shut)} of {len(nodes)} devices may be opened")
    return Diagnosis("usb", "lack", f"none of {len(nodes)} devices may be opened", permission_advice())


def disk() -> Diagnosis:
    """Room for recordings in the working folder: a session takes some 10 MB a minute."""
    free = shutil.disk_usage(".").free
    writable = os.access(".", os.W_OK)
    found = f"{free / 1e9:.0f} GB free in the working folder" + ("" if writable else ", which can't be written")
    if free > ROOM and writable:
        return Diagnosis("disk", "ok", found)
    return Diagnosis("disk", "lack", found, "change the folder")


def extras() -> Diagnosis:
    """Which extras are installed, with their packages, and which are not."""
    there, missing = [], []
    for name, packages in sorted(named(requires("itouch-py") or ()).items()):
        found = {package: _version(package) for package in packages}
        if all(found.values()):
            there.append(f"{name} ({', '.join(f'{package} {found[package]}' for package in packages)})")
        else:
            missing.append(name)
    said = ", ".join(there) or "none"
    if missing:
        return Diagnosis("extras", "note", f"{said}; not: {', '.join(missing)}",
                       f"pip install 'itouch-py[{missing[0]}]' brings one")  # fmt: skip
    return Diagnosis("extras", "ok", said)


def named(requirements: Iterable[str]) -> dict[str, list[str]]:
    """Return the packages that each extra asks for, given a distribution's requirements; without developers' extras."""
    found: dict[str, list[str]] = {}
    for line in requirements:
        match = _NEEDS.match(line)
        if match and match[2] not in _OWN and match[1].lower() != "itouch-py":
            found.setdefault(match[2], []).append(match[1])
    return found


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
