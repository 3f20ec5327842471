"""The outside voice coil: its own tests, and a session that is recorded, replayed, saved and restored with it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import xmlschema
from lxml import etree
from third_party_plugins import pip_install

COIL = Path(__file__).parents[1] / "outside" / "itouch-voice-coil"
SCENE = COIL / "scenes" / "voice-coil.xml"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the distribution into a folder."""
    source, folder = tmp_path_factory.mktemp("source") / "coil", tmp_path_factory.mktemp("site")
    shutil.copytree(COIL, source)
    return pip_install(folder, source)


def run(site: Path, folder: Path, *words: str) -> str:
    done = subprocess.run([sys.executable, "-m", *words], cwd=folder, capture_output=True, text=True, check=False,
                          env=os.environ | {"PYTHONPATH": str(site)})  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    return done.stdout


@pytest.mark.long  # as are the next: CI walks through the tutorial with the built wheel
def test_its_own_tests_pass(site, tmp_path):
    shutil.copytree(COIL / "tests", tmp_path / "tests")
    shutil.copytree(COIL / "scenes", tmp_path / "scenes")
    (tmp_path / "itouch_voice_coil").mkdir()  # where the steps are looked for
    said = run(
        site, tmp_path, "pytest", "-q", "-p", "no:cacheprovider", "-p", "itouch.testing.plugin", "--rootdir", "."
    )
    assert " failed" not in said.splitlines()[-1]
    assert "errors-come-through" in said and "TestVoiceCoilRender" in said


@pytest.mark.long
def test_it_is_recorded_and_replayed_without_a_difference(site, tmp_path):
    run(site, tmp_path, "itouch_tools.cli", str(SCENE), "--headless", "--record", "slide.mcap")
    assert "0 mismatches" in run(site, tmp_path, "itouch_tools.cli", "replay", "slide.mcap")


def test_it_is_restored_to_the_same_bytes(site, tmp_path):
    run(site, tmp_path, "itouch_tools.cli", str(SCENE), "--headless", "--save", "straight.itouch")
    run(site, tmp_path, "itouch_tools.cli", str(SCENE), "--headless", "--for", "1.7s", "--save", "part.itouch")
    run(site, tmp_path, "itouch_tools.cli", "part.itouch", "--headless", "--save", "whole.itouch")
    states = [zipfile.ZipFile(tmp_path / name).read("state.npy") for name in ("straight.itouch", "whole.itouch")]
    assert states[0] == states[1]


def test_its_schema_is_written_with_the_others(site, tmp_path):
    run(site, tmp_path, "itouch_tools.cli", "schema", "schema")
    text = "".join(path.read_text() for path in (tmp_path / "schema").glob("*.xsd"))
    assert "urn:itouch:plugin:voice-coil" in text and "distance from ridge to ridge" in text
    main = str(tmp_path / "schema" / "itouch.xsd")
    scene = etree.parse(str(SCENE))
    etree.XMLSchema(etree.parse(main)).assertValid(scene)
    validator = xmlschema.XMLSchema10(main)
    validator.validate(scene)
    for right, wrong in ((' height="60 um"', ' hight="60 um"'), (' coil="coil"', "")):
        assert not validator.is_valid(etree.fromstring(SCENE.read_text().replace(right, wrong, 1).encode()))
