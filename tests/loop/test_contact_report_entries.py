"""The report's entry of a contact is made in parts, one a tick, and says what one says that is made at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import itouch
from itouch.plugin import Bound, Field, Modality, Record
from itouch.plugin.discovery import Catalog, Found, find
from itouch.plugin.kernels import kernel

SCENE = """<itouch version="1.0" xmlns:tone="urn:itouch:plugin:tone">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion>
      <to pos="0 0 30 mm" in="20 ms"/><to pos="0 0 5 mm" in="100 ms"/><to pos="0 0 60 mm" in="150 ms" hold="60 ms"/>
    </motion></operator>
    <tone:low/><tone:high/>
  </interaction>
</itouch>
"""


@kernel
def one_more(count: Any) -> int:
    """Count."""
    count[0] += 1.0
    return 0


@dataclass(frozen=True)
class Params:
    """Nothing."""


class Low(Modality):
    """Measures the contact's force, as State has it, and does what else a test wants."""

    Params = Params
    subscribes_to = frozenset()  # then nothing of an end is left to Python

    def __init__(self) -> None:
        self.asked: Callable[[], object] = int

    def compile(self, name: str, params: Any, world: Any) -> str:
        return name

    def fields(self, model: str) -> tuple[Field, ...]:
        return (Field("count"),)

    def reset(self, model: str, state: Record) -> None:
        state[f"{model}.count"] = 0.0

    def update(self, model: str, state: Record, period: float) -> None:
        one_more(state[f"{model}.count"].reshape(1))

    def bound_update(self, model: str, state: Record, period: float) -> Bound:
        return Bound(one_more, state[f"{model}.count"].reshape(1))

    def measures(self, model: Any, state: Record, probe: str, object_index: int) -> dict[str, Any]:
        self.asked()
        return {"tone": 1e3 * state[f"{probe}.contact.peak_force"].item(), "tick": state["tick"].item()}


class High(Low):
    """Measures the same."""


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def finder(group: str) -> dict[str, Found]:
    """Return the plugins that are installed, and the two of this file."""
    found = dict(find(group))
    if group == "itouch.modalities":
        for name, cls in (("tone.low", Low), ("tone.high", High)):
            found[name] = Found(name, "itouch-tone", "1.0", Entry(cls))  # type: ignore[arg-type]
    return found


def built(folder: Path, **given: Any) -> itouch.Session:
    """Return a session with both modalities, in which the finger touches once."""
    path = folder / "scene.xml"
    path.write_text(SCENE, encoding="utf-8")
    return itouch.build(path, catalog=Catalog(finder), seed=1, **given)


def asked(session: itouch.Session) -> list[int]:
    """Return a list to which each modality adds the tick in which it is asked what it has measured."""
    found: list[int] = []
    for one in session.model.modalities:
        one.instance.asked = lambda: found.append(session.ticks)
    return found


def to_the_middle(session: itouch.Session) -> list[int]:
    """Run until one modality has been asked, and not yet the other."""
    found = asked(session)
    session.run(until=lambda: bool(found))
    assert len(found) == 1 and not session.done
    return found


@pytest.fixture
def at_once(tmp_path: Path) -> dict[str, Any]:
    """Return the entry of a contact whose end the report is asked for at once."""
    session = built(tmp_path)
    count = session.state["events.count"]
    session.run(until=lambda: int(count) == 3)  # near, begin, end
    found = asked(session)
    (entry,) = session.statistics.contacts
    assert found == [session.ticks, session.ticks]
    assert entry["tone"] == entry["high:tone"] == 1e3 * entry["peak_force_N"] > 1.0
    session.close()
    return dict(entry)


@pytest.mark.parametrize("clock", [itouch.VirtualClock, itouch.WallClock])
def test_each_modality_is_asked_in_a_tick_of_its_own(clock: type, tmp_path: Path, at_once: dict[str, Any]) -> None:
    session = built(tmp_path, clock=clock())
    found = asked(session)
    session.run(until=lambda: session.done)  # which is asked after each tick: no tick is run with others
    first, second = found
    assert second == first + 1 if clock is itouch.VirtualClock else second > first  # a late loop leaves periods out
    assert session.report()["contacts"] == [at_once]
    session.close()


def test_a_report_between_two_parts_has_the_whole_entry_and_none_comes_twice(
    tmp_path: Path, at_once: dict[str, Any]
) -> None:
    session = built(tmp_path)
    found = to_the_middle(session)
    assert session.report()["contacts"] == [at_once]
    session.run()
    assert session.report()["contacts"] == [at_once] and len(found) == 2
    session.close()


def test_a_session_that_is_saved_between_two_parts_goes_on_with_the_whole_entry(
    tmp_path: Path, at_once: dict[str, Any]
) -> None:
    session = built(tmp_path)
    to_the_middle(session)
    session.save(tmp_path / "middle.itouch")
    session.close()
    restored = itouch.restore(tmp_path / "middle.itouch", catalog=Catalog(finder))
    restored.run()
    assert restored.report()["contacts"] == [at_once]
    restored.close()


def test_ctrl_c_in_the_second_part_loses_no_figure_and_doubles_none(tmp_path: Path, at_once: dict[str, Any]) -> None:
    session = built(tmp_path)
    pressed: list[int] = []

    def act() -> None:
        pressed.append(1)
        if len(pressed) == 1:
            raise KeyboardInterrupt

    session.model.modalities[1].instance.asked = act
    with pytest.raises(KeyboardInterrupt):
        session.run()
    assert session.report()["contacts"] == [at_once] == session.report()["contacts"]
    assert len(pressed) == 2
    session.close()


def test_a_modality_that_asks_for_the_contacts_while_it_is_asked_is_given_those_before(
    tmp_path: Path, at_once: dict[str, Any]
) -> None:
    session = built(tmp_path)
    seen: list[int] = []
    for one in session.model.modalities:
        one.instance.asked = lambda: seen.append(len(session.statistics.contacts))
    session.run()
    assert session.report()["contacts"] == [at_once] and seen == [0, 0]
    session.close()
