"""The problem description: ranges, case files with closed keys, resistance laws, the material library."""

import json

import heat_cases
import pytest

from contact_heat.contact import case_of
from contact_heat.resistance import (
    DEFAULT_RESISTANCE,
    ConstantResistance,
    PressureResistance,
    TableResistance,
    contact_area,
    material_resistance,
)
from itouch_thermal import Back, Contact, Initial, Layer, Side
from itouch_thermal.library import library


@pytest.mark.parametrize("name", heat_cases.SOLVED)
def test_a_contact_is_what_its_case_file_states(name):
    path = heat_cases.FOLDER / f"{name}.json"
    contact, stated = Contact.from_json(path), json.loads(path.read_text())
    assert contact.resistance == stated["Rth"]
    for side, told in ((contact.finger, stated["finger"]), (contact.object, stated["object"])):
        assert [(layer.name, layer.thickness, layer.conductivity, layer.density, layer.specific_heat) for layer in side.layers] == [
            (layer["name"], layer["L"], layer["k"], layer["rho"], layer["c"]) for layer in told["layers"]
        ]  # fmt: skip
        assert side.arterial == (pytest.approx(told["T_art"] + 273.15) if "T_art" in told else None)
        assert (side.initial.kind, side.back.kind) == (told["initial"]["type"], told["back"]["type"])
    assert [(probe.name, probe.side, probe.depth, probe.what) for probe in contact.probes] == [
        (probe["name"], probe["side"], probe["depth"], probe["what"]) for probe in stated.get("probes", ())
    ]


PROBE = {"side": "finger", "depth": 1e-4, "name": "deep"}
STILL_AIR = {"type": "steady", "T_amb": 20.0, "h": 0.0}
ENDLESS_IN_STILL_AIR = {
    "layers": [{"L": None, "k": 1.0, "rho": 2500.0, "c": 800.0}],
    "back": None,
    "initial": STILL_AIR,
}
INSULATED_IN_STILL_AIR = {"back": {"type": "insulated"}, "initial": STILL_AIR}

BAD = [
    (lambda c: c.update(foo=1), "unknown key 'foo'"),
    (lambda c: c["finger"].update(foo=1), "finger: unknown key 'foo'"),
    (
        lambda c: c["finger"]["layers"][0].update(k=-1),
        r"finger.layers\[0\]: conductivity = -1.0 is out of range: 0.0001",
    ),
    (lambda c: c["finger"]["layers"][0].update(L=0), r"layers\[0\]: thickness = 0.0 is out of range"),
    (lambda c: c["object"]["layers"][0].update(rho=float("nan")), r"object.layers\[0\].rho = nan"),
    (lambda c: c["object"]["layers"][0].update(rho="heavy"), r"object.layers\[0\].rho = 'heavy'"),
    (lambda c: c["object"]["layers"][0].pop("c"), r"object.layers\[0\]: 'c' is missing"),
    (lambda c: c["finger"].update(layers=c["finger"]["layers"] * 6), "18 given; there may be 1 to 16"),
    (lambda c: c["finger"].update(layers=[]), "0 given"),
    (lambda c: c.update(Rth=-1), "Rth"),
    (lambda c: c.update(Rth=True), "Rth = True"),
    (lambda c: c.pop("Rth"), "'Rth' is missing"),
    (lambda c: c.update(times={"at": [2, 1]}), r"times\[1\]"),
    (lambda c: c.update(times={"at": [-1, 1]}), r"times\[0\]"),
    (lambda c: c.update(times={"from": 2, "to": 1, "per_decade": 3}), "times.from"),
    (lambda c: c["finger"].pop("back"), "finger: back: missing"),
    (lambda c: c["finger"].pop("T_art"), "arterial: missing"),
    (lambda c: c["object"].update(initial={"type": "odd"}), "object.initial: initial = 'odd' is unknown"),
    (lambda c: c["object"].update(initial={"type": "steady", "h": 1}), "needs 'surface'"),
    (lambda c: c["object"].update(back={"type": "convection", "T": 3}), "needs 'coefficient'"),
    (lambda c: c.update(probes=[{"side": "finger", "depth": 1}]), "probes.depth = 1.0 is out of range"),
    (lambda c: c.update(finger=[]), "finger: expected an object"),
    (lambda c: c.update(probes=[PROBE, {**PROBE, "depth": 0}]), "probes.name = 'deep' is taken: each column"),
    (lambda c: c.update(probes=[{**PROBE, "name": "T_skin"}]), "probes.name = 'T_skin' is taken"),
    (lambda c: c.update(probes=[{**PROBE, "name": "a,b"}]), r"probes\[0\]: probes.name = 'a,b' can't head a column"),
    (lambda c: c["object"].update(ENDLESS_IN_STILL_AIR), "object: initial: with a film of 0 any temperature is steady"),
    (lambda c: c["object"].update(INSULATED_IN_STILL_AIR), "object: initial: with a film of 0 any temperature"),
]


@pytest.mark.parametrize(("spoil", "message"), BAD)
def test_bad_cases_name_the_field(spoil, message):
    case, _ = heat_cases.solved("b_wood_R0")
    spoil(case)
    with pytest.raises(ValueError, match=message):
        case_of(case)


def test_a_broken_file_is_named(tmp_path):
    path = tmp_path / "broken.json"
    path.write_text("{")
    with pytest.raises(ValueError, match=r"broken\.json: not JSON"):
        Contact.from_json(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"Rth": 0.0', '"Rth": 0.0, "Rth": 1.0', "key 'Rth' occurs twice in one object"),
        ('"Rth": 0.0', '"Rth": ' + "9" * 400, "Rth: a whole number of so many digits is out of range"),
        ('"Rth": 0.0', '"Rth": ' + "9" * 5000, "not JSON"),
        ('"Rth": 0.0', '"Rth": ' + "[" * 100_000, "too deeply nested for a contact case"),
        ('"Rth": 0.0', '"Rth": 0.0, "times": {"from": 1e-300, "to": 1e300, "per_decade": 1e4}', "there may be up to"),
        ('"T_art": 37.0', '"T_art": -300.0', "finger.T_art = -300.0 is out of range: -273.15 to 2726.85 degC"),
    ],
    ids=["twice", "400 digits", "5000 digits", "nested", "times", "too cold"],
)
def test_a_damaged_case_file_is_one_message(old, new, message, tmp_path):
    case, _ = heat_cases.solved("b_wood_R0")
    case.pop("times", None)
    text = json.dumps(case | {"Rth": 0.0, "finger": case["finger"] | {"T_art": 37.0}})
    assert text.count(old) == 1
    (tmp_path / "case.json").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=r"case\.json: ") as raised:
        Contact.from_json(tmp_path / "case.json")
    assert message in str(raised.value)


def test_a_case_file_may_begin_with_a_byte_order_mark(tmp_path):
    path = heat_cases.FOLDER / "b_wood_R0.json"
    (tmp_path / "case.json").write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert Contact.from_json(tmp_path / "case.json") == Contact.from_json(path)


def test_only_the_last_layer_may_be_endless():
    endless = Layer(conductivity=1, density=1000, specific_heat=1000)
    thin = Layer(thickness=1e-3, conductivity=1, density=1000, specific_heat=1000)
    start = Initial(kind="uniform", temperature=300)
    with pytest.raises(ValueError, match="only the last"):
        Side(layers=(endless, thin), initial=start, back=Back(kind="insulated"))
    with pytest.raises(ValueError, match="semi-infinite side has none"):
        Side(layers=(endless,), initial=start, back=Back(kind="insulated"))


def test_resistance_laws():
    assert ConstantResistance().at(1.0) == DEFAULT_RESISTANCE
    assert ConstantResistance().at(0.0) == float("inf")
    law = PressureResistance()
    assert law.at(1.0) == pytest.approx(DEFAULT_RESISTANCE)
    assert law.at(0.1) > law.at(1.0) > law.at(10.0)
    table = TableResistance((0.5, 1.0), (4e-3, 2e-3))
    assert table.at(0.75) == pytest.approx(3e-3)
    assert table.at(0.1) == 4e-3
    with pytest.raises(ValueError, match="ascend"):
        TableResistance((1.0, 0.5), (1e-3, 1e-3))
    assert contact_area(8.0) == pytest.approx(2.0 * contact_area(1.0))
    assert material_resistance(200.0) == pytest.approx(5.36e-4, rel=1e-2)


def test_the_library_has_the_paper_and_a_handbook_with_sources():
    found = {material.name: material for material in library()}
    assert len(found) >= 29
    assert all(material.source for material in found.values())
    assert found["wood"].layer.density == 415.0
    assert "swapped" in found["wood"].source
    assert found["aluminium"].effusivity == pytest.approx(22249, rel=1e-3)
