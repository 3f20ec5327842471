"""How the program speaks: the same options in all commands, waits that are told, colours, pipes and closed terminals."""

from __future__ import annotations

import argparse
import errno
import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import campaign
import pytest
from program import program as run
from shipped import SCENES

import itouch_tools.cli
from itouch.schema.terminal import VERBOSITY
from itouch_tools.cli import output_files
from itouch_tools.cli.command_options import taken
from itouch_tools.report.screen import fitted

FIRST = str(SCENES / "first_touch.xml")
PROGRAM = [sys.executable, "-m", "itouch"]
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


class Terminal:
    """A program on a terminal of so many columns, and all that it has written there."""

    def __init__(
        self,
        *words: str,
        columns: int = 80,
        env: dict[str, str] | None = None,
        cwd: Path | None = None,
        owns: bool = False,
    ):
        self.ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.text = ""
        self.process = subprocess.Popen(
            [*PROGRAM, *words], stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True, cwd=cwd,
            preexec_fn=(lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0) and None) if owns else None,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "", **(env or {})},
        )  # fmt: skip
        os.close(theirs)

    def read(self, until: Callable[[str], bool] = lambda _: False) -> str:
        """Read until something was written, or to the end."""
        while not until(self.text):
            try:
                block = os.read(self.ours, 65536)
            except OSError:
                break
            if not block:
                break
            self.text += block.decode()
        return self.text

    def end(self) -> int:
        self.read()
        code = self.process.wait(300)
        os.close(self.ours)
        return code


def lines_on_screen(text: str) -> Iterator[str]:
    """Yield what stood on a line at any time, without colours."""
    for piece in re.split(r"\r?\n|\r|\x1b\[2K", _COLOUR.sub("", text)):
        if piece.strip():
            yield piece


@pytest.mark.parametrize("columns", campaign.some([80, 120], 1))
def test_the_live_line_never_wraps(columns: int) -> None:
    terminal = Terminal(str(SCENES / "two_fingers.xml"), "--headless", "--for", "1.2s", columns=columns)
    assert terminal.end() == 0, terminal.text
    live = [line for line in lines_on_screen(terminal.text) if re.match(r" *\d+\.\d\d s  ", line)]
    assert live and all(len(line) < columns for line in live)


def test_what_does_not_fit_is_cut_from_the_end() -> None:
    parts = ["   1.00 s", "finger on wood      ", "plate 30.1 degC", "tick p99 66 us"]
    for width in range(1, 80):
        assert len(fitted(parts, width)) <= width
    assert fitted(parts, 200) == "   1.00 s  finger on wood  plate 30.1 degC  tick p99 66 us"
    assert fitted(["物質" * 30], 21).endswith("…")


@pytest.mark.parametrize(
    "words", [(), ("--help",), ("explain",), ("check", FIRST), ("inspect", FIRST), ("devices",), ("run", "--help")]
)
def test_a_reader_that_goes_is_no_error(words: tuple[str, ...]) -> None:
    process = subprocess.Popen([*PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    _, said = process.communicate(timeout=600)
    assert process.returncode in (0, 2, 141), said
    assert said == b"" or b"note" in said


def test_a_run_whose_reader_goes_ends_safely_with_its_report_and_session(tmp_path: Path) -> None:
    report, kept = tmp_path / "r.json", tmp_path / "s.itouch"
    words = [str(SCENES / "four_materials.xml"), "--headless", "--report", str(report), "--save", str(kept)]
    process = subprocess.Popen([*PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    _, said = process.communicate(timeout=600)
    assert process.returncode == 141, said
    assert b"the devices are safe" in said and b"Traceback" not in said
    assert 0.0 < json.loads(report.read_text())["simulated_s"] < 30.0
    assert kept.stat().st_size > 1000


@pytest.mark.parametrize(
    ("hears", "pace"), campaign.some([(True, "real"), (False, "fast")], 1), ids=["hung up", "only closed"]
)
def test_a_terminal_that_is_closed_ends_a_run_safely(tmp_path: Path, hears: bool, pace: str) -> None:
    report = tmp_path / "r.json"
    terminal = Terminal(FIRST, "--headless", "--pace", pace, "--for", "600s", "--report", str(report), owns=hears)
    terminal.read(until=lambda text: " s  finger" in text)
    os.close(terminal.ours)
    assert terminal.process.wait(300) in (128 + signal.SIGHUP, 128 + signal.SIGPIPE)
    assert 0.0 < json.loads(report.read_text())["simulated_s"] < 600.0


def test_quiet_verbose_and_color_are_taken_wherever_they_stand() -> None:
    assert taken(["-q", "check", "x"]) == (["check", "x"], {"quiet": True})
    assert taken(["check", "x", "--verbose", "--color=never"]) == (["check", "x"], {"verbose": True, "color": "never"})
    assert taken(["check", "--color", "always", "--", "-q"]) == (["check", "--", "-q"], {"color": "always"})
    assert run("check", FIRST, "--color", "blue").returncode == 2


def test_quiet_leaves_results_and_errors(tmp_path: Path) -> None:
    loud, quiet = run("check", FIRST), run("check", FIRST, "--quiet")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    assert quiet.stdout.splitlines() == loud.stdout.splitlines()[:1]
    assert run("-q", "check", "absent.xml", cwd=tmp_path).stderr.startswith("error[no-such-file]")
    assert run("schema", str(tmp_path / "s"), "-q").stdout == ""
    assert (tmp_path / "s" / "itouch.xsd").is_file()
    assert not (VERBOSITY.quiet or VERBOSITY.verbose)
    assert re.search(r"check: \d+\.\d\d s\n", run("check", FIRST, "--verbose").stderr)


def test_colours_are_written_where_they_are_wanted(tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text('<itouch version="1.0">\n<wrld/>\n</itouch>')
    always = run("check", "bad.xml", "--color", "always", cwd=tmp_path).stderr
    assert "\x1b[1;31merror[unknown-element]:\x1b[0m" in always
    plain = run("check", "bad.xml", cwd=tmp_path).stderr
    assert _COLOUR.sub("", always) == plain and "\x1b" not in plain
    for env, coloured in (({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)):
        terminal = Terminal("check", "bad.xml", env={"NO_COLOR": "", **env}, cwd=tmp_path)
        assert terminal.end() == 2
        assert bool(_COLOUR.search(terminal.text)) == coloured, env
    assert "\x1b" not in run("check", "bad.xml", "--color", "never", cwd=tmp_path).stderr


def test_what_a_file_holds_acts_on_no_terminal_in_colours_either(tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text('<itouch version="1.0">\n<safety force="\u202e N"/>\n</itouch>', encoding="utf-8")
    said = run("check", "bad.xml", "--color", "always", cwd=tmp_path).stderr
    assert "\u202e" not in said and "\\u202e" in said


@pytest.mark.punctual  # what is drawn in a second
def test_a_wait_of_over_a_second_is_told_on_a_terminal_only(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom itouch.schema.wait_notices import waiting, shown_by\nfrom itouch_tools.cli import progress\n"
        "from itouch.schema.terminal import escaped\n"
        "with escaped(), shown_by(progress.shown), waiting('working hard') as wait:\n"
        "    time.sleep(1.6)\n    wait.part(0.5, 'half of it')\n    time.sleep(0.8)\n    print('in between')\n"
    )
    told = tmp_path / "wait.py"
    told.write_text(code)
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, str(told)], stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    text = ""
    while True:
        try:
            block = os.read(ours, 65536)
        except OSError:
            break
        text += block.decode()
    assert process.wait(300) == 0
    seen = list(lines_on_screen(text))
    assert any("working hard: half of it" in line and "50%" in line for line in seen), text
    assert "in between" in seen and re.fullmatch(r"working hard: \d+\.\d s", seen[-1])
    silent = subprocess.run([sys.executable, str(told)], capture_output=True, text=True, check=True)
    assert (silent.stdout, silent.stderr) == ("in between\n", "")


def test_only_a_start_that_compiles_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.compiling import KernelCache
    from itouch.servo import prepare

    said: list[str] = []
    monkeypatch.setattr(prepare, "_PATIENCE", 0.05)
    monkeypatch.setattr(prepare, "_LOOK", 0.05)
    monkeypatch.setattr(prepare._Companion, "_start", lambda self: said.append("compiling"))
    for before, missed, expected in ((0, 0, []), (3, 3, []), (3, 5, ["compiling"])):
        monkeypatch.setattr(KernelCache, "missed", before)
        with prepare._Companion(["x.xml"]):
            monkeypatch.setattr(KernelCache, "missed", missed)
            end = time.monotonic() + (300.0 if expected else 0.4)
            while not said and time.monotonic() < end:
                time.sleep(0.01)
        assert said == expected


def test_no_display_is_said_when_something_runs_and_not_before_an_error(tmp_path: Path) -> None:
    env = {"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    wrong = run("absent.xml", cwd=tmp_path, env=env)
    assert "no display" not in wrong.stderr
    right = run(FIRST, "--for", "0.05s", env=env)
    assert right.stderr.count("note: no display") == 1


def test_help_says_of_each_command_what_it_does() -> None:
    lines = itouch_tools.cli.listed()
    assert set(itouch_tools.cli.COMMANDS) | {"thermal", "reproduce", "virtual-arm"} <= set(lines)
    for name, text in lines.items():
        assert text and "command of" not in text and len(text) < 90, name
    block = run("--help").stdout.split("commands:\n")[1].split("\n\n")[0].splitlines()
    assert len({len(line) - len(line[2:].split(" ", 1)[1].lstrip()) for line in block}) == 1  # one column


@pytest.mark.parametrize(
    ("words", "extra", "blocked"),
    [
        (("export", "x.mcap", "--parquet"), "tables", "pyarrow"),
        (("export", "x.mcap", "-o", "x.rrd"), "rerun", "rerun"),
        (("view", "--web"), "web", "viser"),
        (("export", "x.mcap", "--rosbag", "bag"), "ros", "rosbags"),
        (("run", FIRST, "--headless", "--film", "x.mp4"), "film", "av"),
        (("reproduce", "-o", "out"), "plot", "matplotlib"),
        (("report", "x.mcap", "-o", "x.html"), "report", "jinja2"),
        (("test-plugin", "usb-arm"), "test", "pytest"),
    ],
)
def test_missing_extras_are_told_before_the_work(
    words: tuple[str, ...], extra: str, blocked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, blocked, None)
    monkeypatch.setattr("itouch.loop.Engine.tick", lambda self: pytest.fail("the work has begun"))
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert f"pip install 'itouch-py[{extra}]'" in done.stderr and blocked in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        (FIRST, "--save"),
        (FIRST, "--report"),
        (FIRST, "--record"),
        ("report", "x.mcap", "-o"),
        ("safety-report", FIRST, "-o"),
        ("export", "x.mcap", "-o"),
        ("export", "x.mcap", "--bids"),
        ("recover", "x.mcap", "-o"),
        ("check", FIRST, "-o"),
        ("demo", "--scenes"),
        ("schema",),
    ],
)
@pytest.mark.parametrize("place", ["/proc/x.itouch", "/proc/none/x.itouch"])
def test_an_output_that_cannot_be_written_is_told_before_the_work(
    words: tuple[str, ...], place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.loop.Engine.tick", lambda self: pytest.fail("the work has begun"))
    done = run(*words, place)
    assert done.returncode == 2, done.stdout
    assert "cannot be written" in done.stderr or "there is no folder" in done.stderr


def test_a_disk_that_is_only_read_is_named_as_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a new file and for one that is there: the tests may run as a user who may write everywhere."""
    there = tmp_path / "there.json"
    there.write_text("{}")

    def refused(*_: object, **__: object) -> NoReturn:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(output_files.tempfile, "TemporaryFile", refused)
    monkeypatch.setattr(output_files.os, "open", refused)
    monkeypatch.setattr(output_files.os, "access", lambda path, mode: False)
    for path in (tmp_path / "new.json", there):
        with pytest.raises(argparse.ArgumentTypeError, match=f"'{path}' cannot be written: Read-only file system"):
            output_files.Output("report")(str(path))


def test_json_is_one_document_in_all_that_have_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.testing import suites

    monkeypatch.setattr(suites, "DEVICE_CHECKS", suites.DEVICE_CHECKS[:3])
    assert run(FIRST, "--headless", "--for", "0.3s", "--record", str(tmp_path / "r.mcap")).returncode == 0
    recording = str(tmp_path / "r.mcap")
    for words, key in (
        (("check", FIRST), "scenes"),
        (("devices",), "devices"),
        (("inspect", FIRST), "kind"),
        (("export", recording, "--csv", str(tmp_path / "t.csv")), "written"),
        (("doctor",), "checks"),
        (("test-plugin", "keyboard"), "cards"),
    ):
        done = run(*words, "--json")
        assert key in json.loads(done.stdout), words
    assert (tmp_path / "t.csv").is_file()
    keyboard = next(d for d in json.loads(run("devices", "--json").stdout)["devices"] if d["name"] == "keyboard")
    assert keyboard["reads"][0]["unit"] == "m"


def test_export_writes_what_the_ending_of_its_output_says(tmp_path: Path) -> None:
    recording, kept = str(tmp_path / "r.mcap"), str(tmp_path / "s.itouch")
    assert run(FIRST, "--headless", "--for", "0.2s", "--record", recording, "--save", kept).returncode == 0
    for source, name in ((recording, "a.csv"), (recording, "a.parquet"), (kept, "a.xml")):
        done = run("export", source, "-o", str(tmp_path / name))
        assert done.returncode == 0 and (tmp_path / name).is_file(), done.stderr
    wrong = run("export", recording, "-o", str(tmp_path / "a.xlsx"))
    assert wrong.returncode == 2 and ".parquet" in wrong.stderr


def test_check_writes_sarif_that_annotates_lines(tmp_path: Path) -> None:
    (tmp_path / "my scene.xml").write_text('<itouch version="1.0">\n  <wrld/>\n  <safety force="99 N"/>\n</itouch>')
    done = run("check", "my scene.xml", FIRST, "--sarif", cwd=tmp_path)
    log = json.loads(done.stdout)
    assert done.returncode == 2 and log["version"] == "2.1.0"
    (work,) = log["runs"]
    results = work["results"]
    assert {result["level"] for result in results} == {"error"}
    first = results[0]["locations"][0]["physicalLocation"]
    assert first["artifactLocation"]["uri"] == "my%20scene.xml"
    assert (first["region"]["startLine"], first["region"]["startColumn"]) == (2, 3)
    rules = [rule["id"] for rule in work["tool"]["driver"]["rules"]]
    assert all(rules[result["ruleIndex"]] == result["ruleId"] for result in results)
    assert all(rule["shortDescription"]["text"] for rule in work["tool"]["driver"]["rules"])
    done = run("check", "my scene.xml", "-o", "out.sarif", cwd=tmp_path)
    assert done.returncode == 2 and json.loads((tmp_path / "out.sarif").read_text())["runs"][0]["results"] == results


def test_sarif_offers_what_fix_would_do_and_nothing_else(tmp_path: Path) -> None:
    text = (
        '<itouch version="1.0">\n  <wrld temprature="22 degC"><!-- Größe --><box nmae="ä" size="60 60 20 mm"/>\n  </wrld>\n'
        '  <safety frce="2 N"/>\n</itouch>\n'
    )
    (tmp_path / "s.xml").write_text(text, encoding="utf-8")
    log = json.loads(run("check", "s.xml", "--sarif", cwd=tmp_path).stdout)
    lines = text.split("\n")
    offered = [fix for result in log["runs"][0]["results"] for fix in result.get("fixes", [])]
    assert offered and (tmp_path / "s.xml").read_text(encoding="utf-8") == text
    changes = [change for fix in offered for change in fix["artifactChanges"]]
    assert {change["artifactLocation"]["uri"] for change in changes} == {"s.xml"}
    edits = [edit for change in changes for edit in change["replacements"]]
    for edit in sorted(edits, key=lambda e: (-e["deletedRegion"]["startLine"], -e["deletedRegion"]["startColumn"])):
        region, line = edit["deletedRegion"], edit["deletedRegion"]["startLine"] - 1
        first, last = region["startColumn"] - 1, region["endColumn"] - 1
        lines[line] = lines[line][:first] + edit["insertedContent"]["text"] + lines[line][last:]
    once = "\n".join(lines)
    assert "<world" in once and "</world>" in once and "frce" in once  # what limits is left to a person
    assert run("check", "s.xml", "--fix", cwd=tmp_path).stdout.startswith("--- s.xml")
    fixed = (tmp_path / "s.xml").read_text(encoding="utf-8")
    assert "frce" in fixed and "temperature" in fixed and "name=" in fixed  # in the second round
    (tmp_path / "s.xml").write_text(once, encoding="utf-8")
    for _ in range(3):  # applying what is offered again and again comes to the same
        log = json.loads(run("check", "s.xml", "--sarif", cwd=tmp_path).stdout)
        offers = [fix for result in log["runs"][0]["results"] for fix in result.get("fixes", [])]
        if not offers:
            break
        run("check", "s.xml", "--fix", "-q", cwd=tmp_path)
    assert (tmp_path / "s.xml").read_text(encoding="utf-8") == fixed


@pytest.mark.parametrize("words", [("first_touch", "--scenes"), ("--headless", "--scenes")], ids=" ".join)
def test_what_demo_would_ignore_is_refused(words: tuple[str, ...], tmp_path: Path) -> None:
    done = run("demo", *words, str(tmp_path / "all"))
    assert done.returncode == 2
    assert f"--scenes writes all scenes and runs none: omit '{words[0]}'" in done.stderr
    assert not (tmp_path / "all").exists()
