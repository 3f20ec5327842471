"""The score card: how a plugin did, for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from itouch.testing.checks import Finding

_MARKS = {"passed": "ok  ", "failed": "FAIL", "left out": "-   "}


def write_card(title: str, findings: Sequence[Finding], stream: TextIO) -> bool:
    """Write the card; return whether nothing failed."""
    stream.write(f"{title}\n\n")
    width = max((len(finding.check.name) for finding in findings), default=0)
    for finding in findings:
        note = "" if finding.outcome == "failed" else f"  [{finding.note}]" if finding.note else ""
        stream.write(f"  {_MARKS[finding.outcome]}  {finding.check.name:<{width}}  {finding.check.title}{note}\n")
        if finding.outcome == "failed":
            stream.write("".join(f"          {line}\n" for line in finding.note.splitlines()))
    count = {mark: sum(f.outcome == mark for f in findings) for mark in _MARKS}
    spent = sum(finding.seconds for finding in findings)
    stream.write(
        f"\n{count['passed']} passed, {count['failed']} failed, {count['left out']} left out, in {spent:.1f} s\n"
    )
    return count["failed"] == 0
