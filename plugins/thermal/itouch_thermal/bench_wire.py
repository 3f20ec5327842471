"""``itouch-py bench wire``: a scene on its devices' real protocols, scored by what the twins behind the emulators know.

Every row is a run of ``itouch-py virtual-rig SCENE --run``, whose plant differs from what the controller is told.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from itouch_thermal.display.params import DisplayParams

SPACE = "{urn:itouch:plugin:thermal}"
#: Most true error of the finger's flux, rms from 0.1 s to lift-off: on a TEC controller, and on a rig of one's own,
#: whose thermistors are slow and whose current follows a command in some 12 ms; and how many times that in the corners.
BOUND, OWN_RIG, CORNER = 0.03, 0.05, 2.0
#: The corners: by how much the plant may differ, in both directions.
WIDE = {"contact-resistance": 0.2, "seebeck": 0.1, "delay": 5e-3, "sensor-lag": 0.3}
#: The program that is installed with this one.
PROGRAM = "from itouch_tools.cli import main; raise SystemExit(main())"
#: Wires that are better than the scene's: attributes of elements inside a display's hardware, and of it (empty).
_RAISED = ("mecom", "session-baud", "460800")
FASTER = {
    "460800 baud for the session": (_RAISED,),
    "flux averaged for 20 ms": (("labjack", "averaging", "20 ms"),),
    "460800 baud, flux averaged for 4 ms": (_RAISED, ("labjack", "averaging", "4 ms")),
    "460800 baud, flux averaged for 20 ms": (_RAISED, ("labjack", "averaging", "20 ms")),
}
#: A plant that differs much, and for long.
DIFFERS = {"contact-resistance": 0.2, "seebeck": -0.1}

Mismatch = Mapping[str, float]
#: Element inside the hardware (empty: itself), attribute, and what is written there.
Wire = tuple[str, str, str]


def main(argv: Sequence[str]) -> int:
    """Print the true error of the finger's flux per material, each beside its bound; 1 if one is passed."""
    parser = argparse.ArgumentParser(prog="itouch-py bench wire", description=main.__doc__)
    parser.add_argument("scene", nargs="?", type=Path, default=Path("scenes/four_materials_wire.xml"), metavar="SCENE")
    parser.add_argument("--corners", action="store_true",
                        help="the corners, too: resistance, Seebeck, delay, lag of the sensors")  # fmt: skip
    parser.add_argument("--faster", action="store_true",
                        help="better wires, too: a raised baud rate, an input that averages")  # fmt: skip
    parser.add_argument("--only", metavar="WORDS", default="",
                        help="only the plants whose name has these words, such as 'delay +5 ms'")  # fmt: skip
    parser.add_argument("--alone", action="store_true",
                        help="only the display on its wire: a fifth of the time, and some 0.1 %% aside")  # fmt: skip
    parser.add_argument("--for", dest="duration", metavar="60s", help="end every run after this time")
    parser.add_argument("--bound", type=float, metavar="PERCENT",
                        help=f"most error; twice that in the corners (default {100.0 * BOUND:g}, on a rig of one's own "
                             f"{100.0 * OWN_RIG:g})")  # fmt: skip
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to this file too")
    options = parser.parse_args(list(argv))
    if not options.scene.is_file():
        print(
            f"error: there is no scene '{options.scene}'; run this where the repository's scenes/ is", file=sys.stderr
        )
        return 2
    most = bound_of(options.scene) if options.bound is None else 0.01 * options.bound
    rows, names = [], list[str]()
    every = bool(options.only)
    tried = [*plants(corners=options.corners or every), *(faster() if options.faster or every else ())]
    wanted = [plant for plant in tried if options.only in plant[0]]
    if not wanted:
        parser.error(f"no plant has '{options.only}' in its name")
    for name, mismatch, times in wanted:
        try:
            row = run(options.scene, mismatch, options.duration, alone=options.alone, wires=FASTER.get(name, ()))
        except RuntimeError as error:
            print(f"error: {name}: {error}", file=sys.stderr)
            return 2
        if not names:
            names = list(row)
            print("| plant | " + " | ".join(names) + " | at most |\n" + "|---" * (len(names) + 2) + "|")
        bound = most * times
        holds = all(error is not None and error <= bound for error in row.values()) and list(row) == names
        cells = " | ".join(_percent(row.get(key)) for key in names)
        print(f"| {name} | {cells} | {100.0 * bound:g} %{'' if holds else ' MISSED'} |", flush=True)
        rows.append({"plant": name, "mismatch": dict(mismatch), "true_error": row, "bound": bound, "holds": holds})
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0 if all(row["holds"] for row in rows) else 1


def _percent(error: float | None) -> str:
    return "-" if error is None else f"{100.0 * error:.1f} %"


def plants(*, corners: bool) -> Iterator[tuple[str, Mismatch, float]]:
    """Yield name, difference and how many times the bound is allowed, of every plant that is tried."""
    yield "as written", {}, 1.0
    yield "resistance +20 %, Seebeck -10 %", DIFFERS, 1.0
    for signs in product((1.0, -1.0), repeat=len(WIDE)) if corners else ():
        corner = {key: sign * much for sign, (key, much) in zip(signs, WIDE.items(), strict=True)}
        words = (
            f"{key} {1e3 * much:+g} ms" if key == "delay" else f"{key} {100.0 * much:+g} %"
            for key, much in corner.items()
        )
        yield ", ".join(words), corner, CORNER


def faster() -> Iterator[tuple[str, Mismatch, float]]:
    """Yield the names of better wires, with the plant as written and the same bound."""
    for name in FASTER:
        yield name, {}, 1.0


def run(
    scene: Path, mismatch: Mismatch, duration: str | None = None, *, alone: bool = False, wires: Sequence[Wire] = ()
) -> dict[str, float | None]:
    """Return the true error [1] of each contact's flux by object, in a run of a scene whose plant differs.

    ``alone``: only the displays are on their wires; ``wires``: attributes that are written otherwise.

    Raises
    ------
    RuntimeError
        If the run ends in a fault; with its last words.
    """
    with tempfile.TemporaryDirectory(prefix="itouch-wire-") as name:
        folder = Path(name) / "scenes"
        shutil.copytree(scene.resolve().parent, folder)
        if mismatch and not sum(differ(path, mismatch) for path in sorted(folder.rglob("*.xml"))):
            raise RuntimeError("no display behind a wire was found in the scene's folder")
        if wires and not sum(rewire(path, wires) for path in sorted(folder.rglob("*.xml"))):
            raise RuntimeError("no display on such a wire was found in the scene's folder")
        named = [word for device in displays(folder / scene.name) for word in ("--only", device)] if alone else []
        report = Path(name) / "report.json"
        command = [
            sys.executable,
            "-c",
            PROGRAM,
            "virtual-rig",
            str(folder / scene.name),
            "--run",
            "--report",
            str(report),
            *named,
        ]
        command += ["--for", duration] if duration else []
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode or not report.is_file():
            raise RuntimeError(done.stderr.strip().rpartition("\n")[2] or f"ended with {done.returncode}")
        found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return {contact["object"]: contact.get("true_error_rms") for contact in found["contacts"]}


def differ(path: Path, mismatch: Mismatch) -> int:
    """Add a difference to that of the displays behind a wire in a file; return how many there are.

    A plant cannot act before it is told to: where it would have to, the controller is told of a longer delay instead.
    """
    tree = ElementTree.parse(path)
    found = [hardware for device in wired(tree.getroot()) for hardware in device.findall(f"{SPACE}hardware")]
    for hardware in found:
        there = hardware.find(f"{SPACE}mismatch")
        if there is None:
            there = ElementTree.SubElement(hardware, f"{SPACE}mismatch")
        for key, much in mismatch.items():
            number = _number(there.get(key) or "0") + much
            if key == "delay":
                told = max(_number(hardware.get(key) or str(DisplayParams().delay)), -number)
                hardware.set(key, f"{1e3 * told:g} ms")
            there.set(key, f"{1e3 * number:g} ms" if key == "delay" else f"{number:g}")
    if found:
        tree.write(path, encoding="utf-8", xml_declaration=True)
    return len(found)


def _number(text: str) -> float:
    before, _, unit = text.partition(" ")
    return float(before) * {"%": 0.01, "ms": 1e-3}.get(unit, 1.0)


def rewire(path: Path, wires: Sequence[Wire]) -> int:
    """Write attributes of the displays behind a wire in a file; return how many displays have such parts."""
    tree = ElementTree.parse(path)
    count = 0
    for hardware in (found for device in wired(tree.getroot()) for found in device.findall(f"{SPACE}hardware")):
        parts = [hardware.find(f"{SPACE}{part}") if part else hardware for part, _, _ in wires]
        for element, (_, key, value) in zip(parts, wires, strict=True):
            if element is not None:
                element.set(key, value)
        count += None not in parts
    if count:
        tree.write(path, encoding="utf-8", xml_declaration=True)
    return count


def displays(scene: Path) -> list[str]:
    """Return the names of the displays that are behind a wire, in a scene and what it includes."""
    return [str(device.get("name")) for root in _roots(scene) for device in wired(root)]


def bound_of(scene: Path) -> float:
    """Return the most true error [1] that is allowed of a scene's displays, by what drives them."""
    lines = (device.find(f"{SPACE}hardware/{SPACE}line") for root in _roots(scene) for device in wired(root))
    return OWN_RIG if any(line is not None for line in lines) else BOUND


def _roots(scene: Path) -> Iterator[ElementTree.Element]:
    """Yield a scene and what it includes."""
    root = ElementTree.parse(scene).getroot()
    yield root
    for part in root.iter("include"):
        path = scene.parent / str(part.get("file"))
        if path.is_file():
            yield from _roots(path)


def wired(root: ElementTree.Element) -> list[ElementTree.Element]:
    """Return the displays of a file that are behind a wire."""
    devices = [device for device in root.iter("device") if device.get("twin") == "no"]
    return [device for device in devices if device.find(f"{SPACE}hardware") is not None]
