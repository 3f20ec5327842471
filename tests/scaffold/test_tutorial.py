"""The tutorial of plugins: what it lists are tested files, and what it says can be done from an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tutorial import actions, files, walk

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "tutorials" / "plugin-in-a-day.md").read_text()
COIL = ROOT / "tests" / "outside" / "itouch-voice-coil"
SLOW = (
    "pip ",
    "pytest",
    "itouch-py test-plugin",
    "itouch-py check",
    "itouch-py replay",
    "itouch-py part",
    "itouch-py inspect",
)


def content(folder: Path) -> dict[str, str]:
    found = [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {str(path.relative_to(folder)): path.read_text() for path in found if ".pytest" not in str(path)}


def test_every_listing_is_a_tested_file():
    listed = files(PAGE)
    assert len(listed) >= 7
    for path, text in listed.items():
        assert (COIL / path).read_text() == text, path


def test_steps_and_commands_are_found_on_the_page():
    kinds = [kind for kind, *_ in actions(PAGE)]
    assert kinds.count("step") == 5 and kinds.count("done") == 2
    assert kinds.count("command") >= 18


def test_scaffold_and_listings_make_the_distribution_that_is_tested(tmp_path):
    """All but the slow commands; the others are the business of the long test, and of ``.ci/kit_from_wheel.sh``."""

    def run(command: str, folder: Path) -> tuple[int, str]:
        if command == "pytest":
            return (1, "step 1") if "STEP 1:" in (folder / "itouch_my_lever" / "device.py").read_text() else (0, "")
        if command.startswith(SLOW) or "scenes/" in command and not command.startswith("rm "):
            return 0, ""
        return do(command, folder, {})

    (tmp_path / "itouch-my-lever").parent.mkdir(exist_ok=True)
    pages = PAGE.replace("$ pytest\n$ itouch-py test-plugin my-lever", "$ itouch-py test-plugin my-lever")
    cut = pages.index("```console\n$ pytest\n$ itouch-py check")
    walk(pages[:cut], tmp_path, run)
    made = content(tmp_path / "itouch-voice-coil")
    assert made == content(COIL)
    assert not any(
        "STEP" in text for path, text in content(tmp_path / "itouch-my-lever").items() if path.startswith("itouch_")
    )


def do(command: str, folder: Path, more: dict[str, str]) -> tuple[int, str]:
    paths = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, check=False,
                          env=os.environ | {"PATH": paths} | more)  # fmt: skip
    return done.returncode, done.stdout + done.stderr


@pytest.mark.long
def test_the_page_can_be_followed_to_its_last_line(tmp_path):
    sites: list[str] = []

    def run(command: str, folder: Path) -> tuple[int, str]:
        if command.startswith("pip install"):
            sites.append(str(folder / "site"))
            command = (f"{sys.executable} -m pip install -q --no-deps --no-build-isolation --no-index "
                       f"--disable-pip-version-check --target site .")  # fmt: skip
        return do(command, folder, {"PYTHONPATH": os.pathsep.join([str(folder), *sites])})

    walk(PAGE, tmp_path, run)
