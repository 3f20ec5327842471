"""The shipped scenes command what they commanded when that was kept: a change that nobody meant is seen here."""

from __future__ import annotations

import pytest
from commanded import commanded, kept, same
from running import RUNNABLE

#: Whole, in the short form too; of the others the beginning is looked at in `test_replay`, and all in the long form.
SHORT = ("first_touch", "four_materials", "four_materials_hurried")
KEPT = kept()
ADVICE = "if it is meant: python tests/session/commanded.py {}, and say in the commit which commands change, and why"


@pytest.mark.parametrize(
    "scene", [scene if scene in SHORT else pytest.param(scene, marks=pytest.mark.long) for scene in RUNNABLE]
)
def test_a_scene_commands_what_it_commanded(scene: str) -> None:
    same(commanded(scene), KEPT[scene], ADVICE.format(scene))


def test_every_scene_that_runs_by_itself_is_kept() -> None:
    assert set(KEPT) == {*RUNNABLE, "machine"}
