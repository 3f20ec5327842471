"""Pages of the shipped sweeps: numbers and a figure out of their rows, by ``itouch-py sweep page NAME FOLDER``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from itouch.plugin.discovery import Catalog
from itouch.scene import bundled_scenes
from itouch_tools.study.observers import Felt
from itouch_tools.study.power import power
from itouch_tools.study.reading import StudyFile, load_study
from itouch_tools.sweeps.figures import bits, confusion, proportion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: What is looked for in "one tuning": the rms flux error above which it does not hold.
ERROR = 0.03
#: The noise of a person's cue (docs/explanation/observers.md).
PERSON = 0.375

#: One for each comparison of a figure.
_MARKERS = "os^Dv"

Rows = list[dict[str, Any]]
Drawn = Callable[["Axes"], None]


def choose_a_display(found: Rows) -> tuple[list[str], Drawn]:
    """Tell which hardware reaches chance for which materials, and which of them no other beats."""
    done = [row for row in found if row["status"] == "done" and row["realism_correct"] is not None]
    names = ("module", "delay", "sensor")
    materials = sorted({row["material"] for row in done})
    by: dict[tuple[Any, ...], Rows] = {}
    for row in done:
        by.setdefault(tuple(row[name] for name in names), []).append(row)
    lines = ["| module | delay, ms | sensor | cost | power, W | " + " | ".join(materials) + " | best |",
             "|---|---|---|---|---|" + "---|" * (len(materials) + 1)]  # fmt: skip
    points = []
    for key, some in sorted(by.items(), key=lambda item: str(item[0])):
        correct = {m: [row["realism_correct"] for row in some if row["material"] == m] for m in materials}
        means = {m: float(np.mean(values)) if values else math.nan for m, values in correct.items()}
        power = float(np.mean([row["ohm"] * row["current"] ** 2 for row in some]))
        points.append((key, some[0]["cost"], power, max(means.values()), correct))
    for key, cost, power, worst, correct in points:
        beaten = any(c <= cost and p <= power and w <= worst and (c, p, w) != (cost, power, worst)
                     for _, c, p, w, _ in points)  # fmt: skip
        cells = " | ".join(_percent(correct[m]) for m in materials)
        front = "" if beaten else "front"
        lines.append(f"| {key[0]} | {key[1]:g} | {key[2]} | {cost:g} | {power:.2f} | {cells} | {front} |")
    lines.append("\nPercentages: 2AFC of the best observer, display against the real thing; 50 % is chance. "
                 "`front`: none is as cheap, as frugal and as real.")  # fmt: skip

    def draw(axes: Axes) -> None:
        for key, cost, power, worst, _ in points:
            axes.scatter(power, 100.0 * worst, s=30.0 * cost, label=" ".join(f"{one:g}" if isinstance(one, float)
                                                                             else one for one in key))  # fmt: skip
        axes.axhline(50.0, color="0.5", linewidth=0.8)
        axes.set_xlabel("electrical power [W]")
        axes.set_ylabel("told from the real thing, worst material [%]")
        axes.legend(fontsize=6)

    return lines, draw


def _percent(values: Sequence[float]) -> str:
    """Return a mean in per cent; of several, with half of its 95 % interval."""
    if not values:
        return "-"
    mean = f"{100.0 * float(np.mean(values)):.1f}"
    if len(values) < 2:
        return f"{mean} %"
    return f"{mean} ± {196.0 * float(np.std(values, ddof=1)) / math.sqrt(len(values)):.1f} %"


def how_many_people(found: Rows) -> tuple[list[str], Drawn]:
    """Tell how wide intervals are, and how often equivalence is found, against the size of the panel."""
    study = _study(found)
    done = [row for row in found if row["status"] == "done" and row["felt_flux"] is not None]
    panels, repetitions = (8, 12, 16, 24, 32, 40), (5, 10, 20)
    powers = power(study, _library(study, done), panels, repetitions=repetitions)
    names = list(powers[0].equivalence)
    lines = [f"'{study.name}', {len(done)} touches; observers judge by flux, and differ in noise, lapses, finger.", "",
             "| people | repetitions | right | 95 % interval | " + " | ".join(names) + " |",
             "|---|---|---|---|" + "---|" * len(names)]  # fmt: skip
    for one in powers:
        cells = " | ".join(f"{100.0 * one.equivalence[name]:.0f} %" for name in names)
        lines.append(f"| {one.panel} | {one.repetitions} | {100.0 * one.proportion:.1f} % | "
                     f"± {100.0 * one.half_width:.1f} % | {cells} |")  # fmt: skip
    lines.append("\nThe last columns: power of the test of equivalence, margin 10 %, two one-sided tests at 5 %.")

    def draw(axes: Axes) -> None:
        widths = axes.twinx()
        for count in repetitions:
            some = [one for one in powers if one.repetitions == count]
            sizes = [one.panel for one in some]
            (line,) = widths.plot(sizes, [100.0 * one.half_width for one in some], linestyle=":")
            for name, marker in zip(names, _MARKERS * len(names), strict=False):
                axes.plot(sizes, [100.0 * one.equivalence[name] for one in some], marker=marker,
                          color=line.get_color(), label=f"{name}, {count} repetitions")  # fmt: skip
        axes.set_xlabel("people")
        axes.set_ylabel("power of the test of equivalence [%]")
        widths.set_ylabel("half of the 95 % interval (dotted) [%]")
        axes.set_ylim(0.0, 105.0)
        widths.set_ylim(0.0, None)
        axes.set_xticks(panels)
        axes.legend(fontsize=7, loc="lower right")

    return lines, draw


def _study(found: Rows) -> StudyFile:
    """Return the shipped study whose factors the rows have."""
    home = bundled_scenes.folder() or Path()
    for path in sorted((home / "studies").glob("*.xml")):
        study = load_study(path, Catalog())
        known = {repr(condition) for condition in study.conditions()}
        names = [factor.name for factor in study.study.factors]
        if names and all(repr({name: row.get(name) for name in names}) in known for row in found):
            return study
    raise ValueError("no shipped study has these conditions; for your own use 'itouch-py study power'")


def _library(study: StudyFile, done: Rows) -> list[dict[str, list[Felt]]]:
    """Return what is felt, finger by finger: condition (as its repr) -> touches of that mean flux."""
    names = [factor.name for factor in study.study.factors]
    fingers: dict[float, dict[str, list[Felt]]] = {}
    for row in done:
        flux = np.full(100, row["felt_flux"])
        touches = fingers.setdefault(row["finger"], {}).setdefault(repr({name: row[name] for name in names}), [])
        touches.append(Felt(flux, np.full(100, 300.0), np.full(100, 300.0), 0.01))
    return [fingers[finger] for finger in sorted(fingers)]


def one_tuning(found: Rows) -> tuple[list[str], Drawn]:
    """Tell how the error is distributed over what was drawn, how often it is too large, and which runs are worst."""
    done = [row for row in found if row["status"] == "done" and row["error"] is not None]
    errors = np.array([row["error"] for row in done])
    ready = np.array([row["ready"] == 1.0 and row["limited"] != 1.0 for row in done])
    lines = [f"{len(found)} runs, {len(done)} with a touch and its error."]
    for name, some in (
        ("all touches", errors),
        ("touches for which the plate was ready and not limited", errors[ready]),
    ):
        if not len(some):
            continue
        count = int((some > ERROR).sum())
        low, high = proportion(count, len(some))
        quantiles = ", ".join(f"p{q} {100.0 * np.percentile(some, q):.2f} %" for q in (50, 90, 99))
        lines.append(f"- {name}: {quantiles}, largest {100.0 * some.max():.2f} %; more than {100.0 * ERROR:g} % in "
                     f"{count} of {len(some)}: {100.0 * count / len(some):.2f} % "
                     f"({100.0 * low:.2f} to {100.0 * high:.2f} %, 95 %)")  # fmt: skip
    lines += ["", "| digest | error | material | skin, °C | resistance |", "|---|---|---|---|---|"]
    for row in sorted(done, key=lambda one: -one["error"])[:5]:
        lines.append(f"| `{row['digest'][:12]}` | {100.0 * row['error']:.2f} % | {row['material']} | "
                     f"{row['skin']:.1f} | {row['resistance']:.2e} |")  # fmt: skip
    lines.append("\n`itouch-py sweep replay FOLDER DIGEST` opens one of them, `--save FILE.itouch` keeps it.")

    def draw(axes: Axes) -> None:
        for material in sorted({row["material"] for row in done}):
            some = np.sort([row["error"] for row in done if row["material"] == material])
            axes.step(100.0 * some, np.arange(1, len(some) + 1) / len(some), where="post", label=material)
        axes.axvline(100.0 * ERROR, color="0.5", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_xlabel("rms flux error [%]")
        axes.set_ylabel("share of touches")
        axes.legend()

    return lines, draw


def safety_by_number(found: Rows) -> tuple[list[str], Drawn]:
    """Tell how often an absolute limit was passed, the bound of the rate that this proves, and what tripped."""
    judged = [row for row in found if row["truth_passed"] is not None]
    passed = [row for row in judged if row["truth_passed"] > 0]
    _, high = proportion(len(passed), len(judged))
    trips: dict[str, int] = {}
    for row in judged:
        trips[row["trip"] or "none"] = trips.get(row["trip"] or "none", 0) + 1
    lines = [
        f"{len(judged)} rigs with two faults each, {len(found) - len(judged)} without a verdict; an absolute limit was "
        f"passed in {len(passed)}: with 95 % confidence in less than {100.0 * high:.3g} % of such cases.",
        f"True plate temperature {min(r['truth_low_K'] for r in judged) - 273.15:.2f} to "
        f"{max(r['truth_high_K'] for r in judged) - 273.15:.2f} °C, plate force up to "
        f"{max(r['truth_plate_force_N'] for r in judged):.2f} N.",
        "", "| last trip | rigs |", "|---|---|",
    ]  # fmt: skip
    lines += [f"| {trip} | {count} |" for trip, count in sorted(trips.items(), key=lambda item: -item[1])]
    lines += [f"- WRONG: `{row['digest'][:12]}`" for row in passed]

    def draw(axes: Axes) -> None:
        axes.hist([row["truth_low_K"] - 273.15 for row in judged], bins=30, label="lowest")
        axes.hist([row["truth_high_K"] - 273.15 for row in judged], bins=30, label="highest")
        axes.set_xlabel("true plate temperature of a run [°C]")
        axes.set_ylabel("runs")
        axes.legend()

    return lines, draw


def identify_materials(found: Rows) -> tuple[list[str], Drawn]:
    """Tell how many materials are told apart, ideally and with a person's noise, and which are mistaken for which."""
    done = [row for row in found if row["status"] == "done" and row["cue_flux"] is not None]
    names = sorted({row["material"] for row in done})
    features = np.array([[row["cue_flux"], row["cue_fall"], row["cue_receptors"]] for row in done])
    labels = np.array([names.index(row["material"]) for row in done])
    ideal = confusion(features, labels, len(names), 0.0)
    human = confusion(features[:, :2], labels, len(names), PERSON)
    lines = [f"{len(names)} materials, {len(done)} touches."]
    for name, matrix in (("ideal observer, noise of skin and contact only", ideal), ("human observer", human)):
        right = float(np.trace(matrix) / matrix.sum())
        lines.append(f"- {name}: {100.0 * right:.1f} % right (chance {100.0 / len(names):.1f} %), "
                     f"{bits(matrix):.2f} of {math.log2(len(names)):.2f} bits: as many as {2.0 ** bits(matrix):.1f} "
                     "that are never mistaken")  # fmt: skip
    lines += ["", "| mistaken by the ideal observer | for | touches |", "|---|---|---|"]
    off = ideal - np.diag(np.diag(ideal))
    for flat in np.argsort(-off, axis=None)[:8]:
        a, b = np.unravel_index(flat, off.shape)
        if off[a, b] > 0:
            lines.append(f"| {names[int(a)]} | {names[int(b)]} | {100.0 * off[a, b] / ideal[a].sum():.0f} % |")

    def draw(axes: Axes) -> None:
        order = np.argsort([features[labels == index, 0].mean() for index in range(len(names))])
        side = 1.8 + max(2.7, 0.115 * len(names))  # room for a name on every row
        figure = axes.get_figure(root=True)
        if figure is not None:
            figure.set_size_inches(side, side)
        axes.imshow(human[np.ix_(order, order)] / human.sum(1).max(), cmap="Greys")
        axes.set_xticks(range(len(names)), [names[i] for i in order], rotation=90, fontsize=5)
        axes.set_yticks(range(len(names)), [names[i] for i in order], fontsize=5)
        axes.set_xlabel("answer of the human observer")
        axes.set_ylabel("touched")

    return lines, draw
