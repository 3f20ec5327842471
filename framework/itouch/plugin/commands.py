"""What a plugin's command or bench needs: the framework above the plugins, a parser, and one way to judge figures.

A device or a modality must not use it: it is itself run by the framework.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any, cast


def framework() -> Any:
    """Return the module ``itouch``, whose functions load and build scenes, as in a user's script.

    It is imported here and no earlier, because the framework imports a plugin's module before it is complete itself.
    """
    return import_module("itouch")


def command_parser(program: str, description: str | None) -> argparse.ArgumentParser:
    """Return a parser as the framework's own commands have it, sub-commands included.

    Its help lists the options that every command has, and it refuses outputs (`output_file`) that would replace a file
    that the command reads, one that such a file names, another output, or a scene, a session or a recording.

    Parameters
    ----------
    program, description
        How the command is called, such as ``itouch-py thermal``, and what it does.
    """
    parsers = import_module("itouch_tools.cli.arguments")  # of a higher layer, as in `framework`
    return cast("argparse.ArgumentParser", parsers.parser_of(program, description))


def output_file(noun: str = "", *endings: str) -> Callable[[str], str]:
    """Return the ``type`` of an argument that names a file to be written; it is checked before anything runs.

    Parameters
    ----------
    noun, endings
        What is written, and what its name must end in, such as ``("table", ".csv", ".png")``; nothing: any name.
    """
    return cast("Callable[[str], str]", import_module("itouch_tools.cli.output_files").Output(noun, endings))


def output_folder(text: str) -> str:
    """Check, before anything runs, that a folder can be made or written into: the ``type`` of such an argument.

    Raises
    ------
    argparse.ArgumentTypeError
        If it cannot.
    """
    return cast("str", import_module("itouch_tools.cli.output_files").output_folder(text))


def judged(holds: bool | None) -> str:
    """Return the word beside a figure that keeps its bound, or does not; of one without a bound nothing."""
    return "" if holds is None else "ok" if holds else "MISSED"


def exit_code(verdicts: Iterable[bool | None]) -> int:
    """Return the exit code of a command that judges figures: 1 if one of them misses its bound, else 0.

    Parameters
    ----------
    verdicts
        Of each figure, whether it keeps its bound; None: it has none.
    """
    return int(any(holds is not None and not holds for holds in verdicts))
