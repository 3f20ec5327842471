"""What editors get: two validators that know nothing of each other agree with the loader, on good scenes and on bad ones."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import xmlschema
from lxml import etree
from shipped import SCENE_FILES, SCENES

from itouch_tools.cli import main
from itouch_tools.scaffold.files import fill

ROOT = Path(__file__).parents[2]
SHIPPED = SCENE_FILES
DOCS = [page for page in sorted((ROOT / "docs").rglob("*.md")) if page.stem != "errors"] + [ROOT / "README.md"]
#: Whole scenes on the pages of the docs; what a plugin of the tutorial brings is validated with that plugin.
EXAMPLES = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in DOCS
    for number, block in enumerate(re.findall(r"```xml\n((?:<\?xml[^>]*>\s*|<!--.*?-->\s*)*<itouch\b.*?</itouch>)", page.read_text(), re.S))
    if "urn:itouch:plugin:voice-coil" not in block
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("xsd")
    assert main(["schema", str(home)]) == 0
    return home


@pytest.fixture(scope="module")
def first(folder: Path) -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(str(folder / "itouch.xsd")))


@pytest.fixture(scope="module")
def second(folder: Path) -> xmlschema.XMLSchema10:
    return xmlschema.XMLSchema10(str(folder / "itouch.xsd"))


@pytest.mark.parametrize("scene", SHIPPED, ids=[str(s.relative_to(SCENES)) for s in SHIPPED])
def test_shipped_scenes_are_valid_by_a_second_validator(scene, second):
    second.validate(str(scene))


@pytest.mark.parametrize("text", EXAMPLES)
def test_examples_of_the_docs_are_valid_by_both(text, first, second):
    first.assertValid(etree.fromstring(text.encode()))
    second.validate(etree.fromstring(text.encode()))


def test_there_are_examples():
    assert len(EXAMPLES) >= 1


def test_the_scene_to_start_from_is_valid_by_both(first, second):
    text = fill("scene.xml.in", {"name": "blocks"}).encode()
    first.assertValid(etree.fromstring(text))
    second.validate(etree.fromstring(text))


WRONG = {
    "unknown attribute": (' material="wood"', ' material="wood" colour="red"'),
    "misspelt attribute": (' material="wood"', ' materiel="wood"'),
    "missing attribute": ("<safety force", '<fault kind="freeze" at="1 s"/><safety force'),
    "missing attribute of a plugin": ('<thermal:heat probe="finger"', "<thermal:heat"),
    "word that is none of the choices": ('controller="model"', 'controller="modell"'),
    "no yes or no": (
        "<world ",
        '<devices><device name="x" plugin="usb-arm" optional="maybe"/></devices><world ',
    ),
    "unknown element": ("<box name=", "<bocks name="),
    "unknown element of a plugin": ("<thermal:heat ", "<thermal:head "),
    "unknown namespace": ("urn:itouch:plugin:thermal", "urn:itouch:plugin:thermic"),
    "word in place of a number": (' radius="8 mm"', ' radius="big"'),
    "no name": ('<probe name="finger"', "<probe"),
}


@pytest.mark.parametrize("right", WRONG, ids=list(WRONG))
def test_mistakes_are_seen_by_both(right, first, second):
    text = (SCENES / "four_materials.xml").read_text()
    before, after = WRONG[right]
    if before not in text:
        text = (SCENES / "thermal_display.xml").read_text()
    assert before in text
    tree = etree.fromstring(text.replace(before, after, 1).encode())
    assert not first.validate(tree)
    assert not second.is_valid(tree)


def test_hovering_shows_unit_range_and_default(folder):
    text = (folder / "thermal.xsd").read_text() + (folder / "itouch.xsd").read_text()
    assert "radius of the fingertip" in text
    radius = re.search(r'name="radius".*?</xs:attribute>', (folder / "itouch.xsd").read_text(), re.S)
    assert radius is not None and "m" in radius[0]
    probe = re.search(r"radius of the fingertip[^<]*", text)
    assert probe is not None and "0.008" in probe[0] and "0.1" in probe[0], probe


def test_a_new_scene_names_its_schema_for_the_editor(tmp_path, second):
    assert main(["new-scene", "blocks", "--folder", str(tmp_path)]) == 0
    text = (tmp_path / "blocks" / "blocks.xml").read_text()
    assert '<?xml-model href="schema/itouch.xsd"' in text.splitlines()[1]
    own = xmlschema.XMLSchema10(str(tmp_path / "blocks" / "schema" / "itouch.xsd"))
    own.validate(str(tmp_path / "blocks" / "blocks.xml"))
