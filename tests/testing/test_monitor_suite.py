"""The conformance suite finds a monitor that loosens, forgets, meddles, or has no rule, by what it does."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

from itouch.plugin import Channel, Field, Moment, Monitor, Record, Role, Rule, Watched
from itouch.testing import CheckError
from itouch.testing.monitoring import examine

READS = (Channel("flow", 1, "A", (0.0,), (2.0,), doc="what flows", role=Role.DELIVERED_DRIVE),)
COMMANDS = (Channel("pulse", 1, "A", (0.0,), (2.0,), safe=(0.0,), role=Role.ELECTRODE),)


class Good(Monitor):
    """At most a second of more than 1.9 A."""

    name = "good"
    trips: ClassVar[dict[int, str]] = {1: "too-long"}

    @classmethod
    def of(cls, device: Watched) -> Iterator[Monitor]:
        yield cls(device)

    def fields(self) -> tuple[Field, ...]:
        return (Field("long", unit="s", doc="how long it was strong"),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        state["long"] += moment.seconds * (reading["flow"].item() > 1.9)
        return -1.0 if state["long"].item() > 1.0 else 1.0

    def rule(self, code: int, reading: Record) -> str:
        return "time"

    def rules(self) -> tuple[Rule, ...]:
        return (Rule("", "time", trip="1 s"),)


class Loosens(Good):
    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        return 1.5


class TripsUnknown(Good):
    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        return -2.0


class Remembers(Good):
    long = 0.0

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.long += moment.seconds
        return 1.0


class Meddles(Good):
    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        reading["flow"] = 0.0
        return 1.0


class NoRule(Good):
    def rule(self, code: int, reading: Record) -> str:
        return "T1"


def test_a_good_monitor_passes() -> None:
    examine(Good(Watched("it", "it", None, READS, COMMANDS)))


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (Loosens, "returns 1.5"), (TripsUnknown, "returns -2.0"), (Remembers, "keeps 'long' in an attribute"),
        (Meddles, "changes what it looks at"), (NoRule, "belongs to none of its rules"),
    ],
)  # fmt: skip
def test_a_bad_monitor_fails_with_its_fault_named(cls: Any, words: str) -> None:
    with pytest.raises(CheckError, match=words):
        examine(cls(Watched("it", "it", None, READS, COMMANDS)))
