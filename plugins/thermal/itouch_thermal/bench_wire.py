"""``itouch-py bench wire``: a scene on its devices' real protocols, scored by what the twins behind the emulators know.

Every row is a run of ``itouch-py virtual-rig SCENE --run``, whose plant differs from what the controller assumes.  In
real time a missed bound counts only on a machine that wakes its processes in time: its lateness is printed with it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from itouch.plugin.commands import command_parser, exit_code, output_file
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.display.params import DisplayParams

SPACE = "{urn:itouch:plugin:thermal}"
#: Greatest true error of the finger's flux, rms from 0.1 s to lift-off: on a TEC controller, and on a rig of one's own,
#: whose thermistors are slow and whose current follows a command after some 12 ms; and the factor on both in the
#: corners.
BOUND, OWN_RIG, CORNER = 0.03, 0.05, 2.0
#: Factor on them in real time; greatest p99 of a surface's distance from its command, relative to its speed times the
#: age of its reading; greatest relative difference of a touch's peak force from that on twins.
REAL, TRACKING, FORCE = 4.0 / 3.0, 1.5, 0.1
#: The corners: by how much the plant may differ, in either direction.
WIDE = {"contact-resistance": 0.2, "seebeck": 0.1, "delay": 5e-3, "sensor-lag": 0.3}
#: Runs the command line of this installation.
PROGRAM = "from itouch_tools.cli import main; raise SystemExit(main())"
#: Wires better than the scene's: element inside a display's hardware (empty: itself), attribute, value.
_RAISED = ("mecom", "session-baud", "460800")
FASTER = {
    "460800 baud for the session": (_RAISED,),
    "flux averaged for 20 ms": (("labjack", "averaging", "20 ms"),),
    "460800 baud, flux averaged for 4 ms": (_RAISED, ("labjack", "averaging", "4 ms")),
    "460800 baud, flux averaged for 20 ms": (_RAISED, ("labjack", "averaging", "20 ms")),
}
#: The wire as written, and wires with other timing: words for ``virtual-rig``.
STEADY = "as written"
UNSTEADY: dict[str, tuple[str, ...]] = {
    STEADY: (),
    **{f"exchanges {phase} ms later": ("--phase", f"{phase}ms") for phase in (5, 10, 15, 19)},
    "20 +- 10 ms, 5 % lost": ("--unsteady",),
}
#: The most that each of them may add to the error on the wire as written, both as rms over runs with this many seeds:
#: the noise that a single run meets is luck.
ADDS, SEEDS = 0.01, 3
#: A plant that differs much, and in the long run.
DIFFERS = {"contact-resistance": 0.2, "seebeck": -0.1}

Mismatch = Mapping[str, float]
#: A plant to try: its name, its differences from the data sheets, and the factor on the bound.
Plant = tuple[str, Mismatch, float]
#: Why nothing can be judged.
UNTOUCHED = "the finger touched nothing, so there is no figure: give the run longer (--for), or a scene with touches"
#: Element inside the hardware (empty: itself), attribute, and the value to write.
Wire = tuple[str, str, str]


def main(argv: Sequence[str]) -> int:
    """Print the true error of the finger's flux per material, each beside its bound; 1 if one is passed."""
    parser = command_parser("itouch-py bench wire", main.__doc__)
    options = _options(parser, argv)
    if not options.scene.is_file():
        print(
            f"error: there is no scene '{options.scene}'; run this where the repository's scenes/ is", file=sys.stderr
        )
        return 2
    most = bound_of(options.scene) if options.bound is None else 0.01 * options.bound
    wanted = _wanted(options)
    if not wanted:
        parser.error(f"no plant has '{options.only}' in its name")
    return _in_real_time(options, wanted, REAL * most) if options.real_time else _in_step(options, wanted, most)


def _options(parser: argparse.ArgumentParser, argv: Sequence[str]) -> argparse.Namespace:
    """Return what the command line asks for; what does not go together ends with a sentence and exit code 2."""
    parser.add_argument("scene", nargs="?", type=Path, default=Path("scenes/four_materials_wire.xml"), metavar="SCENE")
    parser.add_argument("--corners", action="store_true",
                        help="the corners, too: resistance, Seebeck, delay, lag of the sensors")  # fmt: skip
    parser.add_argument("--faster", action="store_true",
                        help="better wires, too: a raised baud rate, an input that averages")  # fmt: skip
    parser.add_argument("--unsteady", action="store_true",
                        help="other phases, jitter and losses: each at most one percentage point more")  # fmt: skip
    parser.add_argument("--only", metavar="WORDS", default="",
                        help="only the plants whose name has these whole words, such as 'delay +5 ms'")  # fmt: skip
    parser.add_argument("--alone", action="store_true",
                        help="only the display on its wire: a fifth of the time, and some 0.1 %% aside")  # fmt: skip
    parser.add_argument("--for", dest="duration", metavar="60s", help="end every run after this time")
    parser.add_argument("--bound", type=float, metavar="PERCENT",
                        help=f"most error; twice that in the corners (default {100.0 * BOUND:g}, on a self-built rig "
                             f"{100.0 * OWN_RIG:g})")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="(first) seed of all noise (default 0)")
    parser.add_argument("--json", type=output_file(), metavar="FILE", help="write the rows to this file too")
    parser.add_argument("--real-time", action="store_true",
                        help="in real time; the surface's tracking and greatest forces are judged, too")  # fmt: skip
    options = parser.parse_args(list(argv))
    if options.real_time and options.unsteady:
        parser.error("--unsteady is in step: in real time the wires are as they are")
    if options.real_time and options.alone:
        parser.error("--real-time has every device on its wire: leave --alone out")
    if options.real_time and options.seed:
        parser.error("--seed is for runs in step: leave it out in real time")
    if options.seed < 0:
        parser.error("--seed must be 0 or more")
    return options


def _wanted(options: argparse.Namespace) -> list[Plant]:
    """Return the plants that are asked for, or with ``--unsteady`` the wires; empty: none has such a name."""
    every = bool(options.only)
    if options.unsteady:
        wires: list[Plant] = [(name, {}, 1.0) for name in UNSTEADY if _has(name, options.only) or name == STEADY]
        return [] if every and len(wires) == 1 else wires
    tried = [*plants(corners=options.corners or every), *(faster() if options.faster or every else ())]
    return [plant for plant in tried if _has(plant[0], options.only)]


def _in_step(options: argparse.Namespace, wanted: Sequence[Plant], most: float) -> int:
    """Run the plants in step, and print a line for each; return the exit code.  ``most``: the bound of the error."""
    rows, names = list[dict[str, Any]](), list[str]()
    for name, mismatch, times in wanted:
        try:
            errors = [
                run(options.scene, mismatch, options.duration, alone=options.alone, wires=FASTER.get(name, ()),
                    words=words)
                for words in _words(name, options.seed, unsteady=options.unsteady)
            ]  # fmt: skip
        except RuntimeError as error:
            print(f"error: {name}: {error}", file=sys.stderr)
            return 2
        if not names:
            names = list(errors[0])
            print("| plant | " + " | ".join(names) + " | at most |\n" + "|---" * (len(names) + 2) + "|")
        bound, row = most * times, _together(errors)
        holds = all(
            list(one) == names and all(error is not None and error <= bound for error in one.values()) for one in errors
        )
        cells = " | ".join(_percent(row.get(key)) for key in names)
        print(f"| {name} | {cells} | {100.0 * bound:g} %{'' if holds else ' MISSED'} |", flush=True)
        rows.append({"plant": name, "mismatch": dict(mismatch), "true_error": row, "bound": bound, "holds": holds})
        if options.unsteady:
            rows[-1]["runs"] = errors
    if options.unsteady:
        rows.extend([_added(row, rows[0]) for row in rows[1:]])
    if options.json is not None:
        write_whole(Path(options.json), json.dumps(rows, indent=1) + "\n")
    return exit_code(row["holds"] for row in rows)


def _has(name: str, asked: str) -> bool:
    """Tell whether a name contains these words, consecutive and whole: '5 ms' is not part of '15 ms'."""
    words, wanted = (text.replace(",", " ").split() for text in (name, asked))
    return any(words[at : at + len(wanted)] == wanted for at in range(1 + len(words) - len(wanted)))


def _words(name: str, first: int, *, unsteady: bool) -> list[tuple[str, ...]]:
    """Return the extra words for ``virtual-rig`` for each run of a row: several seeds if wires are compared."""
    wire, count = (UNSTEADY[name], SEEDS) if unsteady else ((), 1)
    return [(*wire, *(("--seed", str(seed)) if seed else ())) for seed in range(first, first + count)]


def _together(errors: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Return the rms over runs of the error of each touch; None if a run lacks it."""
    if len(errors) == 1:
        return dict(errors[0])
    found: dict[str, float | None] = {}
    for key in dict.fromkeys(key for one in errors for key in one):
        squares = [error * error for one in errors if (error := one.get(key)) is not None]
        found[key] = math.sqrt(sum(squares) / len(squares)) if len(squares) == len(errors) else None
    return found


def _added(row: Mapping[str, Any], steady: Mapping[str, Any]) -> dict[str, Any]:
    """Print what another wire adds to the error of each touch, and return it as a row."""
    before: Mapping[str, float | None] = steady["true_error"]
    added = {key: _difference(row["true_error"].get(key), before[key]) for key in before}
    holds = all(more <= ADDS for more in added.values())
    cells = " | ".join(f"{100.0 * more:+.1f}" for more in added.values())
    name = f"{row['plant']}, less {STEADY}, percentage points"
    print(f"| {name} | {cells} | {100.0 * ADDS:+.1f}{'' if holds else ' MISSED'} |", flush=True)
    return {"plant": name, "mismatch": {}, "true_error": added, "bound": ADDS, "holds": holds}


def _difference(error: float | None, before: float | None) -> float:
    return math.inf if error is None or before is None else error - before


def _percent(error: float | None) -> str:
    return "-" if error is None else f"{100.0 * error:.1f} %"


def plants(*, corners: bool) -> Iterator[Plant]:
    """Yield the name, the differences and the factor on the bound of every plant to try."""
    yield "as written", {}, 1.0
    yield "resistance +20 %, Seebeck -10 %", DIFFERS, 1.0
    for signs in product((1.0, -1.0), repeat=len(WIDE)) if corners else ():
        corner = {key: sign * much for sign, (key, much) in zip(signs, WIDE.items(), strict=True)}
        words = (
            f"{key} {1e3 * much:+g} ms" if key == "delay" else f"{key} {100.0 * much:+g} %"
            for key, much in corner.items()
        )
        yield ", ".join(words), corner, CORNER


def faster() -> Iterator[Plant]:
    """Yield the names of better wires, with the plant as written and the same bound."""
    for name in FASTER:
        yield name, {}, 1.0


def run(
    scene: Path,
    mismatch: Mismatch,
    duration: str | None = None,
    *,
    alone: bool = False,
    wires: Sequence[Wire] = (),
    words: Sequence[str] = (),
) -> dict[str, float | None]:
    """Return the true error [1] of each contact's flux by object, in a run of a scene whose plant differs.

    ``alone``: only the displays are on their wires; ``wires``: attributes to write differently; ``words``: more for
    ``virtual-rig``.

    Raises
    ------
    RuntimeError
        If the run ends in a fault, with the run's last line, or if nothing was touched in it.
    """
    with changed(scene, mismatch, wires) as there:
        named = [word for device in displays(there) for word in ("--only", device)] if alone else []
        asked = ["virtual-rig", str(there), "--run", *named, *words, *(("--for", duration) if duration else ())]
        found, said = _reported(asked, there.parent.parent)
        if found is None or said:
            raise RuntimeError(said)
    if not (errors := _true_errors(found)):
        raise RuntimeError(UNTOUCHED)
    return errors


@contextlib.contextmanager
def changed(scene: Path, mismatch: Mismatch, wires: Sequence[Wire] = ()) -> Iterator[Path]:
    """Yield a copy of a scene, with all of its folder, whose plant and wires differ.

    Raises
    ------
    RuntimeError
        If the folder has no display to which the changes apply.
    """
    with tempfile.TemporaryDirectory(prefix="itouch-wire-") as name:
        folder = Path(name) / "scenes"
        shutil.copytree(scene.resolve().parent, folder)
        if mismatch and not sum(differ(path, mismatch) for path in sorted(folder.rglob("*.xml"))):
            raise RuntimeError("no display behind a wire was found in the scene's folder")
        if wires and not sum(rewire(path, wires) for path in sorted(folder.rglob("*.xml"))):
            raise RuntimeError("no display on such a wire was found in the scene's folder")
        yield folder / scene.name


def _reported(words: Sequence[str], folder: Path) -> tuple[dict[str, Any] | None, str]:
    """Run the program; return the report if it wrote one, and its last line if it failed, else an empty string."""
    report = folder / "report.json"
    report.unlink(missing_ok=True)
    command = [sys.executable, "-c", PROGRAM, *words, "--report", str(report)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said = "" if not done.returncode else done.stderr.strip().rpartition("\n")[2] or f"ended with {done.returncode}"
    if not report.is_file():
        return None, said or "left no report"
    found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return found, said


def _true_errors(report: Mapping[str, Any]) -> dict[str, float | None]:
    return {contact["object"]: contact.get("true_error_rms") for contact in report["contacts"]}


@dataclass(frozen=True, slots=True)
class Real:
    """The results of a run in real time, with the limits for them.

    Attributes
    ----------
    errors, peaks
        True error [1] of each touch's flux, and relative difference [1] of its greatest force from that on twins, by
        object.
    tracking, allowed
        p99 of the surface's distance from its command [mm], and its limit; None: no surface was driven.
    age
        Median age of the surface's readings [ms]; None: no surface was driven.
    faults
        The faults that ended the run.
    woken
        Lateness [us] of wake-ups, p99.9 and greatest, of the machine, the session and the simulated devices.
    punctual
        Whether the machine's wake-ups were punctual.
    """

    errors: Mapping[str, float | None]
    peaks: Mapping[str, float | None]
    tracking: float | None
    allowed: float | None
    age: float | None
    faults: Sequence[str]
    woken: Mapping[str, tuple[float | None, float | None]]
    punctual: bool

    def missed(self, bound: float, objects: Sequence[str]) -> list[str]:
        """List what was missed; ``objects`` are those that must be touched, in this order."""
        said = list(self.faults)
        if list(self.errors) != list(objects):
            said.append(f"it touched {', '.join(self.errors) or 'none'}, not {', '.join(objects)}")
        for name, error in self.errors.items():
            if error is None or error > bound:
                said.append(f"{name}'s flux is {_percent(error)} off, allowed: {100.0 * bound:.3g} %")
        for name, much in self.peaks.items():
            if much is None or abs(much) > FORCE:
                said.append(f"{name}'s greatest force differs by {_percent(much)} from that on twins")
        if self.tracking is None or self.allowed is None or self.tracking > self.allowed:
            said.append("the surface was further from its command than it may be")
        return said

    def verdict(self, missed: Sequence[str]) -> str:
        """Return `pass`, `fail`, or that the machine was too late to tell."""
        return "pass" if not missed else "fail" if self.punctual else "machine not punctual"


def judged(report: Mapping[str, Any], twins: Mapping[str, Any]) -> Real:
    """Evaluate the report of a run in real time against that of the same scene on twins."""
    on_twins = {contact["object"]: contact["peak_force_N"] for contact in twins["contacts"]}
    peaks = {
        contact["object"]: contact["peak_force_N"] / on_twins[contact["object"]] - 1.0
        if on_twins.get(contact["object"])
        else None
        for contact in report["contacts"]
    }
    wires = report["wires"]
    surface: Mapping[str, Any] = next(iter(wires.get("surfaces", {}).values()), {})
    far, tracking = surface.get("speed_times_age_mm", {}).get("p99"), report["table"]["tracking_mm"].get("p99")
    woken = {"machine": wires["machine"]["lateness_us"], "session": report["servo"]["lateness_us"] or {},
             "simulated devices": wires["rig"]["lateness_us"]}  # fmt: skip
    return Real(
        _true_errors(report), peaks, tracking, None if far is None else TRACKING * far,
        surface.get("age_ms", {}).get("p50"),
        [f"{fault['device']}: {fault['cause']}" for fault in report["faults"]],
        {who: (late.get("p99.9"), late.get("max")) for who, late in woken.items()},
        bool(wires["machine"]["held"]),
    )  # fmt: skip


def _in_real_time(options: argparse.Namespace, wanted: Sequence[Plant], most: float) -> int:
    """Run each plant in real time and print it beside its bounds; 0 if all pass, 1 if one fails, 3 if undecided."""
    rows, names, verdicts = [], list[str](), list[str]()
    for name, mismatch, times in wanted:
        try:
            with changed(options.scene, mismatch, FASTER.get(name, ())) as there:
                words = ["run", str(there), "--twin", "all", "--headless", "--pace", "fast"]
                ends = ("--for", options.duration) if options.duration else ()
                twins, said = _reported([*words, *ends], there.parent.parent)
                if twins is None:
                    raise RuntimeError(said)
                found, said = _reported(
                    ["virtual-rig", str(there), "--run", "--pace", "real", *ends], there.parent.parent
                )
                if found is None:
                    raise RuntimeError(said)
        except RuntimeError as error:
            print(f"error: {name}: {error}", file=sys.stderr)
            return 2
        real, objects = judged(found, twins), [contact["object"] for contact in twins["contacts"]]
        if not objects:
            print(f"error: {name}: {UNTOUCHED}", file=sys.stderr)
            return 2
        if not names:
            names = objects
            print(f"| plant | {' | '.join(names)} | at most | greatest force off | at most | tracking p99 | at most | "
                  "verdict |\n" + "|---" * (len(names) + 7) + "|")  # fmt: skip
        missed = real.missed(most * times, objects)
        verdicts.append(real.verdict(missed))
        forces = [abs(much) for much in real.peaks.values() if much is not None]
        cells = " | ".join(_percent(real.errors.get(key)) for key in names)
        print(
            f"| {name} | {cells} | {100.0 * most * times:.3g} % | {_percent(max(forces, default=None))} | "
            f"{100.0 * FORCE:g} % | {_millimetres(real.tracking)} | {_millimetres(real.allowed)} | {verdicts[-1]} |",
            flush=True,
        )
        for line in _beside(real, missed):
            print(line, flush=True)
        rows.append({"plant": name, "mismatch": dict(mismatch), "true_error": real.errors, "bound": most * times,
                     "peak_force": real.peaks, "tracking_mm": real.tracking, "tracking_most_mm": real.allowed,
                     "reading_age_ms": real.age, "woken_late_us": real.woken, "missed": missed,
                     "verdict": verdicts[-1]})  # fmt: skip
    if options.json is not None:
        write_whole(Path(options.json), json.dumps(rows, indent=1) + "\n")
    return 1 if "fail" in verdicts else 3 if "machine not punctual" in verdicts else 0


def _beside(real: Real, missed: Sequence[str]) -> Iterator[str]:
    """Yield the lines below a row: how late wake-ups were, and what was missed."""
    late = "; ".join(
        f"{who} {_late(most)} (p99.9), {_late(worst)} at most" for who, (most, worst) in real.woken.items()
    )
    age = "" if real.age is None else f"; the surface's readings were {real.age:.1f} ms old"
    yield f"  woken late: {late}{age}"
    yield from (f"  missed: {what}" for what in missed)


def _late(microseconds: float | None) -> str:
    return "-" if microseconds is None else f"{1e-3 * microseconds:.2f} ms"


def _millimetres(distance: float | None) -> str:
    return "-" if distance is None else f"{distance:.2f} mm"


def differ(path: Path, mismatch: Mismatch) -> int:
    """Add a mismatch to those of the displays behind a wire in a file; return how many there are.

    A plant cannot act before its command: where it would have to, the controller is told of a longer delay instead.
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
    """Set attributes of the displays behind a wire in a file; return how many displays have all these elements."""
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
    """Return the names of the displays behind a wire, in a scene and the files that it includes."""
    return [str(device.get("name")) for root in _roots(scene) for device in wired(root)]


def bound_of(scene: Path) -> float:
    """Return the greatest allowed true error [1] for a scene's displays, by what drives them."""
    lines = (device.find(f"{SPACE}hardware/{SPACE}line") for root in _roots(scene) for device in wired(root))
    return OWN_RIG if any(line is not None for line in lines) else BOUND


def _roots(scene: Path) -> Iterator[ElementTree.Element]:
    """Yield the root elements of a scene and of the files that it includes."""
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
