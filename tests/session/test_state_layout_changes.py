"""A plugin whose State has changed: added fields take their defaults, what can't be mapped is refused with the reason."""

from __future__ import annotations

import importlib.metadata as metadata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Field, Modality, Record
from itouch.plugin.discovery import Catalog, Found, find
from itouch.session.layout_mapping import ChangedFields, adopt, compare

SCENE = """<itouch version="1.0" xmlns:tone="urn:itouch:plugin:tone">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="block" size="1 1 1 cm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" pose-from="arm"/><tone:hum/></interaction>
</itouch>
"""


@dataclass(frozen=True)
class Params:
    """Nothing."""


def modality(*fields: Field) -> type[Modality]:
    class Hum(Modality):
        """Counts, whatever its fields are."""

        def compile(self, name: str, params: Any, world: Any) -> None:
            return None

        def fields(self, model: Any) -> tuple[Field, ...]:
            return fields

        def reset(self, model: Any, state: Record) -> None:
            for field in fields:
                state[f"hum.{field.name}"] = 7

        def update(self, model: Any, state: Record, period: float) -> None:
            state["hum.count"][...] += 1

    Hum.Params = Params
    return Hum


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def catalog(cls: type[Modality], version: str = "1.0") -> Catalog:
    def finder(group: str) -> dict[str, Found]:
        found = dict(find(group))
        if group == "itouch.modalities":
            found["tone.hum"] = Found("tone.hum", "itouch-tone", version, Entry(cls))  # type: ignore[arg-type]
        return found

    return Catalog(finder)


COUNT = Field("count", "i8")


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    plugins = catalog(modality(COUNT, Field("level", "f4", 3), Field("old", "i4")))
    session = itouch.build(tmp_path / "scene.xml", catalog=plugins)
    session.run(0.05)
    session.save(tmp_path / "s.itouch")
    return tmp_path / "s.itouch"


@pytest.mark.parametrize("name", ["λ", "größe", "Ωmega_温度"])
def test_names_of_fields_may_have_any_letters(name: str, tmp_path: Path) -> None:
    """Their letters come back from a snapshot as they are, and nothing is said of them."""
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    plugins = catalog(modality(COUNT, Field(name, "f8", 2)))
    session = itouch.build(tmp_path / "scene.xml", catalog=plugins)
    session.run(0.02)
    session.save(tmp_path / "s.itouch")
    restored = itouch.restore(tmp_path / "s.itouch", catalog=plugins)
    assert restored.notices == ()
    assert restored.state.tobytes() == session.state.tobytes()


def test_an_added_field_takes_its_default_and_is_told(saved: Path) -> None:
    new = modality(Field("fresh", "f8", 2), COUNT, Field("old", "i4"), Field("level", "f4", 3))
    session = itouch.restore(saved, catalog=catalog(new, "1.1"))
    assert session.state["hum.fresh"].tolist() == [7.0, 7.0]
    assert int(session.state["hum.count"]) == 57
    assert any("+ hum.fresh: ('<f8', (2,)): new, starts at its default" in notice for notice in session.notices)
    session.run(0.05)
    assert int(session.state["hum.count"]) == 107


def test_a_wider_type_keeps_the_numbers(saved: Path) -> None:
    session = itouch.restore(saved, catalog=catalog(modality(COUNT, Field("level", "f8", 3), Field("old", "i8"))))
    assert session.state["hum.level"].tolist() == [7.0] * 3
    assert any("~ hum.level" in notice for notice in session.notices)


def test_a_field_that_a_plugin_does_not_need_any_more_is_left_out(saved: Path) -> None:
    new = modality(COUNT, Field("level", "f4", 3))
    new.removed_fields = frozenset({"old"})
    session = itouch.restore(saved, catalog=catalog(new, "1.1"))
    assert int(session.state["hum.count"]) == 57
    assert session.state["hum.level"].tolist() == [7.0] * 3


def test_a_row_that_has_become_longer_keeps_what_was_stored_where_the_plugin_says_so(saved: Path) -> None:
    longer = modality(COUNT, Field("level", "f4", 5), Field("old", "i4"))
    longer.extended_fields = frozenset({"level"})
    session = itouch.restore(saved, catalog=catalog(longer, "1.1"))
    assert int(session.state["hum.count"]) == 57 and session.state["hum.level"].tolist() == [7.0] * 5
    stored = np.zeros(1, np.dtype([("a", "f8", (2, 2)), ("b", "f8", 3), ("c", "i8")]))
    stored["a"], stored["b"], stored["c"] = [[1.0, 2.0], [3.0, 4.0]], 5.0, 6
    others = (Field("b", "f8", 3), Field("c", "i8"))
    fresh = Record.of((Field("a", "f8", (2, 3)), *others))
    fresh["a"][...] = 9.0
    content, _ = adopt(stored, fresh, {}, ChangedFields(extended_fields=frozenset({"a", "b"})))
    assert np.frombuffer(content, fresh.dtype)["a"][0].tolist() == [[1.0, 2.0, 9.0], [3.0, 4.0, 9.0]]
    assert np.frombuffer(content, fresh.dtype)["b"][0].tolist() == [5.0] * 3
    for other in (Field("a", "f8", (2, 1)), Field("a", "f8", (3, 3)), Field("a", "f4", (2, 3))):
        with pytest.raises(itouch.SessionError, match="! a: "):
            adopt(stored, Record.of((other, *others)), {}, ChangedFields(extended_fields=frozenset({"a"})))


@pytest.mark.parametrize(
    ("fields", "line"),
    [((COUNT, Field("level", "f4", 3)), r"- hum.old: int32: there is no such field any more"),
     ((COUNT, Field("level", "f4", 4), Field("old", "i4")), r"! hum.level: \('<f4', \(3,\)\) -> \('<f4', \(4,\)\): its shape or type"),
     ((COUNT, Field("level", "f4", 3), Field("old", "f4")), r"! hum.old: int32 -> float32"),
     ((COUNT, Field("level", "i4", 3), Field("old", "i4")), r"! hum.level")],
)  # fmt: skip
def test_what_cannot_be_mapped_is_refused_field_by_field(saved: Path, fields: tuple[Field, ...], line: str) -> None:
    with pytest.raises(itouch.SessionError, match=line) as caught:
        itouch.restore(saved, catalog=catalog(modality(*fields), "2.0"))
    assert "tone 1.0" in str(caught.value)


def test_the_manifest_says_who_wrote_it(saved: Path) -> None:
    manifest = (
        itouch.restore(saved, catalog=catalog(modality(COUNT, Field("level", "f4", 3), Field("old", "i4"))))
        .snapshot()
        .manifest
    )
    assert manifest["plugins"] == {"tone": "1.0", "usb-arm": metadata.version("itouch-py")}
    assert {
        "format",
        "itouch-py",
        "layout",
        "model",
        "scene",
        "state",
        "tick",
        "seed",
        "host",
        "git",
        "calibration",
    } <= set(manifest)


def test_only_the_order_differs() -> None:
    one, two = np.dtype([("a", "i8"), ("b", "f8")]), np.dtype([("b", "f8"), ("a", "i8")])
    assert compare(one, two).fits
    assert compare(one, two).moved
    assert SCENES.is_dir()


def test_the_hands_target_is_found_under_its_former_name() -> None:
    state = Record.of((Field("finger.hand.target_offset", "f8", 3, unit="m", doc="where the hand is steered to"),))
    stored = np.zeros(1, np.dtype([("finger.hand.wanted", "f8", 3)]))
    stored["finger.hand.wanted"] = (0.01, -0.02, 0.0)
    content, said = adopt(stored, state, {})
    assert np.frombuffer(content, "f8")[:3].tolist() == [0.01, -0.02, 0.0] and said == []


@pytest.mark.parametrize(("missed", "lost"), [(0.0, 0.0), (2.0, 2.0), (3.0, 0.0)])  # 3: safety keeps it away
def test_what_carries_a_surface_remembers_what_stood_in_the_framework(missed: float, lost: float) -> None:
    session = itouch.build(SCENES / "four_materials.xml")
    before, own = session.state.copy(), ("takes", "arrived", "lost", "yields")
    before["finger.surface.renders"], before["finger.surface.settled"] = 1.0, 0.5
    before["finger.surface.missed"], before["finger.plate_yield"] = missed, 0.25
    names = [name for name in before.dtype.names or () if name not in {f"finger.surface.{field}" for field in own}]
    stored = np.zeros(1, np.dtype([(name, before.dtype[name]) for name in names]))
    for name in names:
        stored[name] = before[name]
    taken, _ = adopt(stored, session.state, {})
    now = np.frombuffer(taken, session.state.dtype)
    assert [now[f"finger.surface.{field}"].item() for field in own] == [1.0, 0.5, lost, 0.25]
    session.close()
