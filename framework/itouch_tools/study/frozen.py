"""The digest of a study, over the content of its file, its scene and all files that the scene names; and their copy."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

from itouch.plugin.discovery import Catalog
from itouch_tools.study.reading import StudyFile


def digest_of(file: StudyFile) -> str:
    """Return the SHA-256 of a study: its file, and the scene of each condition with all files that it reads."""
    total = hashlib.sha256(Path(file.path).read_bytes())
    folder = Path(file.scene_path).parent
    for path in sorted(_documents(file)):
        total.update(b"\0" + str(path.relative_to(folder.resolve())).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def keep_copy(file: StudyFile, folder: Path, digest: str) -> Path:
    """Keep a copy of study, scene and the files that they name, in ``frozen/DIGEST.zip`` of a study's folder.

    Raises
    ------
    OSError
        If the copy can't be written.
    """
    target = folder / "frozen" / f"{digest[:12]}.zip"
    if target.exists():
        return target
    target.parent.mkdir(exist_ok=True)
    root, draft = Path(file.scene_path).parent.resolve(), target.with_suffix(".part")
    entries = {f"scene/{path.relative_to(root)}": path for path in _documents(file)}
    entries |= {Path(file.path).name: Path(file.path)}
    with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in sorted(entries.items()):
            archive.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)
    draft.replace(target)
    return target


def _documents(file: StudyFile) -> set[Path]:
    """Return the paths of the scene, of what it includes, and of the files that it names."""
    from itouch.scene.documents import DocumentReader

    folder = Path(file.scene_path).parent.resolve()
    reader = DocumentReader([])
    found = {(Path(document.shown)).resolve() for document in reader.read(file.scene_path)}
    conditions = file.conditions() if file.study.factors else [{}]
    catalog = Catalog()
    for condition in conditions[:1] if len(conditions) > 50 else conditions:
        scene, _ = file.scene(condition, catalog)
        found |= {folder / name for name in scene.files or ()}
    return {path for path in found if path.is_file() and path.is_relative_to(folder)}
