"""What every command says and writes is the same under other names of channels and fields, but for those names."""

from __future__ import annotations

import gzip
import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from renamed import OURS, scene

from itouch.plugin.discovery import Catalog
from itouch.recording import read
from itouch.session import load_scene
from itouch.world import compile_scene
from itouch_evidence.renamed import Renaming, renamed_device, renamed_modality
from itouch_tools.cli import main
from itouch_tools.viewer.signals import charts

RECORDED = '<record to="run.mcap"><channels of="peltier.*"/><channels of="heat.*" rate="100 Hz"/></record>'


def rename_all(patch: pytest.MonkeyPatch, seed: int) -> Renaming:
    """Let every catalog of this process have plugins with other names of channels and fields."""
    words, known, made = Renaming(seed), {}, {}
    device, modality = Catalog.device, Catalog.modality

    def renamed(self, name):
        cls = device(self, name)
        if cls is not None and cls not in made:
            made[cls] = renamed_device(cls, words)
        return cls and made[cls]

    def other(self, plugin, local):
        cls = modality(self, plugin, local)
        if cls is not None and cls not in made:
            made[cls] = renamed_modality(cls, words, known)
        return cls and made[cls]

    patch.setattr(Catalog, "device", renamed)
    patch.setattr(Catalog, "modality", other)
    return words


@dataclass
class Used:
    """What all commands have said, and what they have written."""

    said: dict[str, str]
    folder: Path


def use(folder: Path, capsys) -> Used:
    """Use every command on one scene, as a person would."""
    (folder / "scene.xml").write_text(scene(OURS, more=RECORDED))
    said: dict[str, str] = {}

    def command(name: str, *given: str, code: int = 0) -> None:
        found = main(list(given))
        streams = capsys.readouterr()
        assert found == code, f"{name}: {found}\n{streams.out}\n{streams.err}"
        said[name] = streams.out

    path, recording, session = str(folder / "scene.xml"), str(folder / "run.mcap"), str(folder / "half.itouch")
    command("check", "check", path)
    command("inspect", "inspect", path)
    command("plan", "inspect", path, "--plan")
    command("safety-report", "safety-report", path, "--no-run")
    command("run", "run", path, "--headless", "--for", "0.7s", "--save", session, "--no-record")
    command("session", "inspect", session)
    command("go on", session, "--headless", "--record", recording, "--report", str(folder / "report.json"))
    command("recording", "inspect", recording)
    command("replay", "replay", recording)
    command("csv", "export", recording, "--csv", str(folder / "tables"))
    command("parquet", "export", recording, "--parquet", str(folder / "all.parquet"))
    command("bids", "export", recording, "--bids", str(folder / "bids"))
    command("xml", "export", session, "--xml", str(folder / "half.xml"))
    command("page", "report", recording, "-o", str(folder / "run.html"))
    command("devices", "devices")
    command("probe", "devices", "--probe")
    command("calibrate", "calibrate", path)
    off = scene(OURS).replace("<xyz-table:hardware", '<calibration method="touch-off"/><xyz-table:hardware')
    (folder / "off.xml").write_text(off)
    command("touch-off", "calibrate", str(folder / "off.xml"), "--kind", "touch-off", "--device", "table")
    return Used(said, folder)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    class Captured:
        """Takes what is printed."""

        def __init__(self):
            self.out, self.err = io.StringIO(), io.StringIO()

        def readouterr(self):
            found = type("Streams", (), {"out": self.out.getvalue(), "err": self.err.getvalue()})
            for stream in (self.out, self.err):
                stream.seek(0)
                stream.truncate()
            return found

    patch, found = pytest.MonkeyPatch(), []
    words = None
    for renames in (False, True):
        if renames:
            words = rename_all(patch, 31)
        folder, captured = tmp_path_factory.mktemp("entrance"), Captured()
        patch.chdir(folder)
        with redirect_stdout(captured.out), redirect_stderr(captured.err):
            found.append(use(folder, captured))
    patch.undo()  # the tests that follow have plugins with their own names
    return found[0], found[1], words


def alike(text: str, used: Used, words: Renaming | None = None) -> list[str]:
    """Return the words of a text without what differs between any two runs: names put back, times, sizes, ids."""
    text = text.replace(str(used.folder), "FOLDER")
    text = words.back(text) if words else text
    return re.sub(r"\d+(\.\d+)?|0x\w+|[0-9a-f]{12,}", "N", text).replace("_", " ").split()


@pytest.mark.parametrize(
    "name",
    [
        "check", "inspect", "plan", "safety-report", "session", "replay", "csv", "devices", "probe", "calibrate",
        "touch-off",
    ],
)  # fmt: skip
def test_every_command_says_the_same(both, name):
    ours, others, words = both
    assert sorted(alike(others.said[name], others, words)) == sorted(alike(ours.said[name], ours))


def test_the_numbers_of_check_and_safety_report_are_the_same(both):
    ours, others, words = both
    for name in ("check", "safety-report"):
        assert re.findall(r"\d+\.?\d* (?:degC|°C|A|N|m/s|K/s|ms|s)", words.back(others.said[name])) == re.findall(
            r"\d+\.?\d* (?:degC|°C|A|N|m/s|K/s|ms|s)", ours.said[name]
        )


def test_reports_are_the_same(both):
    ours, others, words = both
    found = [json.loads((used.folder / "report.json").read_text()) for used in (ours, others)]
    assert found[0]["contacts"] == found[1]["contacts"] and len(found[0]["contacts"]) == 1
    assert found[0]["faults"] == found[1]["faults"] == []
    assert found[0]["modalities"] == found[1]["modalities"]


def test_recordings_are_the_same_numbers_with_the_same_units_and_sentences(both):
    ours, others, words = both
    one, other = (read(str(used.folder / "run.mcap")) for used in (ours, others))
    assert {words.back(name): unit for name, unit in other.units.items()} == one.units
    assert {words.back(name): words.back(doc) for name, doc in other.meanings.items()} == one.meanings
    for track in one.tracks:
        rows = other[track]
        names = {words.back(name): name for name in rows.dtype.names}
        for name in one[track].dtype.names:
            assert np.array_equal(one[track][name], rows[names[name]], equal_nan=True), f"{track}.{name}"


def test_tables_have_the_same_heads(both):
    ours, others, words = both
    for file in sorted((ours.folder / "tables").glob("*.csv")):
        one, other = ((u.folder / "tables" / file.name).read_text().splitlines()[0] for u in (ours, others))
        assert words.back(other) == one


def test_parquet_has_the_same_columns(both):
    parquet = pytest.importorskip("pyarrow.parquet")
    ours, others, words = both
    one, other = (parquet.read_schema(used.folder / "all.parquet") for used in (ours, others))
    assert [words.back(name) for name in other.names] == one.names
    assert [other.field(i).metadata for i in range(len(other))] == [one.field(i).metadata for i in range(len(one))]


def test_bids_has_the_same_sidecars(both):
    ours, others, words = both
    for file in sorted((ours.folder / "bids").rglob("*physio.json")):
        one, other = (json.loads((used.folder / file.relative_to(ours.folder)).read_text()) for used in (ours, others))
        assert {words.back(key) for key in other} == set(one)
        assert [words.back(column) for column in other["Columns"]] == one["Columns"]
        table = [
            gzip.decompress((used.folder / file.relative_to(ours.folder)).with_suffix(".tsv.gz").read_bytes())
            for used in (ours, others)
        ]
        assert table[0] == table[1]


def test_the_page_has_the_same_charts_and_meanings(both):
    ours, others, words = both
    heads = [re.findall(r"<h[1-3][^>]*>(.*?)</h[1-3]>", (u.folder / "run.html").read_text()) for u in (ours, others)]
    assert [words.back(head) for head in heads[1]] == heads[0]


@settings(max_examples=5)
@given(seed=st.integers(min_value=100, max_value=1 << 30))
def test_any_words_compile_to_the_same_supervision_and_the_same_charts(seed, tmp_path_factory):
    """A law: what watches, what is limited, and what is plotted depends on no word."""
    file = tmp_path_factory.mktemp("law") / "scene.xml"
    file.write_text(scene(OURS))
    told = []
    for renames in (False, True):
        with pytest.MonkeyPatch.context() as patch:
            words = rename_all(patch, seed) if renames else None
            model, problems = compile_scene(load_scene(file), Catalog())
            assert model is not None, problems
            rules = [(d.name, m.name, str(m.rules())) for d in model.devices.values() for m in d.monitors]
            drawn = [(c.title, c.unit, [s.doc for s in c.signals]) for c in charts(model)]
            told.append((rules, drawn) if words is None else ([(*r[:2], words.back(r[2])) for r in rules], drawn))
    assert str(told[0]).replace("_", " ") == str(told[1]).replace("_", " ")


@pytest.mark.long
@pytest.mark.punctual  # the suite judges how long a step takes
@pytest.mark.parametrize("plugin", ["xyz-table", "thermal", "thermal.heat"])
def test_the_conformance_suite_says_the_same(plugin, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = []
    for renames in (False, True):
        with pytest.MonkeyPatch.context() as patch:
            words = rename_all(patch, 77) if renames else None
            assert main(["test-plugin", plugin]) == 0
            out = capsys.readouterr().out
            said.append(
                re.findall(r"^ +(ok|FAILED|-) +([\w-]+)", words.back(out) if words else out, flags=re.MULTILINE)
            )
    # in a process of its own the plugin has its own names: what starts one is left out under others
    assert [one for one in said[0] if one[1] != "sigterm"] == [one for one in said[1] if one[1] != "sigterm"]
    assert len(said[0]) > 20
