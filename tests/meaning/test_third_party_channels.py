"""A device of which the framework knows nothing: its pressure and its level are shown everywhere as it declares them."""

from __future__ import annotations

import csv
import gzip
import json
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest

import itouch
from itouch.plugin import Channel, Device, Field, Role, Twin, discovery
from itouch.recording import read
from itouch.world import undeclared
from itouch_tools.export.bids import export_bids
from itouch_tools.export.tables import export_csv, export_parquet
from itouch_tools.report.collect import collect
from itouch_tools.report.session_page import page
from itouch_tools.viewer import overlay
from itouch_tools.viewer.signals import charts

PRESSURE, LEVEL = "pressure in the bladder under the fingertip", "pressure that the valve has let in so far"
SCENE = """<itouch version="1.0">
  <devices><device name="cuff" plugin="bladder"/></devices>
  <record to="run.mcap"><channels of="cuff.*"/></record>
</itouch>
"""


@dataclass(frozen=True, slots=True)
class BladderParams:
    """Nothing to choose."""


class BladderTwin(Twin):
    """A bladder that fills."""

    def fields(self):
        """Return how much was let in."""
        return (Field("let_in", unit="Pa", doc=LEVEL), Field("flow", unit="m^3/s", doc="air that flows in"))

    def step(self, state, command, touch, period):
        """Fill."""
        state["let_in"] += 1000.0 * period
        state["flow"] = 2e-6

    def read(self, state, reading):
        """Tell the pressure."""
        reading["squeeze"] = 101325.0 + state["let_in"]
        return True


class Bladder(Device):
    """A bladder."""

    Params, Twin = BladderParams, BladderTwin
    reads = (Channel("squeeze", 1, "Pa", (0.0,), (3e5,), role=Role.PRESSURE, doc=PRESSURE),)

    def open(self):
        """Open."""

    def close(self):
        """Close."""

    def read(self, reading):
        """Read."""
        return False


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, patch = tmp_path_factory.mktemp("stranger"), pytest.MonkeyPatch()
    found = discovery.Catalog.device
    patch.setattr(discovery.Catalog, "device", lambda self, name: Bladder if name == "bladder" else found(self, name))
    scene = folder / "scene.xml"
    scene.write_text(SCENE)
    session = itouch.build(scene)
    session.record(folder / "run.mcap")
    session.run(0.2)
    session.close()
    yield session, read(str(folder / "run.mcap")), folder
    patch.undo()


def test_the_recording_has_units_and_meanings_as_declared(made):
    _, recording, _ = made
    assert recording.units["cuff.squeeze"] == recording.units["cuff.twin.let_in"] == "Pa"
    assert recording.units["cuff.twin.flow"] == "m^3/s"
    assert recording.meanings["cuff.squeeze"] == PRESSURE and recording.meanings["cuff.twin.let_in"] == LEVEL


def test_csv_tables_have_units_and_meanings_as_declared(made):
    _, recording, folder = made
    export_csv(recording, str(folder / "tables"))
    heads = [file.read_text().splitlines()[0].split(",") for file in (folder / "tables").glob("*cuff*.csv")]
    assert any("squeeze [Pa]" in head for head in heads) and any("twin.flow [m^3/s]" in head for head in heads)
    rows = {row["column"]: row for row in csv.DictReader((folder / "tables" / "columns.csv").read_text().splitlines())}
    assert rows["cuff.squeeze"] == {"column": "cuff.squeeze", "unit": "Pa", "meaning": PRESSURE}


def test_parquet_has_units_and_meanings_as_declared(made):
    parquet = pytest.importorskip("pyarrow.parquet")
    _, recording, folder = made
    export_parquet(recording, str(folder / "all.parquet"))
    schema = parquet.read_schema(folder / "all.parquet")
    assert schema.field("cuff.squeeze").metadata == {b"unit": b"Pa"}
    assert json.loads(schema.metadata[b"meanings"])["cuff.squeeze"] == PRESSURE


def test_bids_sidecars_have_units_and_meanings_as_declared(made):
    _, recording, folder = made
    export_bids(recording, str(folder / "bids"), task="fill")
    sidecars = [json.loads(file.read_text()) for file in (folder / "bids").rglob("*physio.json")]
    said = {name: sidecar[name] for sidecar in sidecars for name in sidecar["Columns"] if name in sidecar}
    assert said["squeeze"] == {"Units": "Pa", "Description": PRESSURE}
    assert said["twin.let_in"] == {"Units": "Pa", "Description": LEVEL}
    columns = {}
    for sidecar in (folder / "bids").rglob("*physio.json"):
        text = gzip.decompress(sidecar.with_suffix("").with_suffix(".tsv.gz").read_bytes()).decode()
        values = zip(*(line.split("\t") for line in text.splitlines()), strict=True)
        columns |= dict(zip(json.loads(sidecar.read_text())["Columns"], values, strict=True))
    let_in = [float(value) for value in columns["twin.let_in"]]
    assert let_in == pytest.approx([tick + 1.0 for tick in range(200)])  # 1 kPa/s, after each tick
    told = [float(value) for value in columns["squeeze"]]
    assert told == pytest.approx([101325.0 + tick for tick in range(200)], abs=1e-3)  # read before the tick's step


def test_the_window_plots_and_explains_the_channels(made):
    session, _, _ = made
    shown = {(chart.title, chart.unit): [signal.doc for signal in chart.signals] for chart in charts(session.model)}
    assert shown[("pressure", "Pa")] == [PRESSURE, LEVEL]
    assert shown[("m^3/s", "m^3/s")] == ["air that flows in"]
    corner = [line for line, _ in overlay.properties(session.model, session.state, "cuff").lines]
    assert any("Pa" in line and PRESSURE in line for line in corner)


def test_the_page_plots_and_explains_the_channels(made):
    _, _, folder = made
    findings = collect(str(folder / "run.mcap"))
    assert findings.curves is not None
    assert {(chart.title, chart.unit) for chart in findings.curves.charts} == {("pressure", "Pa"), ("m^3/s", "m^3/s")}
    assert f">{PRESSURE}</td>" in page(findings) and f">{LEVEL}</td>" in page(findings)


def test_inspect_explains_the_channels(made, capsys):
    from itouch_tools.cli.inspect import scene_facts

    _, _, folder = made
    told = {channel["channel"]: channel for channel in scene_facts(str(folder / "scene.xml"))["channels"]}
    assert told["cuff.squeeze"]["unit"] == "Pa" and told["cuff.squeeze"]["meaning"] == PRESSURE


def test_every_channel_of_the_example_is_declared(made):
    assert undeclared(made[0].model) == ()


def test_the_reference_page_is_made_of_what_is_declared():
    sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
    import channels

    rows = {"cuff": {"squeeze": channels.Row("1", "number", "Pa", PRESSURE)}}
    assert f"| `squeeze` | 1 | Pa | {PRESSURE} |" in "\n".join(channels._lines(rows, {"cuff": "the cuff"}))


def test_what_an_older_plugin_leaves_unsaid_is_told_and_runs():
    class Old(Bladder):
        reads = (Channel("squeeze", 1, "Pa"), Channel("share", 1, ""))
        blocking = False

    assert any("'squeeze'" in sentence and "doc=" in sentence for sentence in Old.declaration_problems)
    assert any("'share'" in sentence and 'unit="1"' in sentence for sentence in Old.declaration_problems)
    assert any("timing = Timing(blocking=...)" in sentence for sentence in Old.deprecations)


def test_a_temperature_of_which_nobody_says_what_it_is_is_refused():
    with pytest.raises(ValueError, match="SKIN_CONTACT_TEMPERATURE"):

        class Unsaid(Bladder):
            reads = (Channel("warmth", 1, "K", doc="how warm it is"),)


def test_run_warns_of_what_is_unsaid(made, monkeypatch):
    from itouch_tools.cli import deprecations

    monkeypatch.setattr("itouch.world.undeclared", lambda model: ("device plugin 'x': reading 'y' has no unit",))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        deprecations.warn(made[0].model)
    assert [str(one.message) for one in told] == ["device plugin 'x': reading 'y' has no unit"]
    assert told[0].category is DeprecationWarning
