"""Installs each extra alone in a new environment: what it brings can be imported, and ``doctor`` says that it is there.

``python .ci/extras.py WHEEL [NAME ...] [--page docs/reference/extras.md]``: without names all that users have.  The
environments are made by `uv`, which shares files between them; what is installed are the versions of constraints.txt.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Extras of those who work on itouch-py itself; ``doctor`` does not name them.
OWN = ("test", "lint", "docs", "mutation", "bids")
#: What is run in the new environment: import all top-level modules of the distributions that an extra asks for.
IMPORTS = """
import importlib, json, os, sys
os.environ["GIT_PYTHON_REFRESH"] = "quiet"
from importlib.metadata import distribution, packages_distributions, version
wanted, found = json.loads(sys.argv[1]), {}
owners = packages_distributions()
norm = lambda name: name.lower().replace("_", "-")
for name in wanted:
    tops = sorted(top for top, own in owners.items() if norm(name) in map(norm, own) and top.isidentifier()
                  and not top.startswith("_") and top not in ("messages", "scripts", "tests"))
    for top in tops:
        importlib.import_module(top)
    found[name] = [version(name), tops]
import itouch, itouch.plugin
print(json.dumps(found))
"""


@dataclass(frozen=True, slots=True)
class Result:
    """What one extra brought: its packages with versions and modules, all that came with them, what was wrong."""

    name: str
    found: dict[str, tuple[str, list[str]]]
    more: int
    said: str
    wrong: str


def main() -> int:
    """Try the extras, print what they bring, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    names = options.names or [name for name in sorted(wanted) if name not in OWN]
    base = _packages(*_environment(options.wheel, ""))
    results = []
    for name in names:
        results.append(_try(options.wheel.resolve(), name, _named(wanted, name), base))
        print(f"{name:<18} {results[-1].wrong or 'ok'}: {results[-1].said}", flush=True)
    if options.page:
        options.page.write_text(_page(results, options.wheel), encoding="utf-8")
    return 1 if any(result.wrong for result in results) else 0


def _named(wanted: dict[str, list[str]], name: str) -> list[str]:
    """Return the distributions that an extra asks for, through other extras, too."""
    found: list[str] = []
    for line in wanted[name]:
        own = re.match(r"itouch-py\[([\w-]+)\]", line)
        found += _named(wanted, own[1]) if own else [re.match(r"[\w.-]+", line)[0]]  # type: ignore[index]
    return found


def _environment(wheel: Path, extra: str) -> tuple[Path, str]:
    """Return a new environment with the wheel and an extra, and what was said if that failed."""
    place = Path(tempfile.mkdtemp(prefix="itouch-extra-"))
    target = f"{wheel.resolve()}[{extra}]" if extra else str(wheel.resolve())
    # versions as pinned; hashes stay in CI, where all come from one file
    pins = place / "pins.txt"
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pins.write_text("\n".join(re.findall(r"^[\w.-]+==[^ \\]+", text, re.M)) + "\n", encoding="utf-8")
    said = ""
    made = str(place / "venv/bin/python")
    for words in (["venv", "--python", sys.executable, str(place / "venv")],
                  ["pip", "install", "--python", made, "-c", str(pins), target]):  # fmt: skip
        done = subprocess.run(["uv", "-q", *words], capture_output=True, text=True)
        said += done.stderr if done.returncode else ""
    return place, said


def _packages(place: Path, said: str) -> int:
    """Return how many distributions an environment has, and remove it.

    Raises
    ------
    RuntimeError
        If it could not be made.
    """
    count = len(list(place.glob("venv/lib/*/site-packages/*.dist-info")))
    shutil.rmtree(place, ignore_errors=True)
    if said:
        raise RuntimeError(said)
    return count


def _try(wheel: Path, name: str, wanted: list[str], base: int) -> Result:
    place, wrong = _environment(wheel, name)
    found, said = {}, ""
    try:
        python, clean = str(place / "venv/bin/python"), {**os.environ, "PYTHONPATH": ""}
        if not wrong:
            done = subprocess.run(
                [python, "-c", IMPORTS, json.dumps(wanted)], capture_output=True, text=True, env=clean
            )
            wrong = done.stderr.strip().rpartition("\n")[2] if done.returncode else ""
            found = json.loads(done.stdout) if not wrong else {}
        if not wrong:
            told = subprocess.run(
                [python, "-m", "itouch_tools.cli", "doctor", "--json"], capture_output=True, text=True, env=clean
            )
            said = next(one["found"] for one in json.loads(told.stdout)["checks"] if one["name"] == "extras")
            there = re.findall(r"([\w-]+) \(", said.partition("; not:")[0])
            if wanted and name not in there:
                wrong = "doctor does not name it"
        more = len(list(place.glob("venv/lib/*/site-packages/*.dist-info"))) - base - len(wanted)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return Result(name, found, more, said.partition("; not:")[0], wrong)


def _page(results: list[Result], wheel: Path) -> str:
    lines = [
        "# Extras",
        "",
        "Optional packages: `pip install 'itouch-py[NAME]'`. Each was installed alone into a new environment, with the",
        "versions of `constraints.txt`; what it asks for was imported, and `itouch-py doctor` was asked what is there.",
        f"Made by `python .ci/extras.py {wheel.name} --page docs/reference/extras.md`.",
        "",
        "| extra | brings | modules that were imported | further packages | doctor names |",
        "|---|---|---|---|---|",
    ]
    for one in results:
        brings = ", ".join(f"{name} {version}" for name, (version, _) in one.found.items()) or "nothing"
        modules = ", ".join(f"`{top}`" for _, tops in one.found.values() for top in tops)
        named = one.wrong or ", ".join(re.findall(r"([\w-]+) \(", one.said)) or "-"
        lines.append(f"| `{one.name}` | {brings} | {modules} | {max(0, one.more)} | {named} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
