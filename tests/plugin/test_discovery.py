"""What is installed while a process runs is found by the next look, though what was there before is not read again."""

from __future__ import annotations

import importlib.metadata as metadata
import re
import sys
from pathlib import Path

import pytest
from third_party_plugins import install

from itouch.plugin import discovery
from itouch.plugin.discovery import DEVICES, MODALITIES, PluginError, find

LIST = "[itouch.devices]\nstranger = nowhere:Nobody\n"


def test_what_is_installed_meanwhile_is_found_and_what_is_taken_away_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    site.mkdir()
    assert "stranger" not in find(DEVICES)
    monkeypatch.syspath_prepend(site)
    assert "stranger" not in find(DEVICES)
    install(site, "a-stranger", LIST)
    assert find(DEVICES)["stranger"].distribution == "a-stranger"
    monkeypatch.undo()
    assert "stranger" not in find(DEVICES)


def test_what_is_as_it_was_is_read_once_for_all_groups(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(install(tmp_path / "site", "a-stranger", LIST))
    looks, look = list[int](), metadata.entry_points
    monkeypatch.setattr(discovery.metadata, "entry_points", lambda **groups: (looks.append(1), look(**groups))[1])
    first = find(DEVICES)
    first.clear()  # whoever asks may change what it was given
    assert "stranger" in find(DEVICES) and "thermal.flux-control" in find(MODALITIES)
    assert len(looks) == 1


@pytest.mark.parametrize(
    ("entry", "text", "said", "again"),
    [
        ("nowhere:Nobody", "", "ModuleNotFoundError: No module named 'nowhere'", True),
        ("there.gone:Nobody", "", "ModuleNotFoundError: No module named 'there.gone'", True),
        ("there:Nobody", "", "AttributeError: module 'there' has no attribute 'Nobody'", True),
        ("there:Nobody", "import nowhere", "ModuleNotFoundError: No module named 'nowhere'", False),
        ("there:Nobody", "class Nobody: pass\nNobody.none", "AttributeError: type object 'Nobody' has no", False),
        ("there:Nobody.none", "class Nobody: pass", "AttributeError: type object 'Nobody' has no attribute", False),
        ("nowhere", "", "ModuleNotFoundError: No module named 'nowhere'", True),
        ("nowhere:Nobody [extra]", "", "ModuleNotFoundError: No module named 'nowhere'", True),
        ("no where at all", "", "failed to load", False),
        (":", "", "failed to load", False),
    ],
)
def test_what_is_not_where_it_was_when_it_was_installed_is_to_be_installed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, entry: str, text: str, said: str, again: bool
) -> None:
    """As after another version was taken from a repository; what a plugin itself lacks no installation brings."""
    site = install(tmp_path / "site", "a-stranger", f"[itouch.devices]\nstranger = {entry}\n")
    (site / "there").mkdir()
    (site / "there" / "__init__.py").write_text(text)
    monkeypatch.syspath_prepend(site)
    for name in ("there", "there.gone"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(PluginError, match=re.escape(said)) as told:
        find(DEVICES)["stranger"].load()
    sys.modules.pop("there", None)
    assert str(told.value).endswith("; correct its entry point, or install a-stranger again") == again
