"""What a plugin has left out is said in one sentence that its author can follow, wherever the plugin is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from third_party_plugins import install

import itouch
from itouch.plugin import Device, Modality, Record, pose
from itouch.plugin.discovery import Catalog, Found, find
from itouch_tools.cli import main


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Bare(Device):
    """Reads a place; how it is told which one, it does not say."""

    reads = (pose(),)

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def read(self, reading: Record) -> bool:
        """Nothing."""
        return False


class Untyped(Bare):
    """Has parameters that are no dataclass."""

    Params = dict


class BareModality(Modality):
    """Does nothing, with what, it does not say."""

    def compile(self, *_: Any) -> None:
        """Nothing."""

    def reset(self, *_: Any) -> None:
        """Nothing."""

    def update(self, *_: Any) -> None:
        """Nothing."""


class Half(Device):
    """Cannot be closed."""

    Params, reads = Nothing, (pose(),)

    def open(self) -> None:
        """Nothing."""


class HalfModality(Modality):
    """Does nothing at all."""

    Params = Nothing


def offering(group: str, name: str, cls: type) -> Callable[[str], dict[str, Found]]:
    def finder(asked: str) -> dict[str, Found]:
        entry: Any = SimpleNamespace(value=cls.__name__, load=lambda: cls)
        return {**find(asked), **({name: Found(name, "stranger", "1.0", entry)} if asked == group else {})}

    return finder


DEVICES = '<devices><device name="d" plugin="stranger" twin="{}"/></devices>'
PARAMS = "declares no Params: write 'Params = NAME'"
INTERACTION = '<interaction><s:it xmlns:s="urn:itouch:plugin:stranger"/></interaction>'


@pytest.mark.parametrize(
    ("group", "name", "cls", "inside", "says"),
    [
        ("itouch.devices", "stranger", Bare, DEVICES.format("no"), PARAMS),
        ("itouch.devices", "stranger", Bare, DEVICES.format("yes"), PARAMS),
        ("itouch.devices", "stranger", Untyped, DEVICES.format("yes"), PARAMS),
        ("itouch.devices", "stranger", Half, DEVICES.format("yes"), "does not define close, read: each needs a method"),
        ("itouch.modalities", "stranger.it", BareModality, INTERACTION, PARAMS),
        ("itouch.modalities", "stranger.it", HalfModality, INTERACTION, "does not define compile, reset, update: each"),
    ],
)
def test_a_plugin_that_has_left_something_out_is_named(
    tmp_path: Path, group: str, name: str, cls: type, inside: str, says: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path = tmp_path / "s.xml"
    path.write_text(f'<itouch version="1.0">{inside}</itouch>', "utf-8")
    catalog = Catalog(offering(group, name, cls))
    with pytest.raises(itouch.SceneError, match=f"class '{cls.__name__}' {says}"):
        itouch.build(path, catalog=catalog)
    monkeypatch.syspath_prepend(
        install(tmp_path / "site", "a-stranger", f"[{group}]\n{name} = {__name__}:{cls.__name__}\n")
    )
    for words in (["check", str(path)], [str(path), "--headless", "--for", "1s"]):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert f"class '{cls.__name__}' {says}" in said
        assert "Traceback" not in said
