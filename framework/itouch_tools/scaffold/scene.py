"""A scene to start from, with the schema that lets editors complete it."""

from __future__ import annotations

from itouch_tools.scaffold.files import check_name, fill, write


def make_scene(name: str, schemas: dict[str, str], *, folder: str = ".") -> list[str]:
    """Write a folder NAME with NAME.xml and ``schema/`` and return the paths.

    Raises
    ------
    ItouchError
        If the name can't be one, or the folder is there already.
    """
    import os

    contents = {f"{check_name(name)}.xml": fill("scene.xml.in", {"name": name})}
    contents |= {f"schema/{file}": text for file, text in schemas.items()}
    return write(os.path.join(folder, name), contents)
