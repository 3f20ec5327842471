"""What a dataclass says of itself is so: it has slots, and is frozen unless something assigns to its fields."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest
from sources import ROOT, nodes

#: Classes of which another library decides, that keep what they have computed once (`cached_property`), or whose fields
#: only tests change, to make an instrument another one.
OTHERS = {"ItouchTeleopConfig", "ModalityHarness", "VirtualT7"}


@cache
def texts() -> dict[str, str]:
    found = [path for root in ("framework", "plugins") for path in sorted((ROOT / root).rglob("*.py"))]
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in found}


def flags(decorator: ast.expr) -> set[str] | None:
    """Return what a decorator of a dataclass switches on; None: it is another one."""
    call = decorator.func if isinstance(decorator, ast.Call) else decorator
    if ast.unparse(call) not in ("dataclass", "dataclasses.dataclass"):
        return None
    words = decorator.keywords if isinstance(decorator, ast.Call) else []
    return {str(one.arg) for one in words if ast.unparse(one.value) == "True"}


def stored(text: str) -> set[tuple[str, str]]:
    """Return the attributes that a module assigns to, each with the class whose ``self`` has it; "": of any object.

    What a class does to its ``self`` it may do to a field of what it is derived from.
    """
    found, owned = set[tuple[str, str]](), set[ast.Attribute]()
    for one in nodes(text):
        if isinstance(one, ast.ClassDef):
            names = [one.name, *(ast.unparse(base).rpartition(".")[2] for base in one.bases)]
            own = [
                node for node in ast.walk(one) if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "self"
            ]
            owned.update(own)
            found |= {(name, node.attr) for name in names for node in own if isinstance(node.ctx, ast.Store | ast.Del)}
    others = (node for node in nodes(text) if isinstance(node, ast.Attribute) and node not in owned)
    return found | {("", node.attr) for node in others if isinstance(node.ctx, ast.Store | ast.Del)}


def wrong(sources: dict[str, str]) -> Iterator[str]:
    """Yield the dataclasses that lack slots, or that could be frozen and are not."""
    assigned = cache(lambda file: stored(sources[file]))
    words = {file: set(re.findall(r"\w+", text)) for file, text in sources.items()}
    for file in (file for file in sources if "dataclass" in words[file]):
        stem = file.rpartition("/")[2].removesuffix(".py")
        for node in (
            node for node in nodes(sources[file]) if isinstance(node, ast.ClassDef) and node.name not in OTHERS
        ):
            for said in filter(lambda one: one is not None, map(flags, node.decorator_list)):
                if "slots" not in said:
                    yield f"{file}: {node.name} has no slots"
                fields = {ast.unparse(one.target) for one in node.body if isinstance(one, ast.AnnAssign)}
                if "frozen" in said or "setattr(" in ast.unparse(node):
                    continue
                near = [name for name in words if name == file or not words[name].isdisjoint((node.name, stem))]
                mine = {(owner, field) for owner in ("", node.name) for field in fields}
                if not any(mine & assigned(name) for name in near):
                    yield f"{file}: nothing assigns to the fields of {node.name}: it could be frozen"


def test_dataclasses_have_slots_and_are_frozen_unless_they_change() -> None:
    assert not list(wrong(texts()))


@pytest.mark.parametrize(
    ("decorator", "body", "says"),
    [
        ("@dataclass(frozen=True, slots=True)", "", ""),
        ("@dataclass(frozen=True, slots=False)", "", "no slots"),
        ("@dataclass(frozen=False, slots=True)", "", "could be frozen"),
        ("@dataclass(slots=True)", "\n    def to(self) -> None: self.x += 1", ""),
        ("@dataclass(slots=True)", "\nclass Other(Some):\n    def to(self) -> None: self.x += 1", ""),
        ("@dataclass(slots=True)", "\nclass Other:\n    def to(self) -> None: self.x += 1", "could be frozen"),
        ("@dataclass(slots=True)", "\ndef to(some: Some) -> None: some.x += 1", ""),
        ("@dataclass(slots=True)", "\n    def to(self, name: str) -> None: setattr(self, name, 1)", ""),
        ("@dataclasses.dataclass", "\n    def to(self) -> None: self.x = 1", "no slots"),
        ("@other", "", ""),
    ],
)
def test_what_could_be_otherwise_is_seen(decorator: str, body: str, says: str) -> None:
    found = list(wrong({"a/b.py": f"{decorator}\nclass Some:\n    x: int = 0{body}\n"}))
    assert len(found) == bool(says) and says in "".join(found)
