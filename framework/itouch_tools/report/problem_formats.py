"""Problems of scenes for programs: as JSON, and as SARIF 2.1.0, which annotates a scene's lines in a code review."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from itouch.schema.diagnostics import Place, Problem
from itouch_tools.authoring.codes import CODES
from itouch_tools.authoring.fixes import Edit

_LEVELS = {"error": "error", "warning": "warning", "note": "note"}


def as_entries(problems: Sequence[Problem]) -> list[dict[str, Any]]:
    """Return problems as plain data: severity, code, sentence, advice and places; lines and columns count from 1."""
    return [
        {
            "severity": problem.severity,
            "code": problem.code,
            "message": problem.sentence,
            "help": problem.advice,
            "place": _place(problem.place),
            "related": [{"label": label, "place": _place(place)} for place, label in problem.related],
        }
        for problem in problems
    ]


def _place(place: Place | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {"file": place.file, "line": place.line, "column": place.column, "length": place.length}


def as_sarif(
    found: Mapping[str, Sequence[Problem]], *, version: str, edits: Mapping[Problem, Sequence[Edit]] | None = None
) -> dict[str, Any]:
    """Return the problems of scenes as one SARIF log.

    Parameters
    ----------
    found
        Problems by the path of the scene that was checked.
    version
        The program's version.
    edits
        What ``check --fix`` would do about a problem: a code review offers it as a fix.
    """
    rules = sorted({problem.code for problems in found.values() for problem in problems})
    results = [
        _result(problem, path, rules) | _fixes(problem, path, (edits or {}).get(problem, ()))
        for path, problems in found.items() for problem in dict.fromkeys(problems)
    ]  # fmt: skip
    driver = {
        "name": "itouch-py", "version": version, "semanticVersion": version,
        "rules": [_rule(code) for code in rules],
    }  # fmt: skip
    return {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}],
    }


def _rule(code: str) -> dict[str, Any]:
    known = CODES.get(code)
    rule: dict[str, Any] = {"id": code}
    if known is not None:
        rule["shortDescription"] = {"text": known.wrong}
        rule["help"] = {"text": known.remedy}
    return rule


def _result(problem: Problem, path: str, rules: list[str]) -> dict[str, Any]:
    advice = f"\n{problem.advice}" if problem.advice else ""
    result: dict[str, Any] = {
        "ruleId": problem.code,
        "ruleIndex": rules.index(problem.code),
        "level": _LEVELS.get(problem.severity, "warning"),
        "message": {"text": problem.sentence + advice},
        "locations": [_location(problem.place, path)],
    }
    if problem.related:
        result["relatedLocations"] = [
            {"id": index, "message": {"text": label}, **_location(place, path)}
            for index, (place, label) in enumerate(problem.related)
        ]
    return result


def _fixes(problem: Problem, path: str, edits: Sequence[Edit]) -> dict[str, Any]:
    """Return the one fix of a problem, if there is one."""
    if not edits or problem.mend is None:
        return {}
    replacements = [
        {
            "deletedRegion": {"startLine": e.line, "startColumn": e.column, "endColumn": e.column + e.length},
            "insertedContent": {"text": e.text},
        }
        for e in edits
    ]
    file = _location(problem.place, path)["physicalLocation"]["artifactLocation"]
    wrong, right = problem.mend
    change = {"artifactLocation": file, "replacements": replacements}
    return {"fixes": [{"description": {"text": f"'{wrong}' becomes '{right}'"}, "artifactChanges": [change]}]}


def _location(place: Place | None, path: str) -> dict[str, Any]:
    uri = (place.file if place is not None else path).replace("\\", "/")
    found: dict[str, Any] = {"artifactLocation": {"uri": _escaped(uri)}}
    if place is not None:
        found["region"] = {
            "startLine": place.line, "startColumn": place.column, "endColumn": place.column + max(1, place.length),
        }  # fmt: skip
    return {"physicalLocation": found}


def _escaped(path: str) -> str:
    from urllib.parse import quote

    return quote(path, safe="/:")
