"""``python -m itouch.servo.compile_ahead SCENE``: compile what a first start needs besides the modalities."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from itouch.servo.parent_process import end_with


def main(argv: Sequence[str]) -> int:
    """Build the scene's engine without modalities; hardware is not opened."""
    parser = argparse.ArgumentParser(prog="itouch.servo.compile_ahead")
    parser.add_argument("scene")
    parser.add_argument("--parent", type=int, required=True)
    parser.add_argument("--twin")
    parser.add_argument("--rig")
    options = parser.parse_args(argv)
    end_with(options.parent)
    # from here on it takes long: nothing of it outlives the process that it is for
    from itouch.loop import Engine
    from itouch.plugin.discovery import Catalog
    from itouch.session import load_scene
    from itouch.world import Model

    catalog = Catalog()
    scene = load_scene(options.scene, rig=options.rig, twin=options.twin, catalog=catalog)
    bare = replace(scene, modalities=(), rates=replace(scene.rates, modalities=()))
    Engine(Model.of(bare, catalog))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
