"""A scene to start from, with the schema for completion in editors."""

from __future__ import annotations

from itouch_tools.scaffold.files import check_name, fill, write


def make_scene(name: str, schemas: dict[str, str], *, folder: str = ".") -> list[str]:
    """Write a folder NAME with NAME.xml and ``schema/`` and return the paths.

    Raises
    ------
    ItouchError
        If the name is not valid, or the folder exists already.
    """
    import os

    contents = {f"{check_name(name)}.xml": fill("scene.xml.in", {"name": name})}
    contents |= {f"schema/{file}": text for file, text in schemas.items()}
    return write(os.path.join(folder, name), contents)
