"""The page of vocabulary names every public class, once, and nothing that is not there."""

from __future__ import annotations

import re
from importlib import import_module

from sources import ROOT

PAGE = (ROOT / "docs" / "reference" / "vocabulary.md").read_text(encoding="utf-8")
PUBLIC = ("itouch", "itouch.plugin", "itouch.testing")


def test_every_public_class_has_its_word() -> None:
    named = re.findall(r"`(itouch(?:\.\w+)+)`", PAGE)
    assert len(set(named)) == len(named), "a name stands twice"
    said = {getattr(import_module(module), name) for module, _, name in (one.rpartition(".") for one in named)}
    for module in PUBLIC:
        offered = import_module(module)
        for name in offered.__all__:
            thing = getattr(offered, name)
            assert not isinstance(thing, type) or thing in said, f"{module}.{name}"


def test_every_word_says_what_it_means() -> None:
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ?[^|]*\|$", PAGE, flags=re.MULTILINE)
    rows = [row for row in rows if row[0] != "word" and not row[0].startswith("---")]
    assert len(rows) > 40
    words = [word.strip() for row in rows for word in row[0].split(",")]
    assert len(set(words)) == len(words)
    assert all(len(meaning.split()) >= 5 for _, meaning in rows)
