"""What a new user types from habit does what such users expect: Tab, help anywhere, odd paths, watching a scene."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from program import program as run
from shipped import SCENES

from itouch_tools.cli import watch
from itouch_tools.cli.completion import commands

FIRST = str(SCENES / "first_touch.xml")


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The completion scripts, as files."""
    folder = tmp_path_factory.mktemp("shells")
    for shell in ("bash", "zsh", "fish"):
        (folder / shell).write_text(run("completion", shell).stdout)
    return folder


def completed(script: Path, *words: str, cwd: Path | None = None) -> set[str]:
    """Return what Tab offers in bash after some words."""
    given = " ".join(f"'{word}'" for word in ("itouch-py", *words))
    code = f'source {script}; COMP_WORDS=({given}); COMP_CWORD={len(words)}; _itouch_py; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, cwd=cwd, check=True)
    assert not done.stderr
    return set(done.stdout.split("\n")) - {""}


def test_tab_completes_commands_options_values_and_files(scripts: Path, tmp_path: Path) -> None:
    (tmp_path / "my touch.xml").write_text("")
    bash = scripts / "bash"
    assert completed(bash, "che", cwd=tmp_path) == {"check"}
    assert {"check", "run", "thermal", "my touch.xml"} <= completed(bash, "", cwd=tmp_path)
    assert completed(bash, "check", "--str") == {"--strict"}
    assert completed(bash, "run", "--pace", "f", cwd=tmp_path) == {"fast"}
    assert completed(bash, "check", "--color", "", cwd=tmp_path) == {"auto", "always", "never"}
    assert completed(bash, "completion", "", cwd=tmp_path) == {"bash", "zsh", "fish"}
    assert "my touch.xml" not in completed(bash, "study", "", cwd=tmp_path)  # a sub-command, and no file
    assert "my touch.xml" in completed(bash, "study", "run", "", cwd=tmp_path)
    assert "my touch.xml" in completed(bash, "bench", "sweep", "", cwd=tmp_path)
    assert completed(bash, "run", "--report", "my", cwd=tmp_path) == {"my touch.xml"}
    assert "simulate" in completed(bash, "study", "")
    assert completed(bash, "study", "simulate", "--obs") == {"--observers"}
    assert completed(bash, "scene.xml", "--head") == {"--headless"}  # without `run`
    assert completed(bash, "check", "my", cwd=tmp_path) == {"my touch.xml"}
    assert "tick" in completed(bash, "bench", "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_knows_every_command_and_option(scripts: Path, shell: str) -> None:
    text = (scripts / shell).read_text()
    for name, command in commands().items():
        assert name in text
        for option in command.options:
            assert max(option.words, key=len).lstrip("-") in text
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(scripts / shell)], check=True, capture_output=True)


def test_every_command_but_those_without_options_has_a_parser() -> None:
    bare = {name for name, command in commands().items() if not command.options and not command.inner}
    assert bare <= {"bench", "explain", "completion", "schema"}


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ((FIRST, "-h"), 0, "usage: itouch-py run"),
        ((FIRST, "--help"), 0, "--headless"),
        (("help",), 0, "commands:"),
        (("help", "check"), 0, "usage: itouch-py check"),
        (("--version",), 0, "itouch-py "),
        (("-V",), 0, "itouch-py "),
        (("check", FIRST, "--help"), 0, "--quiet"),
    ],
)
def test_help_and_version_are_where_one_looks_for_them(words: tuple[str, ...], code: int, says: str) -> None:
    done = run(*words)
    assert done.returncode == code and says in done.stdout


def test_the_module_can_be_run() -> None:
    done = subprocess.run([sys.executable, "-m", "itouch", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("itouch-py ")


def test_paths_may_have_spaces_umlauts_and_quotes(tmp_path: Path) -> None:
    folder = tmp_path / "Größe & 'Maß' ☃"
    folder.mkdir()
    scene = folder / "erste Berührung.xml"
    shutil.copy(FIRST, scene)
    kept, recording, report = folder / "ein Stand.itouch", folder / "eine Aufnahme.mcap", folder / "ein Bericht.json"
    words = ["--headless", "--for", "0.2s", "--save", str(kept), "--record", str(recording), "--report", str(report)]
    done = run(str(scene), *words)
    assert done.returncode == 0, done.stderr
    assert all(path.stat().st_size for path in (kept, recording, report))
    assert run("check", str(scene)).returncode == 0
    assert run("export", str(recording), "--csv", str(folder / "eine Tafel.csv")).returncode == 0
    assert run("inspect", str(kept)).returncode == 0


def test_an_output_in_a_missing_folder_is_told_before_anything_runs(tmp_path: Path) -> None:
    done = run(FIRST, "--headless", "--record", "none/r.mcap", cwd=tmp_path)
    assert done.returncode == 2 and "there is no folder 'none'; make it first" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_told_in_one_line(tmp_path: Path) -> None:
    done = run(FIRST, "--headless", "--for", "0.1s", "--report", "/dev/full", cwd=tmp_path)
    assert done.returncode == 2 and "No space left on device" in done.stderr and "Traceback" not in done.stderr
    words = [FIRST, "--headless", "--for", "0.1s", "--report", "/dev/full", "--save", str(tmp_path / "s.itouch")]
    assert run(*words).returncode == 2 and (tmp_path / "s.itouch").is_file()


def test_ctrl_c_ends_a_command_that_only_computes_with_one_line(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "itouch", "watch", FIRST]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert process.stdout is not None
    while "Ctrl-C" not in process.stdout.readline():
        pass
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0 and "Traceback" not in said


def test_a_scene_is_checked_at_each_save_and_at_no_other_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, included = tmp_path / "s.xml", tmp_path / "part.xml"
    included.write_text('<itouch version="1.0"/>')
    good, bad = '<itouch version="1.0"><include file="part.xml"/></itouch>', '<itouch version="1.0"><wrld/></itouch>'
    scene.write_text(good)
    saves = iter([None, bad, None, good, None])
    rests: list[float] = []

    def rest(seconds: float) -> None:
        rests.append(seconds)
        text = next(saves)
        if text is not None:
            scene.write_text(text)
            os.utime(scene, ns=(0, time.time_ns() + len(rests)))

    code = watch.follow(
        lambda: watch.say(str(scene), None, None), lambda: watch.stamps(str(scene), None),
        rest=rest, going=lambda: len(rests) < 5,
    )  # fmt: skip
    printed = capsys.readouterr()
    assert printed.out.count("watching") == 3 and printed.err.count("unknown-element") == 1
    assert code == 0
    before = watch.stamps(str(scene), None)
    os.utime(included, ns=(0, 7))
    assert watch.stamps(str(scene), None) != before


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("explain", "T4"), 2, "T4 is a limit: itouch-py explain contact-time tells of it"),
        (("explain", "T2"), 2, "itouch-py explain plate-temperature tells of it"),
        (("explain", "K3"), 2, "itouch-py check SCENE tells of it"),
        (("sweep", "report", "sw"), 2, "commands are: 'check', 'page', 'replay'"),
        (("sweep", "chek", "one.xml"), 2, "did you mean 'check'?"),
        (("explain", "Z4"), 2, "there is no code 'Z4'"),
        (("report", str(SCENES.parent / "README.md"), "-o", "x.html"), 2, "it does not begin as one"),
    ],
)
def test_wrong_codes_and_subcommands_get_an_answer_that_helps(
    words: tuple[str, ...], code: int, said: str, tmp_path: Path
) -> None:
    done = run(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (code, "")
    assert said in done.stderr


def test_no_help_shows_the_markup_of_the_source() -> None:
    from itouch.plugin.discovery import BENCHES, find

    for words in [(name,) for name in commands()] + [("bench", name) for name in find(BENCHES)]:
        assert "``" not in run(*words, "--help").stdout, words


def test_view_says_that_no_session_is_running(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("itouch.servo.sessions", list)
    done = run("view", "--list")
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == "no session is running\n"
