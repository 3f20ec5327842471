"""The digest of a study, over the content of its file, its scene and all files that the scene names; and their copy.

Whether data are of a study is decided here, for all that add to data or read them.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable
from pathlib import Path

from itouch.plugin.discovery import Catalog
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.store import Row, Store, StoreError


def digest_of(file: StudyFile) -> str:
    """Return the SHA-256 of a study: its file, and the scene of each condition with all files that it reads."""
    total = hashlib.sha256(Path(file.path).read_bytes())
    folder = Path(file.scene_path).parent
    for path in sorted(_documents(file)):
        total.update(b"\0" + str(path.relative_to(folder.resolve())).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def check_task(file: StudyFile, rows: Iterable[Row]) -> None:
    """Check that the rows answer the study's task: answers to another one are not in its words.

    Raises
    ------
    StoreError
        If they don't.
    """
    for row in rows:
        if row.task != file.study.task.kind:
            raise StoreError(
                f"the trials are of another study: {row.participant} was asked '{row.task}', and the task of "
                f"'{file.name}' is '{file.study.task.kind}'; take the study as it was (frozen/ has it), or another "
                f"folder"
            )


def check_same_study(file: StudyFile, store: Store) -> None:
    """Check that the data are of this study, by the rule of `study run`, and that no trial would be left out.

    Raises
    ------
    StoreError
        If they are of another one.
    """
    rows = store.rows()
    check_task(file, rows)
    levels = {factor.name: factor.names for factor in file.study.factors}
    known = {*levels, *(one.name for one in file.study.staircases)}
    for row in rows:
        for shown in (row.condition, *row.shown):
            for name, level in shown.items():
                if name not in known or level not in levels.get(name, (level,)):
                    raise StoreError(
                        f"the trials are of another study: {row.participant} was shown {name}={level}, which "
                        f"'{file.name}' does not have; take the study as it was (frozen/ has it)"
                    )
    if store.frozen() is not None:  # data that were put together otherwise have no digest to compare with
        store.check(seed=file.study.seed, digest=digest_of(file))


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
