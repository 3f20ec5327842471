"""One start, stage by stage, in its own process, which prints the cost of each stage as JSON.

``python -m itouch_evidence.start.stages SCENE``
"""

from __future__ import annotations

import time

_BEGUN = time.process_time(), time.perf_counter()  # before other imports: the interpreter's own part

import json  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from contextlib import ExitStack  # noqa: E402
from typing import Any  # noqa: E402


class Stages:
    """Notes the CPU and wall time of each stage, and how many functions were compiled in it."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = [{"stage": "interpreter", "cpu": _BEGUN[0], "wall": 0.0, "compiled": 0}]
        self._last = _BEGUN
        self.compiled = 0

    def done(self, stage: str) -> None:
        """Note the stage that has just ended."""
        now = time.process_time(), time.perf_counter()
        counted = sum(row["compiled"] for row in self.rows)
        row = {"stage": stage, "cpu": now[0] - self._last[0], "wall": now[1] - self._last[1]}
        self.rows.append({**row, "compiled": self.compiled - counted})
        self._last = now


def main(argv: Sequence[str]) -> int:
    """Start a scene up to its first tick, and print the stages; exit code 2 if the scene cannot be started."""
    stages = Stages()
    from itouch.plugin.bases import Bases, keeping
    from itouch.plugin.discovery import Catalog
    from itouch.schema import ItouchError
    from itouch.session import Session, load_scene
    from itouch.world import Model

    stages.done("imports")
    with ExitStack() as stack:
        _count(stages)
        catalog, bases = Catalog(), Bases()
        try:
            scene = load_scene(argv[0], catalog=catalog)
            stages.done("scene")
            stack.enter_context(keeping(bases))
            model = Model.of(scene, catalog)
        except ItouchError as error:
            print(error, file=sys.stderr)
            return 2
        stages.done("model")
        session = Session(model, catalog=catalog, bases=bases)
        stages.done("session")
    session.tick()
    stages.done("first tick")
    print(json.dumps(stages.rows))
    return 0


def _count(stages: Stages) -> None:
    """Count the functions that Numba compiles, if Numba is there."""
    try:
        from numba.core import event
    except ImportError:
        return

    class Counter(event.Listener):  # type: ignore[misc, unused-ignore]
        def on_start(self, told: object) -> None:
            stages.compiled += 1

        def on_end(self, told: object) -> None:
            pass

    event.register("numba:compile", Counter())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
