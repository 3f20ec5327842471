"""``itouch-py check SCENE...``: every problem with file, line and column; nothing is started."""

from __future__ import annotations

import argparse
from collections.abc import Sequence


def main(argv: Sequence[str]) -> int:
    """Print every problem of scene files."""
    parser = argparse.ArgumentParser(prog="itouch-py check", description=main.__doc__)
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="a scene file")
    parser.add_argument("--rig", metavar="FILE", help="check with another rig under the scene")
    parser.add_argument("--twin", metavar="all|none|NAME", help="check with these devices as twins")
    options = parser.parse_args(argv)
    results = [_check(path, options.rig, options.twin) for path in options.scenes]
    return 0 if all(results) else 2


def _check(path: str, rig: str | None, twin: str | None) -> bool:
    """Check one scene; tell whether it is right."""
    import sys

    from itouch.plugin.discovery import Catalog
    from itouch.report.limits import limit_lines
    from itouch.scene.loader import in_file_order, read_scene
    from itouch.schema.diagnostics import SceneError, render
    from itouch.session import choose_twins
    from itouch.session.wishes import recording_problems
    from itouch.world import compile_scene

    catalog = Catalog()
    scene, problems = read_scene(path, catalog, rig=rig)
    try:
        scene = scene if twin is None else choose_twins(scene, twin)
    except SceneError as error:
        problems += error.problems
    broken = any(problem.severity == "error" for problem in problems)
    model, more = (None, []) if broken else compile_scene(scene, catalog)
    unrecordable = recording_problems(model) if model is not None else []
    found = in_file_order([*problems, *more, *unrecordable])
    if found:
        print(render(found), file=sys.stderr)
    if model is None or unrecordable:
        return False
    for notice in model.notices:
        print(f"note: {notice}")
    counts = f"{len(model.objects)} objects, {len(model.devices)} devices, {len(model.modalities)} modalities"
    print(f"{path}: ok ({counts})")
    for device in model.devices.values():
        for line in limit_lines(device):
            print(f"  {line}")
    return True
