"""What `measure touch` refuses, and what it keeps: options, missing thermometers, held readings, failures, prompts."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import itouch
from itouch.plugin import DeviceError
from itouch_thermal import bench_spread, cli, reproduce
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.flux.curve import read_curve
from itouch_thermal.measuring import command, sampling
from itouch_thermal.measuring.command import Prompts
from itouch_thermal.measuring.correct import Sensors, correct
from itouch_thermal.measuring.sampling import Given, Sampled, Source, calibrated
from itouch_thermal.measuring.touches import Record, Touched, Wanted, sort_out, touches

CASE = Path(__file__).parent.parent / "thermal" / "cases" / "b_wood_R0.json"
SKIN, ROOM = 306.15, 296.15
SCENE = """<itouch version="1.0" xmlns:touch-film="urn:itouch:plugin:touch-film"><world temperature="21 degC"/>
<devices><device name="bench" plugin="touch-film"><touch-film:hardware hold="0.6 s" pause="1.2 s" touches="3">
<touch-film:labjack host="127.0.0.1"><touch-film:flux-sensor sensitivity="1.2e-6 V*m^2/W"/><touch-film:force-sensor/>
</touch-film:labjack></touch-film:hardware></device></devices><rates servo="200 Hz"/></itouch>"""
SOURCE = Source("bench.heat_flux", "bench.wrench", "", "", "", Sensors(0.05), 2e4, "bench")


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A measurement on a film without a thermometer: its folder."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "s.xml").write_text(SCENE, encoding="utf-8")
    words = ["touch", str(folder / "s.xml"), "-o", str(folder / "c.csv"), "--duration", "0.5 s", "--repeat", "2",
             "--raw", str(folder / "raw")]  # fmt: skip
    assert command.main(words) == 0
    return folder


def test_without_a_thermometer_the_lag_alone_is_taken_out(bare):
    assert np.isfinite(read_curve(str(bare), "c.csv").fluxes).all()
    text = (bare / "c.csv").read_text(encoding="utf-8")
    assert "room, as the scene has it: 21.00 degC" in text and "flux through the film's middle: lag taken out" in text
    raw = (bare / "raw" / "touch01.csv").read_text(encoding="utf-8")
    assert "# room [degC]: 21.0000" in raw and "nan" not in raw and "# film resistance [m2K/W]: 1.5e-05" in raw


def test_without_a_thermometer_a_capacity_is_refused(bare, capsys):
    words = ["touch", str(bare / "s.xml"), "-o", str(bare / "d.csv"), "--film-capacity", "129 J/(m^2*K)"]
    assert command.main(words) == 2
    assert "no device of the scene reads the film's temperature" in capsys.readouterr().err
    assert calibrated(SOURCE, Given(0.02, 0.0)).sensors == Sensors(0.02)


def test_a_film_that_was_not_read_is_no_nan():
    times = np.arange(400) * 5e-3
    touch = Touched(times, np.full(400, 9.0), np.full(400, np.nan), times, 0.0, SKIN, np.nan, 0.0, 0.0)
    assert correct(touch, Sensors(0.05), np.array([0.1, 1.0])).flux == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--every", "0 ms"], "--every 0 ms is out of range"),
        (["--every", "-10 ms"], "--every -10 ms is out of range"),
        (["--every", "5 s"], "--every 5 s is out of range: 0.0001 to 2 s"),
        (["--every", "soon"], "--every soon: "),
        (["--lag=-1 ms"], "--lag -1 ms is out of range"),
        (["--lag", "9 s"], "--lag 9 s is out of range: 0 to 2 s"),
        (["--film-capacity=-1 J/(m^2*K)"], "--film-capacity -1 J/(m^2*K) is out of range"),
        (["--film-capacity", "1 N"], "--film-capacity 1 N: "),
        (["--for", "0 s"], "--for 0 s is out of range"),
        (["--force", "0 N"], "--force 0 N is out of range"),
        (["--duration", "0 s"], "--duration 0 s is out of range"),
        (["--raw", "c.xml"], "argument --raw: 'c.xml' is a file; name a folder"),
        (["--raw", "c.xml/below"], "--raw 'c.xml/below' is not a folder"),
        (["--raw", "old"], "--raw 'old' holds files already"),
        (["--seed", "-1"], "--seed -1 is out of range: 0 to 2^63 - 1"),
        (["--seed", str(1 << 64)], "is out of range: 0 to 2^63 - 1"),
    ],
)
def test_options_are_looked_at_before_the_work(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.xml").write_text("", encoding="utf-8")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "touch09.csv").write_text("", encoding="utf-8")
    monkeypatch.setattr(command, "sample", lambda *a, **k: pytest.fail("it was sampled"))
    try:
        code = command.main(["touch", "s.xml", "-o", "c.csv", *words])
    except SystemExit as ended:  # of the parser
        code = ended.code
    assert code == 2
    assert said in capsys.readouterr().err


def _record(gaps=(1.5, 1.5), hold=0.8, period=5e-3):
    """Return a record of touches with 1 N, each after a gap [s]."""
    force = np.concatenate([np.repeat((0.0, 1.0), (round(g / period), round(hold / period))) for g in gaps])
    force = np.append(force, np.zeros(100))
    flux = 7.0 + 100.0 * (force > 0.0)
    return Record(
        np.arange(len(force)) * period, flux, np.full(len(force), ROOM), force, np.where(force > 0, np.nan, SKIN)
    )


def test_a_second_of_rest_is_since_the_last_touch_too():
    good, bad = sort_out(touches(_record((0.5, 1.5, 0.6, 1.5))), Wanted(1.0, 0.7))
    assert len(good) == 2 and all(touch.offset == pytest.approx(7.0) for touch in good)
    assert [why.split(": ")[0] for why in bad] == ["touch 1", "touch 3"]
    assert "0.50 s of rest before it, not 1 s" in bad[0] and "s of rest before it, not 1 s" in bad[1]


@pytest.mark.parametrize("period", [1e-3, 2e-3])
@pytest.mark.parametrize("late", [0.1, 0.6])
def test_the_begin_of_a_touch_is_where_its_force_came_up(period, late):
    times = np.arange(round(4.0 / period)) * period
    begin = 1500 * 2e-3 - late * period
    force = np.clip(50.0 * (times - begin), 0.0, 1.0)  # 20 ms to the force
    record = Record(times, 0.0 * times, 0.0 * times + ROOM, force, 0.0 * times + SKIN)
    (touch,) = touches(record)
    assert touch.begin == pytest.approx(begin, abs=0.1 * period)


class _Session:
    """A scene of which every third tick has a new reading, and which may fail."""

    scripted, done = False, False

    def __init__(self, fails=None):
        self.model, self.ticks, self.fails = SimpleNamespace(period=1e-3, devices={}), 0, fails
        names = ("tick", "bench.sequence", "bench.missed")
        self.state = {name: np.zeros((), np.int64) for name in names}
        self.state |= {"bench.heat_flux": np.zeros(()), "bench.wrench": np.zeros(6)}

    def __enter__(self):
        return self

    def __exit__(self, *what):
        self.closed = True

    def enable(self):
        pass

    def tick(self):
        self.ticks += 1
        self.state["tick"][...] = self.ticks
        if self.ticks % 3 == 0:
            self.state["bench.sequence"] += 1
            self.state["bench.heat_flux"][...] = self.ticks
        if self.ticks == 10:
            self.state["bench.missed"] += 6
        if self.fails is not None and self.ticks == 20:
            raise self.fails


def _sampled(monkeypatch, session):
    program = SimpleNamespace(
        load=lambda *a, **k: SimpleNamespace(devices=(), world=SimpleNamespace(temperature=ROOM)),
        build=lambda *a, **k: session,
    )
    monkeypatch.setattr(sampling, "framework", lambda: program)
    monkeypatch.setattr(sampling, "find", lambda model: SOURCE)
    return sampling.sample("s.xml", longest=0.036)


def test_a_reading_that_is_held_is_no_sample(monkeypatch):
    found = _sampled(monkeypatch, _Session())
    assert found.record.flux.tolist() == [3, 6, 9, 12, 15, 18, 21, 24, 27, 30]
    assert (1e3 * found.record.times).tolist() == pytest.approx([3, 6, 9, 18, 21, 24, 27, 30, 33, 36])
    assert not found.stopped and found.room == ROOM


@pytest.mark.parametrize(("fails", "said"), [(DeviceError("no film"), "no film"), (KeyboardInterrupt(), "interrupted")])
def test_what_was_read_before_a_failure_is_kept(fails, said, monkeypatch):
    session = _Session(fails)
    found = _sampled(monkeypatch, session)
    assert session.closed and said in found.stopped and found.record.flux.tolist() == [3, 6, 9, 12, 15, 18]


def test_what_was_read_is_kept_if_a_device_cannot_be_released(monkeypatch):
    class Lost(_Session):
        def __exit__(self, *what):
            raise DeviceError("device 'bench' could not be released: it is gone")

    found = _sampled(monkeypatch, Lost())
    assert "could not be released" in found.stopped and found.record.flux.tolist()[-1] == 30


def test_a_stopped_measurement_writes_what_is_good(monkeypatch, tmp_path, capsys):
    found = Sampled(_record((1.5, 1.5, 1.5)), SOURCE, ROOM, "device 'bench': it is gone")
    monkeypatch.setattr(command, "sample", lambda *a, **k: found)
    words = ["touch", "s.xml", "-o", str(tmp_path / "c.csv"), "--duration", "0.7 s", "--repeat", "3"]
    assert command.main(words) == 1
    assert "touches: 3 averaged" in (tmp_path / "c.csv").read_text(encoding="utf-8")
    assert "stopped: device 'bench': it is gone" in capsys.readouterr().err


def test_a_file_is_written_as_a_whole(tmp_path, monkeypatch):
    path = tmp_path / "c.csv"
    write_whole(path, "old")
    monkeypatch.setattr(os, "replace", lambda *names: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        write_whole(path, "new")
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["c.csv"]


@pytest.fixture
def full(monkeypatch):
    """A disk that takes nothing more of what is written beside a file to take its place."""
    opened = os.fdopen

    def full(handle, *words, **named):
        stream = opened(handle, *words, **named)

        def refused(data):
            raise OSError(errno.ENOSPC, "No space left on device")

        stream.write = refused
        return stream

    monkeypatch.setattr(os, "fdopen", full)


@pytest.mark.usefixtures("full")
def test_a_bench_on_a_full_disk_leaves_the_earlier_figures_and_names_the_file(tmp_path, capsys):
    """They were gone, and 'None' was named."""
    path = tmp_path / "rows.json"
    path.write_text("earlier")
    assert bench_spread.main(["--area", "1.1", "--json", str(path)]) == 2
    assert f"error: '{path}': No space left on device" in capsys.readouterr().err
    assert path.read_text() == "earlier" and list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("full")
@pytest.mark.parametrize(
    ("command", "words", "name"),
    [
        pytest.param(cli, ["solve", str(CASE), "--at", "1ms", "-o"], "touch.png", id="solve"),
        pytest.param(reproduce, ["--figure", "1", "-o"], "figure01.svg", id="reproduce"),
    ],
)
def test_pictures_on_a_full_disk_leave_the_earlier_ones_and_name_them(tmp_path, capsys, command, words, name):
    """Half of the new one had taken the place of the old one."""
    path = tmp_path / name
    path.write_text("earlier")
    assert command.main([*words, str(path if name.endswith("png") else tmp_path)]) == 2
    told = capsys.readouterr().err
    assert str(path) in told and "No space left on device" in told
    assert path.read_text() == "earlier" and list(tmp_path.iterdir()) == [path]


def test_what_goes_to_a_pipe_is_written_into_it(tmp_path):
    script = "from pathlib import Path; from itouch_thermal.atomic_write import write_whole; write_whole(Path('/dev/stdout'), 'x')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "x"), done.stderr


def test_a_folder_that_is_not_there_is_told_with_the_files_own_name(tmp_path):
    path = tmp_path / "no" / "c.csv"
    with pytest.raises(OSError, match="No such file") as error:
        write_whole(path, "new")
    assert error.value.filename == str(path)


def test_the_head_has_the_sensors_calibration_sheets(monkeypatch, tmp_path):
    """Who reads the curve later can tell by which sheets volts became W/m2 and N, and a twin from an instrument."""
    (tmp_path / "s.xml").write_text(SCENE, encoding="utf-8")
    with itouch.build(str(tmp_path / "s.xml")) as session:
        source = sampling.find(session.model)
    found = Sampled(_record((1.5, 1.5, 1.5)), source, ROOM, "")
    monkeypatch.setattr(command, "sample", lambda *a, **k: found)
    words = ["touch", "s.xml", "-o", str(tmp_path / "c.csv"), "--duration", "0.7 s", "--repeat", "3"]
    assert command.main(words) == 0
    text = (tmp_path / "c.csv").read_text(encoding="utf-8")
    assert "# calibration: flux film 1.2e-06 V m2/W at 23 degC" in text and "force 2 N/V, 0 V without force" in text


def test_the_head_says_that_it_was_a_twin(bare):
    assert "# calibration: none, device 'bench' is a twin" in (bare / "c.csv").read_text(encoding="utf-8")


def test_prompts_wait_for_rest_and_count_what_passes(capsys):
    record, prompts = _record((0.5, 1.5, 1.5, 1.5)), Prompts(Wanted(1.0, 0.7), 2)
    record.force[record.force > 0] *= np.where(record.times[record.force > 0] > 4.0, 1.0, 1.3)
    ends = [time for time, force in zip(record.times, record.force, strict=True) if prompts(time, force)]
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "keep the finger off" and "touch 1 of 2: press with 1 N" in said
    unfit = [line for line in said if "does not count" in line]
    assert len(unfit) == 2 and "0.50 s of rest" in unfit[0] and "its force was 1.30 N" in unfit[1]
    assert said.index("touch 2 of 2: press with 1 N") > said.index(unfit[1])
    assert ends[0] == pytest.approx(8.2, abs=0.05)
