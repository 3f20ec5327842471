"""``python -m itouch.servo.compile_ahead FILE``: compile the kernels that a first start needs, the last ones first.

The file is a scene, a session or a recording.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from itouch.gc_policy import keep_collections_rare
from itouch.servo.parent_process import end_with


def main(argv: Sequence[str]) -> int:
    """Build the engine without running any of it, and compile its steps; hardware is not opened.

    Modalities without compiled calls are left out, and never called: their work in Python would be in vain here.
    """
    parser = argparse.ArgumentParser(prog="itouch.servo.compile_ahead")
    parser.add_argument("scene")
    parser.add_argument("--parent", type=int, required=True)
    parser.add_argument("--twin")
    parser.add_argument("--rig")
    parser.add_argument("--part", type=float, default=0.0, help="how far from the end to begin")
    parser.add_argument("--together", type=Path, help="folder in which processes say what they compile")
    options = parser.parse_args(argv)
    end_with(options.parent)
    # from here on it takes long; this process ends with the one for which it compiles
    from itouch.compiling import compile_together, tell_needed
    from itouch.joining import listed, listing
    from itouch.loop import Engine
    from itouch.plugin import Modality
    from itouch.plugin.bases import Bases, keeping
    from itouch.plugin.discovery import Catalog
    from itouch.session import is_session, load_scene
    from itouch.session.open import read_session
    from itouch.world import Model

    compile_together(options.together)
    catalog = Catalog()
    bases = Bases()
    if is_session(options.scene):
        snapshot = read_session(options.scene, catalog)
        scene, bases = snapshot.scene, Bases(snapshot.bases)
    else:
        scene = load_scene(options.scene, rig=options.rig, twin=options.twin, catalog=catalog)
    classes = {part.name: catalog.modality(part.plugin, part.local) for part in scene.modalities}
    joins = {name for name, cls in classes.items() if cls and cls.bound_update is not Modality.bound_update}
    modalities = tuple(part for part in scene.modalities if part.name in joins)
    rates = replace(scene.rates, modalities=tuple(each for each in scene.rates.modalities if each[0] in joins))

    class Listed(Engine):
        """An engine that says which kernels it needs as soon as all of its steps are known: trying them takes long."""

        def _joined_tick(self) -> Callable[[], int] | None:
            found = super()._joined_tick()
            if options.part == 0.0:
                tell_needed(listed())
            return found

    with listing() as compile_listed:
        with (
            keeping(bases),
            contextlib.suppress(Exception),
        ):  # as nothing is run, some code may miss the result of what should have run
            Listed(Model.of(replace(scene, modalities=modalities, rates=rates), catalog))
        compile_listed(options.part)
    return 0


if __name__ == "__main__":
    keep_collections_rare()
    sys.exit(main(sys.argv[1:]))
