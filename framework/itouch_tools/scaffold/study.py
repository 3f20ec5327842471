"""A study to start from, with its scene and what the participant reads."""

from __future__ import annotations

import os

from itouch_tools.scaffold.files import check_name, fill, write


def make_study(name: str, *, folder: str = ".") -> list[str]:
    """Write a folder NAME with NAME.xml, scene.xml and instructions.md, and return the paths.

    Raises
    ------
    ItouchError
        If the name is not valid, or the folder exists already.
    """
    words = {"name": check_name(name)}
    contents = {
        f"{name}.xml": fill("study.xml.in", words), "scene.xml": fill("study_scene.xml.in", words),
        "instructions.md": fill("instructions.md.in", words),
    }  # fmt: skip
    return write(os.path.join(folder, name), contents)
