"""``itouch-py demo``: the scenes that come with the program, from anywhere: run one, or write all into a folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from itouch.scene import bundled_scenes
from itouch.schema import ItouchError
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_folder


def scenes_folder() -> Path:
    """Return the folder of the shipped scenes, in a wheel or in a checkout.

    Raises
    ------
    ItouchError
        If they are missing.
    """
    folder = bundled_scenes.folder()
    if folder is not None:
        return folder
    raise ItouchError("the shipped scenes are missing from this installation; install itouch-py again")


def main(argv: Sequence[str]) -> int:
    """Run a scene that comes with the program (default: the four materials), or write all of them into a folder."""
    parser = Parser(
        prog="itouch-py demo",
        description=main.__doc__,
        allow_abbrev=False,
        epilog="Other options are those of `itouch-py run`.",
    )
    parser.add_argument("name", nargs="?", default="four_materials", metavar="NAME", help="such as first_touch, mesh")
    parser.add_argument(
        "-o",
        "--scenes",
        type=output_folder,
        metavar="FOLDER",
        help="write the scenes into a folder that is not there yet",
    )
    named = bool(argv) and not argv[0].startswith("-")
    options, rest = parser.parse_known_args(argv if named else ["four_materials", *argv])
    if options.scenes and (named or rest):
        parser.error(f"--scenes writes all scenes and runs none: omit '{' '.join([*argv[:named], *rest])}'")
    if options.scenes:
        return _write(Path(options.scenes))
    from itouch_tools.cli.run import main as run

    return run([str(_scene(options.name)), *rest])


def _scene(name: str) -> Path:
    from itouch.schema.diagnostics import did_you_mean

    path = scenes_folder() / f"{name.removesuffix('.xml')}.xml"
    if not path.is_file():
        known = [found.stem for found in scenes_folder().glob("*.xml")]
        raise ItouchError(f"there is no shipped scene '{name}'\n  = help: {did_you_mean(name, known, 'scenes are')}")
    return path


def _write(folder: Path) -> int:
    """Copy the shipped scenes."""
    try:
        shutil.copytree(scenes_folder(), folder, ignore=shutil.ignore_patterns("__pycache__"))
    except FileExistsError:
        raise ItouchError(f"'{folder}' is there already; name a folder that is not") from None
    except OSError as error:
        raise ItouchError(f"cannot write '{folder}': {error.strerror or error}") from error
    print(f"wrote {len(list(folder.rglob('*.xml')))} scenes and rigs into {folder}; for example")
    print(f"  itouch-py {folder / 'first_touch.xml'}")
    return 0
