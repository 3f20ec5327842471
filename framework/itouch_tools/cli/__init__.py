"""The command line: one file per command, imported only when the command is used, so that help is instant."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING

from itouch.gc_policy import keep_collections_rare
from itouch.process_exit import AT_ONCE

if TYPE_CHECKING:
    from itouch.plugin.discovery import Found
    from itouch.schema import ItouchError

#: For each command its module and one line of help.
COMMANDS = {
    "run": ("itouch_tools.cli.run", "run a scene, or go on with a saved session (the default command)"),
    "check": ("itouch_tools.cli.check", "print every problem of scene files"),
    "watch": ("itouch_tools.cli.watch", "check a scene at each save"),
    "completion": ("itouch_tools.cli.completion", "write the script with which Tab completes, for bash, zsh or fish"),
    "explain": ("itouch_tools.cli.explain", "say what the code of a message means, with an example"),
    "devices": ("itouch_tools.cli.devices", "list the device plugins that are installed"),
    "demo": ("itouch_tools.cli.demo", "run the four-material scene that comes with the program"),
    "doctor": ("itouch_tools.cli.doctor", "say what this machine can do, and whether a person should put a finger in"),
    "calibrate": (
        "itouch_tools.cli.calibrate",
        "measure what devices need, and keep it with its date beside the scene",
    ),
    "virtual-rig": ("itouch_tools.cli.virtual_rig", "simulate the devices of a scene behind their real protocols"),
    "bench": ("itouch_tools.cli.bench", "measure accuracy and speed"),
    "inspect": ("itouch_tools.cli.inspect", "say what a scene, a session or a recording holds"),
    "export": ("itouch_tools.cli.export", "write a session as XML, or a recording as tables"),
    "new-plugin": ("itouch_tools.cli.new_plugin", "start a plugin: a complete distribution with numbered steps"),
    "new-scene": ("itouch_tools.cli.new_scene", "start a scene, with completion in editors"),
    "new-study": ("itouch_tools.cli.new_study", "start a psychophysical study, with its scene"),
    "schema": ("itouch_tools.cli.schema", "write the scene language as XML Schema, for editors"),
    "test-plugin": (
        "itouch_tools.cli.test_plugin",
        "examine an installed plugin: the conformance suite with a score card",
    ),
    "report": ("itouch_tools.cli.report", "write one page of a session: plots, contacts, faults, provenance"),
    "view": ("itouch_tools.cli.view", "open a window on a session that runs"),
    "replay": ("itouch_tools.cli.replay", "feed a recording to the engine and compare every command"),
    "sync": ("itouch_tools.cli.sync", "measure the delay between a mark and the wire on this machine"),
    "study": ("itouch_tools.cli.study", "check, freeze, run, simulate, report, power and audit psychophysical studies"),
    "sweep": ("itouch_tools.cli.sweep", "run a scene many times with parameters by path, on this machine or a cluster"),
    "recover": ("itouch_tools.cli.recover", "write the longest valid part of a damaged recording as a whole one"),
}

_USAGE = """\
usage: itouch-py SCENE.xml|SESSION.itouch [options]
       itouch-py COMMAND ...

Touch rendering with kinesthetic and thermal feedback.

commands:
{commands}

{common}
`itouch-py COMMAND --help` tells the options of a command, `itouch-py run --help` those of running a scene.
"""


#: Signals that asked this process to end, where it runs as a program and no command answers them in a way of its own.
_interrupts: list[int] = []


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0 done, 1 a fault while running, 2 wrong input."""
    if argv is None:
        _note_interrupts()
        keep_collections_rare()
    try:
        return _main(argv)
    except KeyboardInterrupt:  # before a command began, or after it
        return _interrupted()


def _note_interrupts() -> None:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does, and note each: an import may make another error of it.

    A command that was ended at once would leave half a file.  A SIGHUP that is ignored (``nohup``) stays ignored.
    """
    own, last = os.getpid(), [-math.inf]

    def note(number: int, frame: FrameType | None) -> None:
        if os.getpid() != own and number != signal.SIGINT:  # a process that was forked ends as any other
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        begun, now = last[0], time.monotonic()
        if now - begun < AT_ONCE:
            return
        last[0] = now
        _interrupts.append(number)
        raise KeyboardInterrupt

    for name, usual in (
        ("SIGINT", signal.default_int_handler),
        ("SIGTERM", signal.SIG_DFL),
        ("SIGHUP", signal.SIG_DFL),
    ):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == usual:
            signal.signal(number, note)


def _interrupted() -> int:
    from itouch_tools.cli.shutdown import code_of

    number = _interrupts[-1] if _interrupts else signal.SIGINT
    by = "" if number == signal.SIGINT else f" by {signal.Signals(number).name}"
    with contextlib.suppress(OSError, ValueError):  # the terminal may have been closed
        print(f"interrupted{by}", file=sys.stderr)
    return code_of(number)


def _main(argv: Sequence[str] | None) -> int:
    words = list(sys.argv[1:] if argv is None else argv)
    from itouch.schema.diagnostics import ItouchError
    from itouch.schema.terminal import escaped
    from itouch_tools.cli import command_options

    _need_streams()
    try:
        words, common = command_options.taken(words)
    except ItouchError as error:
        with escaped():
            print(error, file=sys.stderr)
        return 2
    if argv is None:
        from itouch.process_exit import refuse_sudden_ends

        refuse_sudden_ends()
    with command_options.speaking(common), escaped():
        code = _guarded(words)
        if argv is None:  # as a program: it ends here, whatever threads still run
            from itouch_tools.cli.shutdown import end_threads

            end_threads(code)
        return code


#: What a program may not do beyond a limit of the system, and what helps, by the number of the error.
_LIMITS = {
    errno.EMFILE: "too many files are open\n  = help: raise the limit (ulimit -n)",
    errno.ENFILE: "too many files are open on this machine\n  = help: end other programs",
    errno.EFBIG: "no file may be as large as is needed\n  = help: raise the limit (ulimit -f)",
    errno.EAGAIN: "no more threads can be started, or processes\n"
    "  = help: end other programs, or raise the limit (ulimit -u)",
    errno.ENOMEM: "memory has run out\n  = help: end other programs, or raise the limit (ulimit -v)",
}


def _guarded(words: list[str]) -> int:
    """Run a command; what a user or a device can cause becomes a message, never a traceback."""
    from itouch.schema.diagnostics import ItouchError
    from itouch.schema.terminal import detail
    from itouch.schema.wait_notices import shown_by
    from itouch_tools.cli import progress
    from itouch_tools.cli.shutdown import code_of, stop_writing

    begun = time.perf_counter()
    try:
        with shown_by(progress.shown):
            code = _dispatch(words)
        if code == 0 and _interrupts and _interrupts[-1] != signal.SIGINT:  # to a command, Ctrl-C may be its usual end
            code = code_of(_interrupts[-1])
        sys.stdout.flush()
        detail(f"{words[0] if words else 'itouch-py'}: {time.perf_counter() - begun:.2f} s")
        return code
    except ItouchError as error:
        return _told(error)
    except BrokenPipeError:
        stop_writing()
        return 141
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):  # where the output goes
            stop_writing()
            print(f"cannot write: {error.strerror}", file=sys.stderr)
            return 2
        if _interrupts:
            return _interrupted()
        if not _stands():
            print("error: the current folder has been removed\n  = help: change to another one", file=sys.stderr)
            return 2
        if error.errno not in _LIMITS:  # any other error here is a bug
            raise
        print(f"error: {_LIMITS[error.errno]}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _interrupted()
    except MemoryError:
        print(f"error: {_LIMITS[errno.ENOMEM]}", file=sys.stderr)
        return 2
    except Exception as error:
        if _interrupts:
            return _interrupted()
        if isinstance(error, ModuleNotFoundError) and str(error.name).startswith("itouch"):
            advice = "it was changed while it ran: start it again; or install it again"
            print(f"error: a part of the program is missing ({error.name})\n  = help: {advice}", file=sys.stderr)
            return 2
        if isinstance(error, RuntimeError) and str(error) == "can't start new thread":  # Python's, without a number
            print(f"error: {_LIMITS[errno.EAGAIN]}", file=sys.stderr)
            return 2
        raise
    except SystemExit:  # of a parser: what it printed must be flushed here, where the reader may be gone
        with contextlib.suppress(BrokenPipeError):
            sys.stdout.flush()
            raise
        stop_writing()
        return 141


def _stands() -> bool:
    """Tell whether the current folder is still there."""
    try:
        return bool(os.getcwd())
    except OSError:
        return False


def _told(error: ItouchError) -> int:
    """Print what is wrong, unless the reader of the output is gone; return the exit code."""
    from itouch_tools.cli.shutdown import stop_writing

    try:
        print(error, *getattr(error, "__notes__", ()), sep="\n", file=sys.stderr, flush=True)
    except BrokenPipeError:
        stop_writing()
    return error.exit_code


def _need_streams() -> None:
    """Give a process that was started without output streams ones that discard everything."""
    from itouch.platforms import keep_standard_numbers

    keep_standard_numbers()
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def _dispatch(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help", "help"):
        return _help(words)
    name = words[0]
    if name in ("-V", "--version"):
        from importlib.metadata import version

        print(f"itouch-py {version('itouch-py')}")
        return 0
    _tell_relative_folders()
    if name in COMMANDS:
        return int(import_module(COMMANDS[name][0]).main(words[1:]))
    plugin = _plugin_commands().get(name)
    if plugin is not None:
        return int(plugin.load()(words[1:]))
    if _looks_like_a_command(name):
        return _unknown(name)
    return int(import_module("itouch_tools.cli.run").main(words))


def _tell_relative_folders() -> None:
    """Print a note for each environment variable that names a folder by a relative path, which does not count."""
    from itouch.caches import relative_switches
    from itouch.schema.terminal import note

    for switch, given in relative_switches().items():
        note(f"{switch} is ignored: it must be a full path, or off, not '{given}'")


def _help(words: list[str]) -> int:
    if len(words) > 1 and not words[1].startswith("-"):  # `itouch-py help check`
        return _dispatch([words[1], "--help"])
    from itouch_tools.cli.command_options import HELP, in_columns

    print(_USAGE.format(commands=in_columns(listed()), common=HELP))
    return 0 if words else 2


def _looks_like_a_command(name: str) -> bool:
    return not name.startswith("-") and "." not in name and "/" not in name and not os.path.exists(name)


def _unknown(name: str) -> int:
    from itouch.schema.diagnostics import did_you_mean

    advice = did_you_mean(name, [*COMMANDS, *_plugin_commands()], "commands are")
    print(f"error: there is no command or file named '{name}'\n  = help: {advice}", file=sys.stderr)
    return 2


def _plugin_commands() -> dict[str, Found]:
    from itouch.plugin.discovery import COMMANDS as GROUP
    from itouch.plugin.discovery import find

    return find(GROUP)


def listed() -> dict[str, str]:
    """Return the line of help of each command, those of plugins included; no plugin is imported for it."""
    from importlib.metadata import entry_points

    from itouch_tools.cli.synopsis import synopsis

    lines = {name: text for name, (_, text) in COMMANDS.items()}
    for entry in entry_points(group="itouch.commands"):
        if entry.name not in lines:
            lines[entry.name] = synopsis(entry) or f"command of {entry.dist.name if entry.dist else 'a plugin'}"
    return dict(sorted(lines.items()))
