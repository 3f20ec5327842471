"""Pages of the shipped sweeps: figures and numbers out of their rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.schema import ItouchError
from itouch.sweeps.store import rows, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: What is looked for in "one tuning": the rms flux error above which it does not hold.
ERROR = 0.03
#: The noise of a person's cue (docs/explanation/observers.md).
PERSON = 0.375

Rows = list[dict[str, Any]]
Drawn = Callable[["Axes"], None]


def proportion(count: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a proportion; one-sided where nothing or everything was counted."""
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0 if 0 < count < of else 1.0 - level
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, of - count + 1))
    high = 1.0 if count == of else float(beta.ppf(1.0 - tail, count + 1, of - count))
    return low, high


def choose(found: Rows) -> tuple[list[str], Drawn]:
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


def tuning(found: Rows) -> tuple[list[str], Drawn]:
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


def safety(found: Rows) -> tuple[list[str], Drawn]:
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


def identify(found: Rows) -> tuple[list[str], Drawn]:
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
        axes.imshow(human[np.ix_(order, order)] / human.sum(1).max(), cmap="Greys")
        axes.set_xticks(range(len(names)), [names[i] for i in order], rotation=90, fontsize=5)
        axes.set_yticks(range(len(names)), [names[i] for i in order], fontsize=5)
        axes.set_xlabel("answer of the human observer")
        axes.set_ylabel("touched")

    return lines, draw


def confusion(features: NDArray[np.float64], labels: NDArray[np.intp], count: int, noise: float) -> NDArray[np.float64]:
    """Return how often each was answered: by the nearest mean of the others' touches, in units of the spread.

    Parameters
    ----------
    features
        Cues of each touch, shape (touches, cues).
    labels
        What was touched, shape (touches,).
    count
        How many there are.
    noise
        A person's, added to each cue; 0: none.
    """
    rng = np.random.default_rng(0)
    repeats = 1 if noise == 0.0 else 20
    within = np.concatenate([features[labels == index] - features[labels == index].mean(0) for index in range(count)])
    spread = np.cov(within.T, ddof=count).reshape(features.shape[1], -1) + (noise**2 + 1e-12) * np.eye(
        features.shape[1]
    )
    inverse, found = np.linalg.inv(spread), np.zeros((count, count))
    sums = np.array([features[labels == index].sum(0) for index in range(count)])
    sizes = np.bincount(labels, minlength=count).astype(float)
    for touch, label in zip(features, labels, strict=True):
        means = sums / sizes[:, None]
        if sizes[label] > 1:  # a touch does not know itself
            means[label] = (sums[label] - touch) / (sizes[label] - 1.0)
        for _ in range(repeats):
            off = touch + noise * rng.standard_normal(len(touch)) - means
            found[label, int(np.argmin(np.einsum("ij,jk,ik->i", off, inverse, off)))] += 1.0
    return found


def bits(matrix: NDArray[np.float64]) -> float:
    """Return the information that the answers carry of what was touched [bit]."""
    joint = matrix / matrix.sum()
    independent = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
    known = joint > 0.0
    return float((joint[known] * np.log2(joint[known] / independent[known])).sum())


KINDS: Mapping[str, Callable[[Rows], tuple[list[str], Drawn]]] = {
    "choose-a-display": choose, "one-tuning": tuning, "safety-by-number": safety, "identify-materials": identify,
}  # fmt: skip


def write_page(kind: str, folder: Path, output: Path) -> Path:
    """Write the page of a sweep's rows as Markdown, with its figure beside it; return the page.

    Raises
    ------
    ItouchError
        If the folder has no rows, or those of another sweep.
    """
    if not table(folder).num_rows:
        raise ItouchError(f"'{folder}' has no rows")
    found: Rows = sorted(rows(folder), key=lambda row: str(row["digest"]))
    try:
        lines, draw = KINDS[kind](found)
    except (KeyError, ValueError, IndexError) as error:
        raise ItouchError(f"the rows in '{folder}' are not those of '{kind}': {error}") from None
    output.mkdir(parents=True, exist_ok=True)
    picture = output / f"{kind}.png"
    lines += ["", f"![{kind}]({picture.name})", ""] if _drawn(draw, picture) else [""]
    page = output / f"{kind}.md"
    page.write_text("\n".join(lines), encoding="utf-8")
    return page


def _drawn(draw: Drawn, picture: Path) -> bool:
    """Draw a figure, where matplotlib is installed."""
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        return False
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.5), layout="constrained")
    draw(axes)
    figure.savefig(picture, dpi=110)
    plt.close(figure)
    return True
