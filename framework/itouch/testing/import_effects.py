"""A check that importing a plugin does nothing but define things."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

from itouch.testing.checks import CheckError, NotApplicableError, check

_WATCH = """
import sys
sys.path[:0] = {path!r}
sys.dont_write_bytecode = True  # what Python itself would write is not the plugin's doing
import itouch.plugin, itouch.testing
from itouch.testing.process_state import ProcessState, open_files
import importlib, threading
seen, asks = [], ("socket.connect", "socket.bind", "socket.__new__", "subprocess.Popen", "os.system", "time.sleep")
def watch(event, words):
    if event in asks:
        seen.append("it calls " + event + str(tuple(words[-1:])))
    if event == "open" and isinstance(words[0], str) and words[0].startswith("/dev/"):
        if words[0] not in ("/dev/null", "/dev/urandom", "/dev/random"):
            seen.append("it opens " + words[0])
    if event == "open" and isinstance(words[1], str) and set(words[1]) & set("wax+"):
        if "__pycache__" not in str(words[0]):
            seen.append("it writes " + str(words[0]))
for name, function in (("usb.core", "find"), ("serial", "Serial"), ("serial", "serial_for_url"),
                       ("serialx", "Serial"), ("serialx", "serial_for_url")):
    try:
        library = importlib.import_module(name)
    except ImportError:
        continue
    def told(*a, library=name, function=function, real=getattr(library, function), **k):
        seen.append("it calls " + library + "." + function)
        return real(*a, **k)
    if isinstance(getattr(library, function), type(told)):
        setattr(library, function, told)
threads, files, before = threading.active_count(), open_files(), ProcessState()
sys.addaudithook(watch)
try:
    importlib.import_module({module!r})
except Exception as error:
    print("CANNOT", type(error).__name__, error)
    sys.exit(0)
except BaseException as error:
    seen.append("it raises " + type(error).__name__)
if threading.active_count() > threads:
    seen.append("it starts a thread")
seen += ["it changes " + change for change in before.changes() if not change.startswith("the search path")]
seen += ["it leaves " + what + " open" for number, what in open_files().items() if number not in files]
print("SEEN", seen[0] if seen else "")
"""


@check("import", "importing it does nothing")
def imported(harness: Any) -> None:
    """Import the plugin's module in a new process that watches what it does."""
    name = harness.cls.__module__
    module = sys.modules.get(name)
    if module is None or name == "__main__" or not getattr(module, "__file__", None):
        raise NotApplicableError("the class is not in a module that can be imported")
    script = _WATCH.format(path=sys.path, module=name)
    try:
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30)
    except subprocess.TimeoutExpired as error:
        raise CheckError(
            f"importing {name} does not end within 30 s",
            cause="hardware is waited for at import",
            advice="do it in open()",
        ) from error
    lines = done.stdout.strip().splitlines()
    told = next((line for line in reversed(lines) if line.startswith(("SEEN", "CANNOT"))), "")
    if told.startswith("CANNOT"):
        raise NotApplicableError(f"{name} can't be imported by itself: {told.removeprefix('CANNOT ')}")
    if not told:
        raise CheckError(
            f"importing {name} ends the process with exit code {done.returncode}",
            cause="os._exit, or a crash",
            advice="a plugin never ends the program; look for hardware in open()",
        )
    seen = told.removeprefix("SEEN").strip()
    if not seen and lines[:-1]:
        seen = f"it prints {lines[0][:60]!r}"
    if seen:
        raise CheckError(
            f"importing {name}: {seen}",
            cause="something is done at import: hardware is looked for, or a setting of the process is changed",
            advice="do it in open(), and leave the process as it is",
        )
