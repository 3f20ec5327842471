"""Filling templates and writing them, never over existing files: a scene, or a study with its scene."""

from __future__ import annotations

import os
import re
from importlib.resources import files
from string import Template

from itouch.schema import ItouchError

_LONGEST = 40
_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


def check_name(name: str) -> str:
    """Return the name if it is valid for a plugin, a scene or a study.

    Raises
    ------
    ItouchError
        If it is not.
    """
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        raise ItouchError(
            f"'{name}' can't be the name: it needs small letters and digits, a letter first, with single dashes "
            f"between them, and at most {_LONGEST} characters, such as force-lever"
        )
    return name


def fill(template: str, words: dict[str, str]) -> str:
    """Return the text of a template with its words filled in."""
    text = files("itouch_tools.scaffold").joinpath("templates", template).read_text("utf-8")
    return Template(text).substitute(words)


def write(folder: str, contents: dict[str, str]) -> list[str]:
    """Write files into a new folder and return their paths.

    Raises
    ------
    ItouchError
        If the folder exists already, or can't be written.
    """
    if os.path.exists(folder):
        raise ItouchError(f"'{folder}' is there already; nothing was written")
    written = []
    try:
        for name, text in contents.items():
            path = os.path.join(folder, name)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w", encoding="utf-8") as stream:
                stream.write(text)
            written.append(path)
    except OSError as error:
        raise ItouchError(f"cannot write to '{folder}': {error.strerror or error}") from error
    return written


def make_scene(name: str, schemas: dict[str, str], *, folder: str = ".") -> list[str]:
    """Write a folder NAME with NAME.xml and ``schema/`` and return the paths.

    Raises
    ------
    ItouchError
        If the name is not valid, or the folder exists already.
    """
    contents = {f"{check_name(name)}.xml": fill("scene.xml.in", {"name": name})}
    contents |= {f"schema/{file}": text for file, text in schemas.items()}
    return write(os.path.join(folder, name), contents)


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
