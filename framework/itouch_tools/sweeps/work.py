"""What all runs of a sweep have in common, by content: scene, files, functions, plugins, what is collected."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from itouch.plugin.discovery import PROGRAM, Catalog
from itouch.scene.documents import contents
from itouch.schema import ItouchError
from itouch.world import Model
from itouch_tools.sweeps.functions import in_file
from itouch_tools.sweeps.provenance import files_of, identity
from itouch_tools.sweeps.sweep_elements import FromCall
from itouch_tools.sweeps.sweepfile import SweepFile

#: Most bytes that travel with a task.
MOST_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class Work:
    """Everything that a worker needs besides the runs themselves.

    Attributes
    ----------
    scene
        Name of the scene among ``files``.
    files
        Content of the scene, its includes and the files that they name, by path in the scene's folder; an include that
        comes with the program is ``itouch:NAME``, does not travel, and must be the same on every worker.
    functions
        Content of the files with functions, by path in the sweep's folder.
    plugins
        The files of each plugin that is not part of the program, by distribution, with ``entry_points.txt`` and
        ``METADATA``.
    collect, rule
        Elements of the sweep, as plain data.
    identity
        Versions of what must compute, see ``itouch_tools.sweeps.provenance``; made from ``packages``.
    digest
        Digest of all of this.
    """

    scene: str
    files: Mapping[str, bytes]
    functions: Mapping[str, bytes]
    plugins: Mapping[str, Mapping[str, bytes]]
    packages: Mapping[str, tuple[str, ...]]
    collect: tuple[Mapping[str, Any], ...]
    rule: Mapping[str, Any]
    identity: Mapping[str, str]
    digest: str = field(default="")

    def dumps(self) -> str:
        """Return the work as JSON."""
        plain = asdict(self)
        for name in ("files", "functions"):
            plain[name] = {key: base64.b85encode(data).decode() for key, data in plain[name].items()}
        plain["plugins"] = {
            one: {key: base64.b85encode(data).decode() for key, data in inner.items()}
            for one, inner in plain["plugins"].items()
        }
        return json.dumps(plain, indent=1)

    @classmethod
    def loads(cls, text: str) -> Work:
        """Read what ``dumps`` wrote.

        Raises
        ------
        ValueError, KeyError, TypeError
            If the text is something else.
        """
        plain = json.loads(text)
        for name in ("files", "functions"):
            plain[name] = {key: base64.b85decode(data) for key, data in plain[name].items()}
        plain["plugins"] = {
            one: {key: base64.b85decode(data) for key, data in inner.items()} for one, inner in plain["plugins"].items()
        }
        plain["packages"] = {key: tuple(names) for key, names in plain["packages"].items()}
        plain["collect"] = tuple(plain["collect"])
        return cls(**plain)

    def parts(self) -> dict[str, str]:
        """Return the digest or version of each part, by a name that says in a message what differs."""
        found = {f"the file '{name}'": data for name, data in self.files.items()}
        found |= {f"the file '{name}'": data for name, data in self.functions.items()}
        told = {name: hashlib.sha256(data).hexdigest() for name, data in found.items()}
        told["what is collected"] = hashlib.sha256(json.dumps(self.collect).encode()).hexdigest()
        told["when a run ends"] = hashlib.sha256(json.dumps(_deciding(self.rule)).encode()).hexdigest()
        return told | dict(self.identity)


def _deciding(rule: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in rule.items() if name != "patience"}


def work_of(file: SweepFile, catalog: Catalog) -> Work:
    """Return what the runs of a sweep have in common.

    Raises
    ------
    ItouchError
        If it is too large to travel with a task.
    """
    folder = Path(os.path.dirname(file.scene_path) or ".").resolve()
    model = _first_model(file, catalog)
    files = contents(file.scene_path)
    files |= {one.file: one.data for one in model.files}
    files |= {name: (folder / name).read_bytes() for name in _named(file, folder) if name not in files}
    functions = {}
    for each in file.sweep.collect.results:
        if isinstance(each, FromCall) and (home := in_file(each.function)):
            functions[home] = (Path(file.path).parent / home).read_bytes()
    packages = _packages(file, model, catalog)
    plugins = {name: _shipped(name, packages[name]) for name in packages if name != PROGRAM}
    collect = tuple({"kind": type(each).__name__, **asdict(each)} for each in file.sweep.collect.results)
    work = Work(
        Path(file.scene_path).name, files, functions, plugins, packages, collect, asdict(file.sweep.run),
        identity(packages),
    )  # fmt: skip
    size = sum(map(len, files.values())) + sum(len(d) for one in plugins.values() for d in one.values())
    if size > MOST_BYTES:
        raise ItouchError(f"scene, files and plugins take {size >> 20} MiB; at most {MOST_BYTES >> 20} MiB travel")
    return _with_digest(work)


def _with_digest(work: Work) -> Work:
    from dataclasses import replace

    told = json.dumps([work.scene, sorted(work.parts().items())])
    return replace(work, digest=hashlib.sha256(told.encode()).hexdigest())


def _first_model(file: SweepFile, catalog: Catalog) -> Model:
    from itouch.session.building import choose_twins

    scene, _ = file.scene(file.plan().run(0).sets, catalog)
    return Model.of(choose_twins(scene, "all"), catalog)


def _named(file: SweepFile, folder: Path) -> Iterator[str]:
    """Yield the files that levels name, such as the meshes or motions of a list."""
    for axis in file.plan().axes:
        for level in axis.levels:
            for _, text in level.sets:
                path = (folder / text).resolve()
                if "." in text and path.is_relative_to(folder) and path.is_file():
                    yield path.relative_to(folder).as_posix()


def _packages(file: SweepFile, model: Model, catalog: Catalog) -> dict[str, tuple[str, ...]]:
    """Return the top-level packages by distribution: of program, plugins in the scene, monitors and functions."""
    from importlib import metadata

    from itouch.session.manifest import plugin_versions

    found: dict[str, set[str]] = {PROGRAM: {"itouch", "itouch_tools"}}
    for plugin in plugin_versions(model, catalog):
        for offered in catalog.offered(plugin):
            found.setdefault(offered.distribution, set()).add(offered.entry.module.partition(".")[0])
    for monitor in catalog.offered_monitors():
        found.setdefault(monitor.distribution, set()).add(monitor.entry.module.partition(".")[0])
    owners = metadata.packages_distributions()
    for each in file.sweep.collect.results:
        if isinstance(each, FromCall) and not in_file(each.function):
            package = each.function.partition(":")[0].partition(".")[0]
            for owner in owners.get(package, [])[:1]:
                found.setdefault(PROGRAM if package.startswith("itouch") and owner == PROGRAM else owner, set()).add(
                    package
                )
    return {name: tuple(sorted(_with_parts(packages))) for name, packages in found.items()}


def _with_parts(packages: set[str]) -> set[str]:
    """Return packages together with the further ones that they name in ``PACKAGES``."""
    import sys

    return packages.union(*(getattr(sys.modules.get(package), "PACKAGES", ()) for package in packages))


def _shipped(distribution: str, packages: tuple[str, ...]) -> dict[str, bytes]:
    """Return the files of a plugin, so that a worker that lacks the plugin can use it."""
    from importlib import metadata

    found = {name: path.read_bytes() for package in packages for name, path in files_of(package)}
    known = metadata.distribution(distribution)
    info = f"{distribution.replace('-', '_')}-{known.version}.dist-info"
    for name in ("METADATA", "entry_points.txt"):
        text = known.read_text(name)
        if text is not None:
            found[f"{info}/{name}"] = text.encode()
    return found
