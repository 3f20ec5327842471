"""``itouch-py watch SCENE``: check a scene at each save, and say what has changed for the better or the worse."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.check import say

#: Period [s] at which the files are checked for changes.
LOOK = 0.25


def main(argv: Sequence[str]) -> int:
    """Check a scene at each save, until Ctrl-C."""
    parser = Parser(prog="itouch-py watch", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE", help="a scene file; what it includes is watched, too")
    parser.add_argument("--rig", metavar="FILE", help="check with another rig under the scene")
    parser.add_argument("--twin", metavar="all|none|NAME", help="check with these devices as twins")
    parser.add_argument("--strict", action="store_true", help="treat what is legal but odd as wrong")
    options = parser.parse_args(argv)
    return follow(
        lambda: say(options.scene, options.rig, options.twin, strict=options.strict),
        lambda: stamps(options.scene, options.rig),
    )


def follow(
    check: Callable[[], bool],
    look: Callable[[], dict[str, int]],
    *,
    rest: Callable[[float], None] = time.sleep,
    going: Callable[[], bool] = lambda: True,
) -> int:
    """Call ``check`` whenever ``look`` returns something new, while ``going``; return the last check's exit code."""
    seen: dict[str, int] | None = None
    good = True
    try:
        while going():
            now = look()
            if now != seen:
                seen = now
                print(f"\n{time.strftime('%H:%M:%S')}")
                good = check()
                print("watching; Ctrl-C ends it", flush=True)
            rest(LOOK)
    except KeyboardInterrupt:
        pass
    return 0 if good else 2


def stamps(scene: str, rig: str | None) -> dict[str, int]:
    """Return when each XML file beside and below a scene, and its rig, was last changed [ns]; 0: it is missing."""
    folder = Path(os.path.dirname(scene) or ".")
    found = {}
    for path in [Path(scene), *([Path(rig)] if rig else []), *_xml_below(folder)]:
        try:
            found[os.fspath(path)] = path.stat().st_mtime_ns
        except OSError:  # an editor may be replacing the file by moving a new one there
            found[os.fspath(path)] = 0
    return found


def _xml_below(folder: Path) -> list[Path]:
    """Return the XML files in a folder and in its immediate subfolders, 500 at most."""
    return sorted([*folder.glob("*.xml"), *folder.glob("*/*.xml")])[:500]
