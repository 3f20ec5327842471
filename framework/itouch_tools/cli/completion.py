"""``itouch-py completion bash|zsh|fish``: a script with which Tab completes commands, options and files."""

from __future__ import annotations

import argparse
import contextlib
import io
from collections.abc import Callable, Sequence
from typing import Any

from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.shells import WRITERS, Command, Option


def main(argv: Sequence[str]) -> int:
    """Write the script with which a shell completes the commands and options of itouch-py."""
    parser = Parser(
        prog="itouch-py completion", description=main.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='bash: eval "$(itouch-py completion bash)" in ~/.bashrc\n'
        'zsh:  eval "$(itouch-py completion zsh)" in ~/.zshrc, after compinit\n'
        "fish: itouch-py completion fish > ~/.config/fish/completions/itouch-py.fish",
    )  # fmt: skip
    parser.add_argument("shell", choices=tuple(WRITERS), help="for which shell")
    shell = parser.parse_args(argv).shell
    print(WRITERS[shell](commands()), end="")
    return 0


class _Parsed(BaseException):
    """Stops a command where it would parse its words, and carries its parser."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        super().__init__()
        self.parser = parser


def commands() -> dict[str, Command]:
    """Return every command with its options and words, as its own parser has them; no command is run."""
    from itouch_tools.cli import COMMANDS, listed

    found = {}
    for name, text in listed().items():
        found[name] = Command(name, text)
        with contextlib.suppress(Exception, SystemExit):  # a plugin's command may do anything
            parser = _parser_of(name, COMMANDS)
            if parser is not None:
                _read(parser, found[name])
    if "bench" in found:
        from itouch.plugin.discovery import BENCHES, find

        found["bench"].words = sorted(find(BENCHES))
    return found


def _parser_of(name: str, own: dict[str, tuple[str, str]]) -> argparse.ArgumentParser | None:
    """Return the parser with which a command parses its words; None if it has none."""
    from importlib import import_module

    from itouch.plugin.discovery import COMMANDS as GROUP
    from itouch.plugin.discovery import find

    run: Callable[[list[str]], Any] = import_module(own[name][0]).main if name in own else find(GROUP)[name].load()

    def stop(self: argparse.ArgumentParser, *_: Any, **__: Any) -> Any:
        raise _Parsed(self)

    kind: Any = argparse.ArgumentParser
    before, quiet = (kind.parse_args, kind.parse_known_args), io.StringIO()
    kind.parse_args = kind.parse_known_args = stop
    try:
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            run(["--help"])
    except _Parsed as parsed:
        return parsed.parser
    finally:
        kind.parse_args, kind.parse_known_args = before
    return None


def _read(parser: argparse.ArgumentParser, command: Command) -> None:
    """Copy what a parser takes into a command: sub-commands, options and words."""
    for action in parser._actions:  # noqa: SLF001  (argparse has no public list of what it takes)
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            helps = {choice.dest: choice.help or "" for choice in action._choices_actions}  # noqa: SLF001
            for name, inner in action.choices.items():
                command.inner[name] = Command(name, _line(helps.get(name, "")))
                _read(inner, command.inner[name])
        elif action.option_strings:
            if "--help" not in action.option_strings and action.help != argparse.SUPPRESS:
                command.options.append(_option(action))
        elif action.choices:
            command.words += [str(choice) for choice in action.choices]


def _option(action: argparse.Action) -> Option:
    choices = tuple(str(choice) for choice in action.choices or ())
    takes = action.nargs != 0 and action.nargs not in ("?", "*")
    return Option(tuple(action.option_strings), _line(action.help or ""), choices, takes)


def _line(text: str) -> str:
    return " ".join(text.replace("%%", "%").split())
