"""The score card: a plugin's results for people, which fit a terminal of eighty columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Protocol

from itouch.testing.checks import CheckResult

_MARKS = {"passed": "ok  ", "failed": "FAIL", "left out": "-   "}
_WIDTH, _NAME = 80, 20
#: From this number on, checks that were left out for the same reason are counted and not named.
_MANY = 12


class Stream(Protocol):
    """Where a card is written."""

    def write(self, text: str, /) -> Any:
        """Write text."""

    def flush(self) -> None:
        """Make the text appear."""


class Card:
    """A score card that is written line by line while the checks run."""

    #: List to which cards are added as plain data; None: they are not kept.
    kept: ClassVar[list[dict[str, Any]] | None] = None

    def __init__(self, title: str, stream: Stream) -> None:
        self._stream, self._title = stream, title
        stream.write(f"{title}\n\n")

    def write(self, findings: Iterable[CheckResult]) -> bool:
        """Write a line for each finding as it comes, then the totals; return whether nothing failed."""
        seen: list[CheckResult] = []
        for finding in findings:
            seen.append(finding)
            if finding.outcome != "left out":
                self._line(finding)
            self._stream.flush()
        self._left_out(seen)
        count = {mark: sum(f.outcome == mark for f in seen) for mark in _MARKS}
        spent = sum(finding.seconds for finding in seen)
        failed = [finding.check.name for finding in seen if finding.outcome == "failed"]
        told = [f"{count['passed']} passed, {count['failed']} failed, {count['left out']} left out, in {spent:.1f} s"]
        if failed:
            told += textwrap.wrap(f"failed: {', '.join(failed)}", _WIDTH)
        self._stream.write("\n" + "\n".join(told) + "\n\n")
        if Card.kept is not None:
            Card.kept.append({"title": self._title, "failed": failed, "findings": [_data(one) for one in seen]})
        return not failed

    def _left_out(self, findings: Sequence[CheckResult]) -> None:
        """Write which checks were left out, by reason."""
        reasons: dict[str, list[str]] = {}
        for finding in findings:
            if finding.outcome == "left out":
                reasons.setdefault(finding.note, []).append(finding.check.name)
        for reason, names in reasons.items():
            told = ", ".join(names) if len(names) < _MANY else f"{len(names)} more checks"
            self._stream.write(_wrapped(f"{told}: {reason}", "  -     ") + "\n")

    def _line(self, finding: CheckResult) -> None:
        head = f"  {_MARKS[finding.outcome]}  {finding.check.name:<{_NAME}} "
        note = f" [{finding.note}]" if finding.note and finding.outcome != "failed" else ""
        self._stream.write(_wrapped(finding.check.title + note, head) + "\n")
        if finding.outcome == "failed":
            for line in finding.note.splitlines():
                label = line.strip()[:14] if line.startswith("  ") else ""
                self._stream.write(_wrapped(line.strip(), " " * 8, " " * (8 + len(label))) + "\n")


def _data(finding: CheckResult) -> dict[str, Any]:
    return {
        "name": finding.check.name, "title": finding.check.title, "outcome": finding.outcome, "note": finding.note,
        "seconds": round(finding.seconds, 3),
    }  # fmt: skip


def _wrapped(text: str, head: str, further: str = "") -> str:
    return textwrap.fill(text, _WIDTH, initial_indent=head, subsequent_indent=further or " " * len(head),
                         break_long_words=False, break_on_hyphens=False)  # fmt: skip
