"""``itouch-py bench check``: the time that a check takes per element, in a small file and in the largest allowed."""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from itouch.plugin.commands import exit_code

#: Elements of a small file, and of the largest: the elements around them count, too.
FEW, MANY = 1_000, 100_000 - 20
#: How many times as long an element may take in the large file.
BOUND = 2.0
#: Number of small files that one command checks; and number of elements with which a command's own time is measured.
_COPIES, _NEARLY_NONE = 50, 4

_WOOD = '<materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>'
_ARM = '<devices><device name="arm" plugin="mouse"/></devices>'


def _place(index: int) -> str:
    """Return one of a million places that do not overlap."""
    return f'pos="{index % 100 * 30} {index // 100 % 100 * 30} {index // 10_000 * 30} mm"'


def _world(lines: Sequence[str]) -> str:
    return _WOOD + '<world temperature="23 degC">' + "\n".join(lines) + "</world>"


def _boxes(count: int) -> str:
    return _world([f'<box name="b{i}" {_place(i)} size="20 20 20 mm" material="wood"/>' for i in range(count)])


def _spheres(count: int) -> str:
    return _world([f'<sphere name="b{i}" {_place(i)} radius="10 mm" material="wood"/>' for i in range(count)])


def _materials(count: int) -> str:
    listed = (f'<material name="m{i}"><contact stiffness="1 N/mm"/></material>' for i in range(count // 2))
    return "<materials>" + "\n".join(listed) + "</materials>"


def _bases(count: int) -> str:
    """Return materials each of which has the next one as its base."""
    listed = [f'<material name="m{i}" base="m{i + 1}"/>' for i in range(count - 2)]
    last = f'<material name="m{count - 2}"><contact stiffness="1 N/mm"/></material>'
    return "<materials>" + "\n".join([*listed, last]) + "</materials>"


def _targets(count: int) -> str:
    listed = "\n".join(f'<to pos="0 0 {10 + i % 2} mm" in="0.1 s"/>' for i in range(count))
    probe = '<probe name="finger" radius="8 mm" pose-from="arm"/>'
    return f'{_ARM}<interaction>{probe}<operator probe="finger"><motion>{listed}</motion></operator></interaction>'


def _faults(count: int) -> str:
    return _ARM + "\n".join(f'<fault device="arm" kind="freeze" at="{i} ms" for="0.5 ms"/>' for i in range(count))


def _misspelt(count: int) -> str:
    return _world([f'<bok name="b{i}" {_place(i)}/>' for i in range(count)])


def _unknown(count: int) -> str:
    return _world([f'<box name="b{i}" {_place(i)} size="20 20 20 mm" material="m{i}"/>' for i in range(count)])


def _twice(count: int) -> str:
    return _world([f'<box name="b" {_place(i)} size="20 20 20 mm" material="wood"/>' for i in range(count)])


def _one_line(count: int) -> str:
    return _boxes(count).replace("\n", "")


#: Functions that return the content of a scene with so many elements, by kind.  The last five are wrong, or unusual.
KINDS: dict[str, Callable[[int], str]] = {
    "boxes": _boxes, "spheres": _spheres, "materials": _materials, "bases": _bases, "targets": _targets,
    "faults": _faults, "included": _boxes, "misspelt": _misspelt, "unknown": _unknown, "same-name": _twice,
    "one-line": _one_line,
}  # fmt: skip


def main(argv: Sequence[str]) -> int:
    """Check scenes with few and with very many elements; exit code 1 if an element takes much longer in the large."""
    parser = argparse.ArgumentParser(prog="itouch-py bench check", description=main.__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; default: all")
    parser.add_argument("--many", type=int, default=MANY, metavar="N", help=f"elements of the large file ({MANY})")
    options = parser.parse_args(argv)
    wrong = sorted(set(options.kinds) - set(KINDS))
    if wrong or not FEW < options.many <= MANY:
        parser.error(f"no kind {', '.join(wrong)}" if wrong else f"--many is from {FEW + 1} to {MANY}")
    verdicts = []
    print(f"CPU time of `itouch-py check` an element; bound: {BOUND:g} times that of {FEW} elements")
    for kind in options.kinds or KINDS:
        small, large = times(kind, options.many)
        good = large <= BOUND * small
        verdicts.append(good)
        told = f"{small * 1e6:5.0f} us of {FEW}, {large * 1e6:5.0f} us of {options.many}: {large / small:4.2f} times"
        print(f"{'ok  ' if good else 'SLOW'} {kind:<10} {told}", flush=True)
    return exit_code(verdicts)


def times(kind: str, many: int) -> tuple[float, float]:
    """Return the time [s] per element in scenes of few and in one of many, without the command's own time.

    One command checks all small scenes, which together have as many elements as the large one, or half as many.
    """
    with tempfile.TemporaryDirectory() as folder:
        itself = check([written(kind, _NEARLY_NONE, Path(folder, "none"))])
        copies = max(2, min(_COPIES, many // FEW))
        small = check([written(kind, FEW, Path(folder, f"few{i}")) for i in range(copies)]) - itself
        large = check([written(kind, many, Path(folder, "many"))]) - itself
    return small / (copies * FEW), large / many


def written(kind: str, count: int, folder: Path) -> str:
    """Write a scene; return its path."""
    folder.mkdir()
    content = KINDS[kind](count)
    if kind == "included":
        (folder / "part.xml").write_text(f'<itouch version="1.0">{content}</itouch>\n', encoding="utf-8")
        content = '<include file="part.xml"/>'
    path = folder / "scene.xml"
    path.write_text(f'<itouch version="1.0">{content}</itouch>\n', encoding="utf-8")
    return str(path)


def check(paths: Sequence[str]) -> float:
    """Return the processor time [s] of a command that checks scenes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words, nothing = [sys.executable, "-P", "-m", "itouch_tools.cli", "check", *paths], subprocess.DEVNULL
    subprocess.run(words, stdout=nothing, stderr=nothing, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
