"""The numbers of fields are those of the published definitions, which any viewer has: a wrong one is silently nothing."""

from __future__ import annotations

import pytest

from itouch.recording.wellknown import MESSAGES

#: Fields by number, from the definitions of Foxglove's schemas (foxglove.SceneUpdate, foxglove.FrameTransforms; MIT).
PUBLISHED = {
    "Vector3": "x y z",
    "Point3": "x y z",
    "Quaternion": "x y z w",
    "Color": "r g b a",
    "Pose": "position orientation",
    "KeyValuePair": "key value",
    "ArrowPrimitive": "pose shaft_length shaft_diameter head_length head_diameter color",
    "CubePrimitive": "pose size color",
    "SpherePrimitive": "pose size color",
    "CylinderPrimitive": "pose size bottom_scale top_scale color",
    "TriangleListPrimitive": "pose points color colors indices",
    "TextPrimitive": "pose billboard font_size scale_invariant color text",
    "SceneEntity": (
        "timestamp frame_id id lifetime frame_locked metadata arrows cubes spheres cylinders lines triangles texts models"
    ),
    "SceneEntityDeletion": "timestamp type id",
    "SceneUpdate": "deletions entities",
    "FrameTransform": "timestamp parent_frame_id child_frame_id translation rotation",
    "FrameTransforms": "transforms",
}


@pytest.mark.parametrize("message", sorted(PUBLISHED))
def test_fields_have_their_published_numbers(message: str) -> None:
    published = {name: number for number, name in enumerate(PUBLISHED[message].split(), 1)}
    ours = {name: number for name, number, _ in MESSAGES[message]}
    assert ours.items() <= published.items()
    assert published.keys() - ours.keys() <= {"lines", "models"}, "which nothing here draws"


def test_each_message_is_held_against_its_definition() -> None:
    assert set(PUBLISHED) == set(MESSAGES)
