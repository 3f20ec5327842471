"""A modality of which the framework knows nothing: what it measures of a contact is shown everywhere as it declares it."""

from __future__ import annotations

import io
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

import itouch
from itouch.plugin import Contact, Field, Measured, Modality, discovery, schema
from itouch_tools.report.collect import collect
from itouch_tools.report.screen import Screen
from itouch_tools.report.session_page import page

SCENE = """<itouch version="1.0" xmlns:buzz="urn:itouch:plugin:buzz">
  <materials><material name="wood"><contact stiffness="1.2 N/mm" damping="2 N*s/m" static-friction="0.4"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <buzz:render probe="finger"/>
    <operator probe="finger"><motion>
      <to pos="0 0 60 mm" in="0.05 s"/><to pos="0 0 25 mm" in="0.2 s"/><to pos="0 0 60 mm" in="0.2 s"/>
    </motion></operator>
  </interaction>
</itouch>
"""


@dataclass(frozen=True)
class Params:
    """What <buzz:render .../> may hold."""

    probe: str = schema.ref("probe", doc="the probe that slides")


class Buzz(Modality):
    """Counts its contacts and makes figures of that."""

    Params = Params
    subscribes_to = frozenset({Contact.BEGIN})
    measured = (
        Measured(
            "vibration_m_s2",
            "m/s^2",
            "strongest vibration of the contact",
            digits=1,
            maximum_label="greatest vibration",
        ),
        Measured("missed_share", "1", "share of the vibration that was missed", "missed", digits=0, percent=True),
        Measured("grip", "1", "how it was held", "grip", show="page"),
        Measured("word", "1", "for programs only", show="no"),
        Measured("never", "1", "what is not known"),
    )

    def compile(self, name, params, world):
        """Return the model."""
        return SimpleNamespace(name=name, probe=params.probe)

    def fields(self, model):
        """Return the one field."""
        return (Field("count", unit="1", doc="contacts so far"),)

    def reset(self, model, state):
        """Start at none."""
        state[f"{model.name}.count"] = 0.0

    def on_contact(self, event, model, state):
        """Count."""
        state[f"{model.name}.count"] += 1.0

    def update(self, model, state, period):
        """Do nothing."""

    def measures(self, model, state, probe, object_index):
        """Return what is declared, and one figure that is not."""
        count = float(state[f"{model.name}.count"])
        return {"vibration_m_s2": 4.25 * count, "missed_share": 0.125, "grip": "<b>loose", "word": "w", "beside": 7.0}

    def contact_summary(self, model, entry):
        """Say the strongest."""
        return f"shaken by {entry['vibration_m_s2']:.1f} m/s2"

    def contact_warnings(self, model, entry):
        """Fail, as strangers may."""
        raise RuntimeError("no words")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, patch = tmp_path_factory.mktemp("measures"), pytest.MonkeyPatch()
    catalog = discovery.Catalog
    found, names, plugins = catalog.modality, catalog.modality_names, catalog.plugin_names.fget
    patch.setattr(catalog, "modality", lambda self, p, local: Buzz if p == "buzz" else found(self, p, local))
    patch.setattr(catalog, "modality_names", lambda self, p: ["render"] if p == "buzz" else names(self, p))
    patch.setattr(catalog, "plugin_names", property(lambda self: sorted([*plugins(self), "buzz"])))
    scene = folder / "scene.xml"
    scene.write_text(SCENE)
    session = itouch.build(scene)
    session.record(folder / "run.mcap")
    stream = io.StringIO()
    screen = Screen(session, stream)
    session.run()
    screen.finish(session.report())
    session.close()
    yield session.report(), stream.getvalue(), collect(str(folder / "run.mcap"))
    patch.undo()


def test_the_reports_entry_has_the_measures(made):
    (entry,) = made[0]["contacts"]
    assert (entry["vibration_m_s2"], entry["missed_share"], entry["word"], entry["beside"]) == (4.25, 0.125, "w", 7.0)
    assert entry["never"] is None


def test_the_terminals_table_has_the_measures(made):
    lines = made[1].splitlines()
    heads = next(line for line in lines if line.startswith("object")).split("  ")
    heads = [head.strip() for head in heads if head.strip()]
    assert heads == [
        "object",
        "material",
        "begin s",
        "end s",
        "vibration_m_s2",
        "never",
        "peak N",
        "gap mm",
        "missed %",
    ]
    row = next(line for line in lines if line.startswith("block")).split()
    assert row[4:6] == ["4.2", "-"] and row[-2:] == ["12", "%"]
    assert any("left block: shaken by 4.2 m/s2" in line for line in lines)


def test_words_that_fail_are_told_and_end_nothing(made):
    assert "failed in contact_warnings: " in made[1] and "no words" in made[1] and "simulated in" in made[1]


def test_the_page_has_the_measures(made):
    shown = page(made[2]).split("<h2>Contacts</h2>")[1].split("<h2>Curves</h2>")[0]
    assert "vibration_m_s2 [m/s²]" in shown and "missed [%]" in shown and ">4.2<" in shown
    assert "&lt;b&gt;loose" in shown and "<b>loose" not in shown
    assert not any(f">{head}" in shown for head in ("word<", "beside", "never"))


def test_the_summary_has_the_greatest_value_of_a_measure(made):
    assert made[2].summary["greatest vibration"] == "4.2 m/s^2"


def test_a_figure_without_a_meaning_is_refused():
    with pytest.raises(ValueError, match="'tilt'.*one sentence"):
        Measured("tilt", "rad", " ")
    with pytest.raises(ValueError, match="'everywhere'"):
        Measured("tilt", "rad", "how it is tilted", show="everywhere")


class Louder(Buzz):
    """Measures the same things, and finds more."""

    def measures(self, model, state, probe, object_index):
        """Return other numbers under the same keys, and one where the first has none."""
        return {"vibration_m_s2": 9.5, "missed_share": 0.5, "grip": None, "never": 3.0}


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    folder, patch = tmp_path_factory.mktemp("two"), pytest.MonkeyPatch()
    catalog, kinds = discovery.Catalog, {"render": Buzz, "louder": Louder}
    found, names, plugins = catalog.modality, catalog.modality_names, catalog.plugin_names.fget
    patch.setattr(catalog, "modality", lambda self, p, local: kinds[local] if p == "buzz" else found(self, p, local))
    patch.setattr(catalog, "modality_names", lambda self, p: [*kinds] if p == "buzz" else names(self, p))
    patch.setattr(catalog, "plugin_names", property(lambda self: sorted([*plugins(self), "buzz"])))
    scene = folder / "scene.xml"
    scene.write_text(
        SCENE.replace("<buzz:render", '<buzz:louder name="strong" probe="finger"/><buzz:render name="weak"')
    )
    session = itouch.build(scene)
    session.record(folder / "run.mcap")
    stream = io.StringIO()
    screen = Screen(session, stream)
    session.run()
    screen.finish(session.report())
    session.close()
    yield session.report(), stream.getvalue(), collect(str(folder / "run.mcap"))
    patch.undo()


def test_of_two_modalities_with_the_same_keys_no_figure_is_lost(two):
    (entry,) = two[0]["contacts"]
    assert (entry["vibration_m_s2"], entry["missed_share"], entry["never"]) == (9.5, 0.5, 3.0)
    assert (entry["weak:vibration_m_s2"], entry["weak:missed_share"]) == (4.25, 0.125)
    assert (entry["grip"], entry["word"], entry["beside"]) == ("<b>loose", "w", 7.0)  # of these there is one each
    assert "weak:grip" not in entry and "strong:never" not in entry


def test_of_two_modalities_each_is_shown_and_speaks_of_its_own(two):
    assert "left block: shaken by 9.5 m/s2; shaken by 4.2 m/s2" in two[1]
    heads = next(line for line in two[1].splitlines() if line.startswith("object"))
    assert "vibration_m_s2" in heads and "weak vibration_m_s2" in heads and "weak missed %" in heads
    shown = page(two[2]).split("<h2>Contacts</h2>")[1].split("<h2>Curves</h2>")[0]
    assert "weak vibration_m_s2 [m/s²]" in shown and "weak grip" not in shown
    summary = two[2].summary
    assert (summary["greatest vibration"], summary["weak greatest vibration"]) == ("9.5 m/s^2", "4.2 m/s^2")
