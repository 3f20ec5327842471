"""``itouch-py explain CODE``: what the code of a message means, and the smallest input that causes it."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser

if TYPE_CHECKING:
    from itouch_tools.cli.explain.example import Example


def main(argv: Sequence[str]) -> int:
    """Explain the code of a message, such as error[unknown-name]; without one, list all codes."""
    parser = Parser(prog="itouch-py explain", description=main.__doc__)
    parser.add_argument("code", nargs="?", metavar="CODE", help="what stands in the brackets of the message")
    code = parser.parse_args(argv).code
    return _list() if code is None else _explain(code.strip("[]").rpartition("[")[2])


def examples() -> dict[str, Example]:
    """Return an example for each code, by code."""
    from itouch_tools.cli.explain.binding_examples import BINDINGS, DEVICES
    from itouch_tools.cli.explain.mesh_examples import MESHES
    from itouch_tools.cli.explain.problem_examples import FILES, NAMES, ODD, VALUES
    from itouch_tools.cli.explain.trip_examples import trips

    return {**FILES, **NAMES, **VALUES, **DEVICES, **BINDINGS, **MESHES, **ODD, **trips()}


def _list() -> int:
    from itouch_tools.authoring.codes import HEADINGS

    for heading, codes in HEADINGS.items():
        print(f"\n{heading}\n")
        for code in codes:
            print(f"  {code.name:<21} {code.wrong}")
    return 0


def _explain(name: str) -> int:
    from itouch.schema.diagnostics import did_you_mean
    from itouch_tools.authoring.codes import CODES
    from itouch_tools.cli.explain.example import play

    code = CODES.get(name)
    if code is None:
        advice = did_you_mean(name, CODES, "codes are")
        if re.fullmatch(r"[KTW]\d", name):
            telling = [one.name for one in CODES.values() if re.search(rf"\([^)]*\b{name}\b[^)]*\)", one.wrong)]
            advice = f"{name} is a limit: itouch-py {f'explain {telling[0]}' if telling else 'check SCENE'} tells of it"
        print(f"error: there is no code '{name}'\n  = help: {advice}", file=sys.stderr)
        return 2
    example = examples()[name]
    print(f"{name}: {code.wrong}.\nWhat to do: {code.remedy}.\n\nFor example\n")
    print(_indented(example.text))
    print("\ngives\n", flush=True)
    with waiting(f"running the example of {name}"):
        printed = play(example)
    print(_indented(printed))
    return 0


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.strip("\n").splitlines())
