"""The schema for editors: every shipped scene is valid by an independent validator, and mistakes are not."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree
from shipped import SCENE_FILES, SCENES

from itouch.plugin.discovery import Catalog
from itouch.schema.fields import specs
from itouch_tools.authoring.xsd import schemas
from itouch_tools.cli import main

SHIPPED = SCENE_FILES


@pytest.fixture(scope="module")
def validator(tmp_path_factory) -> etree.XMLSchema:
    folder = tmp_path_factory.mktemp("xsd")
    assert main(["schema", str(folder)]) == 0
    return etree.XMLSchema(etree.parse(str(folder / "itouch.xsd")))


@pytest.mark.parametrize("scene", SHIPPED, ids=[str(s.relative_to(SCENES)) for s in SHIPPED])
def test_every_shipped_scene_is_valid(scene: Path, validator):
    validator.assertValid(etree.parse(str(scene)))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("<box name=", "<bocks name="),
        (' material="wood"', ' materiel="wood"'),
        ('servo="1 kHz"', 'servo="fast"'),
        ("contact-resistance=", "contact-resistence="),
        ("<thermal:heat ", "<thermal:head "),
    ],
)
def test_mistakes_are_seen_while_typing(right, wrong, validator):
    text = (SCENES / "four_materials.xml").read_text()
    assert right in text
    assert not validator.validate(etree.fromstring(text.replace(right, wrong, 1).encode()))


def test_every_attribute_has_a_text_with_its_unit_and_default():
    found = schemas(Catalog())
    assert {"itouch.xsd", "thermal.xsd", "xyz-table.xsd", "usb-arm.xsd"} <= found.keys()
    for text in found.values():
        tree = etree.fromstring(text.encode())
        space = {"xs": "http://www.w3.org/2001/XMLSchema"}
        for attribute in tree.iterfind(".//xs:attribute", space):
            if attribute.get("name") == "version":
                continue
            assert attribute.findtext(".//xs:documentation", namespaces=space)
    assert "stiffness of the virtual coupling" in found["itouch.xsd"]
    cls = Catalog().device("thermal")
    assert cls is not None
    for name in specs(cls.Params):
        spec = specs(cls.Params)[name]
        if spec.kind not in ("child", "children", "plugin"):
            assert f'name="{name.rstrip("_").replace("_", "-")}"' in found["thermal.xsd"]
