"""The page of a study: one HTML file with its tables and figures, which loads nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from itouch.plugin import Measured
from itouch_tools.study.touch_figures import known

_STYLE = """
:root { color-scheme: light dark; --ink: #1c2733; --paper: #fff; --line: #c9d2dc; --fill: #2a78b8; }
@media (prefers-color-scheme: dark) { :root { --ink: #dfe7ef; --paper: #14191f; --line: #3a4652; --fill: #5aa9e6; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
table { border-collapse: collapse; margin: .6rem 0; } .wide { overflow-x: auto; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--line); text-align: right; }
th:first-child, td:first-child { text-align: left; }
.matrix tr:first-child th:not(:first-child), .matrix td { text-align: center; min-width: 5.2rem; }
.matrix small { opacity: .75; display: block; }
.lead { font-size: 1.15rem; } .note { opacity: .8; }
"""


def page(result: dict[str, Any], provenance: dict[str, str]) -> str:
    """Return the page of a study's results."""
    parts = [f"<h1>{escape(result['study'])}</h1>", _lead(result)]
    parts += [_identification(one) for one in result.get("identification", [])]
    parts += _sections(result)
    parts.append("<h2>Provenance</h2>" + _table(("", ""), provenance.items()))
    title = escape(result["study"])
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    return (
        f"<!doctype html><html lang=en><head>{head}<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def _lead(result: dict[str, Any]) -> str:
    people, trials = result["participants"], result["trials"]
    text = f"{people} participant{'s' * (people != 1)}, {trials} trial{'s' * (trials != 1)} that count"
    correct = result.get("correct")
    if correct is not None and correct["proportion"] is not None:
        text += f"; {_percent(correct['proportion'])} right{_interval(correct['panel_95'])}"
    void = sum(result["void"].values())
    why = ", ".join(f"{reason} ({count})" for reason, count in sorted(result["void"].items()))
    rest = f"{result['practice']} of practice; {void} void" + (f": {escape(why)}" if why else "")
    if "catch" in result:
        rest += "; " + _catch(result["catch"])
    late = result["skin_not_back"]
    if late:
        rest += f"; the skin was not back before {late} {'touch that counts' if late == 1 else 'touches that count'}"
    return f'<p class="lead">{text}.</p><p class="note">{rest}.</p>'


def _catch(found: dict[str, int]) -> str:
    of = found["judged"] or found["trials"]
    trials = f"{of} catch trial{'' if of == 1 else 's'}"
    if not found["judged"]:
        return f"{trials}, in which no answer is right or wrong"
    return f"{found['right']} of {trials} right"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.0f} %"


def _chance(p: Any) -> str:
    """Return a test's p value with four digits, never as 0."""
    told = _number(p, 4)
    return "< 0.0001" if told == "0.0000" else told


def _number(value: Any, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _interval(pair: Sequence[float | None], *, percent: bool = True) -> str:
    if pair[0] is None or pair[1] is None:
        return ""
    shown = [f"{100.0 * end:.0f}" if percent else f"{end:.2f}" for end in pair if end is not None]
    return f" [{shown[0]}, {shown[1]}]"


def _name(condition: dict[str, str]) -> str:
    return ", ".join(condition.values())


def _identification(one: dict[str, Any]) -> str:
    """Return a confusion matrix: rows shown, columns answered, in percent with 95 % intervals over participants."""
    labels, counts, cells = one["labels"], one["counts"], one["intervals_95"]
    head = "".join(f"<th>{escape(label)}</th>" for label in labels)
    body = []
    for i, label in enumerate(labels):
        total = sum(counts[i])
        row = [f"<th>{escape(label)}</th>"]
        for j in range(len(labels)):
            share = counts[i][j] / total if total else None
            strength = 0 if share is None else round(55 * share)
            interval = _interval(cells[i][j]).strip() if cells else ""
            row.append(
                f'<td style="background:color-mix(in srgb, var(--fill) {strength}%, transparent)">{_percent(share)}'
                f"<small>{interval}</small></td>"
            )
        body.append(f"<tr>{''.join(row)}</tr>")
    bits = one["information_bit"]
    told = (
        f"{_percent(one['proportion'])} right, d' {_number(one['d_prime'])}, kappa {_number(one['kappa'])}; "
        f"information {_number(bits['corrected'])} of {_number(bits['ceiling'])} bit"
        f"{_interval(bits['panel_95'], percent=False)}"
    )
    heading = "What was answered to what" + ("" if one["of"] == "all" else f": {escape(one['of'])}")
    top = f"<tr><th>shown \\ answered</th>{head}</tr>"
    table = f'<div class="wide"><table class="matrix">{top}{"".join(body)}</table></div>'
    note = '<p class="note">Rows were shown, columns answered; 95 % intervals over participants.</p>'
    return f"<h2>{heading}</h2><p>{told}.</p>{table}{note}"


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = ["<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows]
    return f'<div class="wide"><table><tr>{top}</tr>{"".join(lines)}</table></div>'


def _sections(result: dict[str, Any]) -> list[str]:
    parts = []
    rows: list[tuple[Any, ...]]
    if "correct" in result:
        rows = [
            (_name(one["condition"]), one["trials"], _percent(one["proportion"]), _interval(one["panel_95"]).strip())
            for one in result["conditions"]
        ]
        parts.append("<h2>Right answers</h2>" + _table(("condition", "trials", "right", "95 %"), rows))
    if "sensitivity" in result:
        rows = [
            (s["level"], s["trials"], _number(s["d_prime"]), _interval(s["d_prime_95"], percent=False).strip())
            for s in result["sensitivity"]
        ]
        parts.append("<h2>Sensitivity</h2>" + _table(("level", "trials", "d'", "95 %"), rows))
    if "ratings" in result:
        rows = [
            (_name(one["condition"]), _number(one["mean"]), _interval(one["panel_95"], percent=False).strip())
            for one in result["ratings"]
        ]
        head: tuple[str, ...] = ("condition", "mean", "95 %")
        if any("geometric_mean" in one for one in result["ratings"]):
            head += ("geometric mean", "95 %")
            rows = [
                (*row, _number(one["geometric_mean"]), _interval(one["geometric_95"], percent=False).strip())
                for row, one in zip(rows, result["ratings"], strict=True)
            ]
        parts.append("<h2>Ratings</h2>" + _table(head, rows))
    if "constant" in result:
        parts += _constant(result["constant"])
    for one in result.get("staircases", []):
        rows = [(person, _number(value, 3)) for person, value in one["thresholds"].items()]
        rows.append(("mean", _number(one["mean"], 3) + _interval(one["panel_95"], percent=False)))
        parts.append(f"<h2>Threshold: {escape(one['name'])}</h2>" + _table(("participant", "threshold"), rows))
    if "differences" in result:
        rows = [
            (f"{d['factor']}: {d['levels'][0]} - {d['levels'][1]}", _percent(d["difference"]),
             _interval(d["interval_90"]).strip(), _chance(d["p_equivalence"]), _chance(d["p_holm"]))
            for d in result["differences"]
        ]  # fmt: skip
        head = ("levels", "difference", "90 %", "p that it is 10 % or more", "after Holm")
        parts.append("<h2>Equivalence</h2>" + _table(head, rows))
    if result.get("model"):
        rows = [
            (m["term"], _number(m["log_odds"]), _interval(m["interval_95"], percent=False).strip(), _chance(m["p"]))
            for m in result["model"]
        ]
        parts.append("<h2>Logistic model</h2>" + _table(("term", "log-odds", "95 %", "p"), rows))
    parts.append("<h2>What was rendered</h2>" + _felt(result["felt"]))
    return parts


def _constant(found: dict[str, Any]) -> list[str]:
    """Return tables of how often each level was judged colder than the standard, and of the points of equality."""
    rows: list[tuple[Any, ...]] = [
        (
            f"{one['level']:g}",
            one["trials"],
            _percent(one["chosen"] / one["trials"]),
            _interval(one["panel_95"]).strip(),
        )
        for one in found["series"]
    ]
    head = (found["factor"], "trials", "judged colder", "95 %")
    parts = [f"<h2>Judged colder than {escape(found['standard'])}</h2>" + _table(head, rows)]
    equal, threshold = found["equal"], found["threshold"]
    rows = [
        (
            person,
            _number(value, 3) + _interval(equal["people_95"][person], percent=False),
            _number(threshold["people"][person], 3),
        )
        for person, value in equal["people"].items()
    ]
    rows.append(
        ("mean", *(_number(one["mean"], 3) + _interval(one["panel_95"], percent=False) for one in (equal, threshold)))
    )
    return [*parts, _table(("participant", "as cold as the standard", "to three of four"), rows)]


def _felt(felt: list[dict[str, Any]]) -> str:
    declared = known()
    names = dict.fromkeys(name for one in felt for name in one if name not in ("condition", "touches"))
    used = [declared.get(name) or Measured(name, "1", "not installed") for name in names]
    rows = [
        (_name(one["condition"]), one["touches"],
         *(f"{one[each.key]['mean'] * each.scale:.{each.digits}f}" if each.key in one else "-" for each in used))
        for one in felt
    ]  # fmt: skip
    return _table(("condition", "touches", *(each.page_head for each in used)), rows)
