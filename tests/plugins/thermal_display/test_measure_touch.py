"""Real touches on twins of film and force sensor: what is measured is what left the finger."""

import re

import numpy as np
import pytest
from shipped import SCENES

import itouch
from contact_heat.contact import Contact
from contact_heat.stepper import Stepper
from itouch_thermal.display.column import Array
from itouch_thermal.film.film_params import FilmParams
from itouch_thermal.film.twin import sample_side
from itouch_thermal.flux.curve import read_curve
from itouch_thermal.heat import FINGER, finger_side
from itouch_thermal.measuring import command
from itouch_thermal.measuring.correct import Sensors, average, correct, output_times
from itouch_thermal.measuring.touches import Record, Touched, Wanted, sort_out, touches
from itouch_thermal.rendering.materials import material

SCENE = """<itouch version="1.0" xmlns:touch-film="urn:itouch:plugin:touch-film"><world temperature="23 degC"/>
<devices><device name="bench" plugin="touch-film"><touch-film:hardware hold="{hold} s" touches="{touches}" {more}>
<touch-film:sample thickness="20 mm" conductivity="{k} W/(m*K)" specific-heat="{c} J/(kg*K)" density="{rho} kg/m^3"/>
</touch-film:hardware></device></devices><rates servo="{rate} Hz"/></itouch>"""
ROOM, SKIN = 296.15, 306.15


def scene(folder, name, *, hold=4.2, touches=8, rate=500, more=""):
    body = material(name)[1]
    path = folder / f"{name}.xml"
    path.write_text(
        SCENE.format(
            hold=hold, touches=touches, rate=rate, more=more, k=body.conductivity, c=body.specific_heat,
            rho=body.density,
        )
    )  # fmt: skip
    return str(path)


def truth(name: str, times: Array) -> Array:
    """Return the flux of a touch with the wanted force, by the solver."""
    params = FilmParams(sample=(material(name)[1].layer(0.02),))
    contact = Contact(finger=finger_side(FINGER, params.core, SKIN, ROOM), object=sample_side(params, ROOM))
    at = np.arange(1, round(times[-1] / 1e-3) + 2) * 1e-3
    flux = Stepper(contact, 1e-3).advance(params.contact_resistance / -np.expm1(-at / params.press))
    return np.interp(times, at, flux)


def worst(curve, name):
    seen = curve.times > 0.0999
    exact = truth(name, curve.times)[seen]
    return 100.0 * float(np.abs((curve.fluxes[seen] - exact) / np.maximum(np.abs(exact), 200.0)).max())


@pytest.fixture(scope="module")
def foam(tmp_path_factory):
    """A short measurement of foam: its folder."""
    folder = tmp_path_factory.mktemp("foam")
    path = scene(folder, "polystyrene", hold=1.6, touches=5, more='force-spread="2 %"')
    words = ["touch", path, "-o", str(folder / "foam.csv"), "--duration", "1.5 s", "--repeat", "5", "--who", "P07",
             "--what", "foam", "--raw", str(folder / "raw")]  # fmt: skip
    assert command.main(words) == 0
    return folder


def test_a_curve_is_what_left_the_finger(foam):
    curve = read_curve(str(foam), "foam.csv")
    assert worst(curve, "polystyrene") < 2.0


def test_the_head_says_how_it_came_about(foam):
    head = [line for line in (foam / "foam.csv").read_text().splitlines() if line.startswith("#")]
    text = "\n".join(head)
    for what in ("what: foam", "who: P07", "touches: 5 averaged, 0 left out", "lag 0.05 s", "129 J/m2K", "UTC"):
        assert what in text
    assert float(re.search(r"skin before: ([0-9.]+) degC", text)[1]) == pytest.approx(33.0, abs=0.1)
    assert float(re.search(r"film before: ([0-9.]+) degC", text)[1]) == pytest.approx(23.0, abs=0.02)
    assert 13.0 < float(re.search(r"read ([0-9.]+) W/m2 at rest", text)[1]) < 16.0
    gains = [float(found) for found in re.findall(r"([0-9.]+) x the film's", text)]
    assert len(gains) == 1 or gains[0] > gains[1]


def test_without_the_corrections_it_is_not(foam, tmp_path):
    path = str(foam / "polystyrene.xml")
    words = ["touch", path, "-o", str(tmp_path / "raw.csv"), "--duration", "1.5s", "--repeat", "2", "--for", "10 s"]
    assert command.main([*words, "--lag", "0 s", "--film-capacity", "0 J/(m^2*K)"]) == 0
    assert worst(read_curve(str(tmp_path), "raw.csv"), "polystyrene") > 20.0
    assert "j: flux through the film's middle: as read" in (tmp_path / "raw.csv").read_text()


def test_raw_touches_are_kept(foam):
    files = sorted((foam / "raw").glob("touch*.csv"))
    assert len(files) == 5
    lines = files[0].read_text().splitlines()
    assert "# who: P07" in lines and "t [s],j [W/m^2],film [degC],force [N]" in lines


def test_a_scene_without_a_film_is_refused(tmp_path, capsys):
    (tmp_path / "s.xml").write_text('<itouch version="1.0"/>')
    assert command.main(["touch", str(tmp_path / "s.xml"), "-o", str(tmp_path / "c.csv"), "--for", "1 s"]) == 2
    assert "reads a heat flux or a contact force" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path, capsys):
    words = ["touch", str(tmp_path / "none.xml"), "-o", str(tmp_path / "no" / "c.csv")]
    with pytest.raises(SystemExit) as ended:
        command.main(words)
    assert ended.value.code == 2
    assert f"there is no folder '{tmp_path / 'no'}'; make it first" in capsys.readouterr().err


def _record(*, force=1.0, hold=2.0, count=3, period=1e-3, slope=0.0, skin=SKIN):
    one = np.concatenate((np.zeros(2000), np.full(round(hold / period), force)))
    pushed = np.concatenate((np.tile(one, count), np.zeros(1000)))
    time = np.arange(len(pushed)) * period
    skins = np.where(pushed > 0.0, np.nan, skin)
    return Record(time, 7.0 + 100.0 * (pushed > 0.0), ROOM + slope * time, pushed, skins)


def test_touches_are_found_where_the_force_is():
    found = touches(_record())
    assert [round(one.begin, 3) for one in found] == pytest.approx([1.999, 5.999, 9.999], abs=2e-3)
    assert all(one.offset == pytest.approx(7.0) and one.flux[5] == pytest.approx(100.0) for one in found)


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (_record(force=1.3), "its force was 1.30 N"),
        (_record(hold=0.8), "it lasted 0.80 s"),
        (_record(slope=0.05), "the sample was not at rest: its film changed by +0.050 K/s"),
    ],
)
def test_what_is_not_as_wanted_is_left_out(record, why):
    good, bad = sort_out(touches(record), Wanted(1.0, 1.5))
    assert not good and len(bad) == 3 and why in bad[0]


def test_a_finger_that_is_colder_than_usual_is_left_out():
    found = touches(_record(count=5))
    odd = found[2]
    found[2] = Touched(odd.times, odd.flux, odd.film, odd.force, odd.begin, SKIN - 0.8, odd.rest, odd.offset, odd.slope)
    good, bad = sort_out(found, Wanted(1.0, 1.5))
    assert len(good) == 4 and bad == ["touch 3: the skin was 32.20 degC, not 33.00 as usual"]


def test_the_correction_is_exact_for_parabolas_and_its_gain_is_the_noise():
    """A first-order sensor of a parabola shows a known one, and the gain is the standard deviation of pure noise."""
    times, lag, rng = np.arange(4000) * 1e-3, 0.05, np.random.default_rng(4)
    flux = 500.0 - 60.0 * times + 20.0 * times**2
    shown = flux - lag * (-60.0 + 40.0 * times) + lag**2 * 40.0
    film = np.full(4000, ROOM)
    at, sensors = output_times(3.0), Sensors(lag, 5e-3, 129.0)
    touch = Touched(times, shown, film, film, 0.0, SKIN, ROOM, 0.0, 0.0)
    found = correct(touch, sensors, at)
    assert found.flux[10:] == pytest.approx(500.0 - 60.0 * at[10:] + 20.0 * at[10:] ** 2, rel=1e-6)
    rows = []
    for _ in range(200):
        noise = Touched(times, rng.normal(size=4000), film, film, 0.0, SKIN, ROOM, 0.0, 0.0)
        rows.append(correct(noise, sensors, at[[9, 99]]).flux)
    assert np.std(rows, axis=0) == pytest.approx(found.flux_gain[[9, 99]], rel=0.25)


def test_no_touch_is_no_average():
    with pytest.raises(ValueError, match="no touch"):
        average([], Sensors())


def test_the_shipped_scene_is_measured_again_the_same(tmp_path):
    for name in ("a.csv", "b.csv"):
        words = ["touch", str(SCENES / "real_touch.xml"), "-o", str(tmp_path / name), "--for", "15 s", "--repeat", "2"]
        assert command.main(words) == 0
    one, two = ((tmp_path / name).read_text().split("t [s]")[1] for name in ("a.csv", "b.csv"))
    assert one == two


@pytest.mark.long
@pytest.mark.parametrize("name", ["aluminium", "pyrex", "wood", "PMMA", "polystyrene"])
def test_five_materials_are_measured_and_rendered(name, tmp_path):
    output = tmp_path / "curve.csv"
    assert command.main(["touch", scene(tmp_path, name), "-o", str(output), "--repeat", "8"]) == 0
    off = worst(read_curve(str(tmp_path), "curve.csv"), name)
    assert off < 2.0
    text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    assert "<operator" in text
    (tmp_path / "play.xml").write_text(
        '<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal"><include file="itouch:materials.xml"/>'
        '<include file="itouch:rigs/twin.xml"/><world temperature="23 degC"><box name="block" pos="0 0 7.5 mm" '
        'size="60 60 15 mm" material="wood"/></world><interaction><probe name="finger" radius="8 mm" pose-from="arm" '
        'force-to="arm" surface-to="table"/><operator probe="finger" mass="80 g" stiffness="300 N/m" '
        'damping="6 N*s/m" skin-temperature="33 degC"><motion><to pos="0 0 48 mm" in="0.8 s" hold="3 s"/>'
        '<to pos="0 0 19 mm" in="0.7 s" hold="4 s"/><to pos="0 0 48 mm" in="0.6 s"/></motion></operator>'
        '<thermal:heat probe="finger"/><thermal:flux-control display="peltier" desired-from="heat" target="file" '
        'file="curve.csv"/></interaction></itouch>',
        encoding="utf-8",
    )  # fmt: skip
    with itouch.build(str(tmp_path / "play.xml")) as session:
        session.run()
        (contact,) = session.report()["contacts"]
    print(f"{name}: curve within {off:.2f} %, rendered within {100.0 * contact['flux_error_rms']:.2f} % rms")
    # The display's own bounds in all its corners, here with the report's smaller floor of the flux.
    assert contact["flux_error_rms"] < (0.015 if name == "polystyrene" else 0.008)
