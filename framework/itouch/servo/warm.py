"""``python -m itouch.servo.warm SCENE``: compile what a scene needs besides its modalities; used by a first start."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from itouch.loop import Engine
from itouch.plugin.discovery import Catalog
from itouch.session import load_scene
from itouch.world import Model


def main(argv: Sequence[str]) -> int:
    """Build the scene's engine without modalities; hardware is not opened."""
    parser = argparse.ArgumentParser(prog="itouch.servo.warm")
    parser.add_argument("scene")
    parser.add_argument("--twin")
    parser.add_argument("--rig")
    options = parser.parse_args(argv)
    catalog = Catalog()
    scene = load_scene(options.scene, rig=options.rig, twin=options.twin, catalog=catalog)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    bare = replace(scene, modalities=(), rates=replace(scene.rates, modalities=()))
    Engine(Model.of(bare, catalog))
    return 0


def _end_with(parent: int) -> None:
    """End this process when the one that started it has gone."""
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
