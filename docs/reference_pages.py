"""Pages of the reference that are written by the program: scene elements, codes of messages, channels, Python API."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import channels
import python_api
import units_page

HERE = Path(__file__).parent


def write_pages() -> None:
    """Write the pages that differ from what is there."""
    for name, text in ((name, make()) for name, make in _pages().items()):
        _put(HERE / "reference" / name, text)
    stamp, digest = HERE / "_generated" / "code.sha256", _digest()
    page = HERE / "reference" / "errors.md"
    if page.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == digest:
        return
    from itouch.cli.explain.page import page as errors

    _put(page, errors())
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(digest, encoding="utf-8")


def _pages() -> dict[str, Callable[[], str]]:
    return {
        "scene.md": _scene,
        "sweep-language.md": _sweeps,
        "channels.md": channels.page,
        "units.md": units_page.page,
        **python_api.pages(),
    }


def _scene() -> str:
    from itouch.plugin.discovery import Catalog
    from itouch.scene.grammar import reference

    return reference(Catalog())


def _sweeps() -> str:
    from itouch.scene.grammar import elements_of
    from itouch.sweeps.elements import Sweep

    head = "# Elements of sweeps\n\nGenerated from the classes that read the files, as are those of scenes.\n"
    return head + elements_of(Sweep, "outermost")


def _digest() -> str:
    """Return a digest of the program's source."""
    root, digest = HERE.parent, hashlib.sha256()
    for folder in ("framework", "plugins", "scenes"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".xml"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _put(page: Path, text: str) -> None:
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
