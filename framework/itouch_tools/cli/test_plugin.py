"""``itouch-py test-plugin NAME``: run the conformance suite on an installed plugin, and print a score card."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch_tools.cli.arguments import Parser, add_json, as_json

if TYPE_CHECKING:
    from itouch.plugin.discovery import Catalog
    from itouch.scene import Scene


def main(argv: Sequence[str]) -> int:
    """Examine an installed plugin; exit code 1 if it lacks something."""
    parser = Parser(prog="itouch-py test-plugin", description=main.__doc__)
    examined = "a device plugin, a modality PLUGIN.LOCAL, a plugin with both, or what a probe may name as its carrier"
    parser.add_argument("name", metavar="NAME", help=examined)
    parser.add_argument("--scene", metavar="FILE", help="a scene that uses it: its parameters are taken from there")
    parser.add_argument("--hardware", action="store_true", help="open the device, too; it is commanded what is safe")
    parser.add_argument("--emulator", action="store_true", help="run the driver on the plugin's emulator, too")
    add_json(parser)
    options = parser.parse_args(argv)
    need("test")
    with cards(options.json):
        return _examine(options)


@contextlib.contextmanager
def cards(json: bool) -> Iterator[None]:
    """Print score cards as they come; with ``json`` print their findings at the end, as one document."""
    from itouch.testing.score_card import Card

    if not json:
        yield
        return
    Card.kept = []
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
        print(as_json({"cards": Card.kept, "passed": not any(card["failed"] for card in Card.kept)}))
    finally:
        Card.kept = None


def _examine(options: argparse.Namespace) -> int:
    from itouch.plugin.discovery import Catalog

    catalog = Catalog()
    scene = _scene(options.scene, catalog)
    known = [f"{plugin}.{local}" for plugin in catalog.plugin_names for local in catalog.modality_names(plugin)]
    chosen = [name for name in known if options.name in (name, name.split(".")[0])]
    carriers = [name for name in catalog.carrier_names if name == options.name and name not in known]
    listed = [*chosen, *carriers]
    if scene is not None and (listed or options.name in catalog.device_names):
        used = _used(scene, catalog)
        _require_used(options, used, listed)
        listed = [name for name in listed if name in used]
    good, found = True, bool(chosen or carriers)
    if options.name in catalog.device_names:
        good, found = _device(options, catalog, scene), True
    for name in listed:
        good = _modality(name, options.scene, catalog) and good
    for name in [*chosen, *carriers]:
        if name not in listed:
            print(f"note: modality '{name}' was not examined: '{options.scene}' does not use it", file=sys.stderr)
    if not found:
        from itouch.schema.diagnostics import did_you_mean

        advice = did_you_mean(
            options.name, [*catalog.device_names, *known, *catalog.carrier_names], "installed plugins are"
        )
        raise ItouchError(f"there is no plugin named '{options.name}'\n  = help: {advice}")
    return 0 if good else 1


def _scene(path: str | None, catalog: Catalog) -> Scene | None:
    from itouch.scene import load

    return load(path, catalog) if path else None


def _used(scene: Scene, catalog: Catalog) -> set[str]:
    """Return the names of the plugins, modalities and carriers that a scene uses."""
    used = {device.plugin for device in scene.devices} | {f"{one.plugin}.{one.local}" for one in scene.modalities}
    return used | {probe.carrier or catalog.carrier()[0] for probe in scene.probes if probe.surface_to}


def _require_used(options: argparse.Namespace, used: Collection[str], modalities: Sequence[str]) -> None:
    """Refuse a scene that uses nothing of what is examined.

    Raises
    ------
    ItouchError
        If so.
    """
    if not {options.name, *modalities} & set(used):
        raise ItouchError(
            f"'{options.scene}' does not use '{options.name}', so nothing could be taken from it\n"
            f"  = help: it uses {', '.join(sorted(used)) or 'no plugin'}; name another scene, or omit --scene"
        )


def _device(options: argparse.Namespace, catalog: Catalog, scene: Scene | None) -> bool:
    from dataclasses import replace

    from itouch.testing.checks import examine
    from itouch.testing.harness import DeviceHarness
    from itouch.testing.open_device import Shared
    from itouch.testing.score_card import Card
    from itouch.testing.suites import DEVICE_CHECKS, EMULATOR_CHECKS

    cls = catalog.device(options.name)
    if cls is None:
        raise ItouchError(catalog.failure(options.name))
    params = None
    if scene is not None:
        parts = [p.params for d in scene.devices if d.plugin == options.name for p in d.parts if p.plugin == d.plugin]
        params = parts[0] if parts else None
    harness = DeviceHarness(cls, options.name, params, options.hardware)
    card = Card(f"device '{options.name}' {catalog.version(options.name)}", sys.stdout)
    checks = [check for check in DEVICE_CHECKS if not options.emulator or check not in EMULATOR_CHECKS]
    good = card.write(examine(checks, harness))
    if options.emulator:
        card = Card(f"device '{options.name}' on its emulator", sys.stdout)
        shared = Shared() if cls.moves_on_open else None
        try:
            emulated = replace(harness, hardware=False, emulated=True, shared=shared)
            good = card.write(examine(EMULATOR_CHECKS, emulated)) and good
        finally:
            if shared is not None:
                shared.end()
    return good


def _modality(name: str, path: str | None, catalog: Catalog) -> bool:
    from pathlib import Path

    from itouch.testing.checks import NotApplicableError, examine
    from itouch.testing.scenario import ModalityHarness
    from itouch.testing.score_card import Card
    from itouch.testing.suites import MODALITY_CHECKS

    plugin, _, local = name.partition(".")
    cls = catalog.carrier(name)[1] if name in catalog.carrier_names else catalog.modality(plugin, local)
    if cls is None:
        raise ItouchError(catalog.failure(plugin))
    harness = ModalityHarness(cls, Path(path) if path else None, name=name)
    try:
        harness.seconds  # noqa: B018  (looked for once, and told before the card)
    except NotApplicableError as reason:
        raise ItouchError(f"modality '{name}' can't be examined: {reason}") from reason
    card = Card(f"modality '{name}' {catalog.version(plugin)}", sys.stdout)
    return card.write(examine(MODALITY_CHECKS, harness))
