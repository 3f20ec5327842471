"""The digest of a study, over the content of its file, its scene and all files that the scene names; and their copy.

Whether data are of a study is decided here, for all that add to data or read them.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable
from pathlib import Path

from itouch.scene.documents import DocumentReader, contents
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_store import Row, Store, StoreError


def digest_of(file: StudyFile, *, earlier: bool = False) -> str:
    """Return the SHA-256 of a study: its file, the scene, all files that it reads at any level, and the instructions.

    ``earlier``: as it was when the digest knew the XML alone; data that were frozen then go on.
    """
    total = hashlib.sha256(Path(file.path).read_bytes())
    found = _documents(file) if earlier else _shown(file)
    for name, data in sorted(found.items(), key=lambda one: Path(one[0])):
        total.update(b"\0" + name.encode() + b"\0" + data)
    instructions = file.instructions_path()
    if instructions is not None and not earlier:
        total.update(b"\0instructions\0" + instructions.read_bytes())
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
        store.check(seed=file.study.seed, digest=digest_of(file), earlier=digest_of(file, earlier=True))


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
    draft = target.with_suffix(".part")
    entries = {f"scene/{name.replace(':', '/')}": data for name, data in _shown(file).items()}
    entries |= {Path(file.path).name: Path(file.path).read_bytes()}
    instructions = file.instructions_path()
    if instructions is not None:
        entries |= {f"instructions/{instructions.name}": instructions.read_bytes()}
    with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(entries.items()):
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    draft.replace(target)
    return target


def _shown(file: StudyFile) -> dict[str, bytes]:
    """Return the scene, what it includes and the files that it names at any level, by the path in the scene's folder.

    What comes with the program is ``itouch:NAME``.
    """
    return contents(file.scene_path) | {name: one.data for name, one in file.files.items()}


def _documents(file: StudyFile) -> dict[str, bytes]:
    """Return the scene and what it includes by the path in the scene's folder, as the digest knew them earlier."""
    folder = Path(file.scene_path).parent.resolve()
    reader = DocumentReader([])
    found = {Path(document.shown).resolve() for document in reader.read(file.scene_path)}
    found = {path for path in found if path.is_file() and path.is_relative_to(folder)}
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}
