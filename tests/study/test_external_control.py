"""A study that another program leads: a real process, its client, and a raw socket as Matlab has one."""

from __future__ import annotations

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from requirements import meant
from run_scene import write_study

from itouch_tools.study import client
from itouch_tools.study.client import ServedError, connect
from itouch_tools.study.server import MOST, StudyServer, StudyServerError

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason=meant("processes are ended by signals"))


class Other:
    """A program that is served by a process of its own."""

    def __init__(self, folder: Path, *more: str, elements: str = "") -> None:
        self.study, self.key = write_study(folder, more=elements), folder / "study.key.json"
        command = [sys.executable, "-m", "itouch_tools.cli", "study", "serve", str(self.study), *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert self.process.stdout is not None
        self.said = self.process.stdout.readline()
        assert "is served on port" in self.said, self.said + self.process.stdout.read()

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Other]:
    """One process for all that look at it and leave it as it was: time goes on only while they wait."""
    other = Other(tmp_path_factory.mktemp("served"), "--pace", "fast")
    yield other
    try:
        with connect(other.key) as touch:
            touch.stop()
        assert other.process.wait(300.0) == 0
        assert not other.key.exists()
    finally:
        other.end()


class Raw:
    """A plain socket: what any language has."""

    def __init__(self, key: Path) -> None:
        told = json.loads(key.read_text())
        self.token = str(told["token"])
        self.line = socket.create_connection((told["host"], told["port"]), timeout=600.0)
        self.stream = self.line.makefile("rb")

    def __enter__(self) -> Raw:
        return self

    def __exit__(self, *exception: object) -> None:
        self.stream.close()
        self.line.close()

    def send(self, text: bytes) -> None:
        self.line.sendall(text)

    def say(self, **content: Any) -> Any:
        self.send(json.dumps(content).encode() + b"\n")
        return self.hear()

    def hear(self) -> Any:
        line = self.stream.readline()
        return json.loads(line) if line else None


def test_a_client_sets_waits_reads_and_marks(served: Other) -> None:
    with connect(served.key) as touch:
        told = touch.describe()
        assert told["factors"] == {"material": ["wood", "steel", "cork"]}
        assert (told["object"], told["pace"]) == ("block", "fast")
        forces = {}
        for material in ("steel", "cork", "steel"):
            assert touch.set(material=material)["levels"] == {"material": material}
            assert touch.now()["touched"] is None
            before = touch.now()["seconds"]
            assert touch.now()["seconds"] == before  # nobody waits: time stands still
            touch.go()
            assert touch.wait_contact(5.0)
            pressed = touch.wait("seconds", 0.08)
            assert len(repr(pressed["seconds"])) <= 9  # no digits of binary fractions
            assert pressed["touched"] == "block"
            assert pressed["force_N"] > 0.1
            with pytest.raises(ServedError, match="while something is touched") as caught:
                touch.set(material="wood")
            assert caught.value.code == "in-contact"
            with pytest.raises(ServedError, match="has not ended"):
                touch.felt()
            assert touch.wait_release(5.0)
            felt = touch.felt(samples=True)
            assert felt["void"] == ""
            forces.setdefault(material, []).append(felt["peak_force_N"])
            assert touch.mark("answer", {"key": "left"}) == touch.now()["seconds"] > before
        assert forces["steel"][0] > forces["cork"][0]
        assert forces["steel"][1] == pytest.approx(forces["steel"][0], abs=0.02)


def test_what_is_asked_wrongly_is_refused_in_a_sentence(served: Other) -> None:
    with connect(served.key) as touch:
        for ask, code, said in (
            (lambda: touch.set(material="oak"), "unknown-level", "wood, steel, cork"),
            (lambda: touch.set(colour="red"), "unknown-factor", "it varies material"),
            (lambda: touch.wait("rain"), "unknown-word", "ready, contact, release"),
            (lambda: touch.wait("contact", -1.0), "bad-number", "0 to 3600"),
            (lambda: touch.wait_skin(33.0), "no-skin", "measures"),
            (lambda: touch.mark(""), "refused", "printable"),
            (lambda: touch.mark("\ud800"), "refused", "a mark's name is 1 to 32 bytes of printable text"),
            (lambda: touch._ask("dance"), "unknown-word", "describe, set, go"),
        ):
            with pytest.raises(ServedError, match=said) as caught:
                ask()
            assert caught.value.code == code
        assert touch.wait("contact", 0.05)["met"] is False  # nobody gave the signal


def test_a_combination_that_the_study_leaves_out_is_refused(tmp_path: Path) -> None:
    sizes = '<factor name="size" levels="small;large" values="40 40 20 mm;60 60 20 mm" set="block.size"/>'
    other = Other(tmp_path, "--pace", "fast", elements=f'{sizes}<exclude where="material=cork size=large"/>')
    try:
        with connect(other.key) as touch:
            assert touch.set(material="cork")["levels"] == {"material": "cork", "size": "small"}
            for levels in ({"size": "large"}, {"material": "cork", "size": "large"}):
                with pytest.raises(ServedError, match="leaves out 'material=cork size=large'") as caught:
                    touch.set(**levels)
                assert caught.value.code == "excluded"
            assert touch.describe()["levels"] == {"material": "cork", "size": "small"}
            told = touch.set(material="wood", size="large")["levels"]  # past the one that is left out
            assert told == {"material": "wood", "size": "large"}
    finally:
        other.end()


def test_any_language_speaks_the_lines(served: Other) -> None:
    with Raw(served.key) as raw:
        assert raw.say(token=raw.token) == {"itouch": 1}
        # several lines at once are answered one after the other, each with its number
        raw.send(b'{"do":"set","levels":{"material":"cork"},"id":"a"}\n{"do":"go","id":"b"}\n{"do":"wait",')
        raw.send(b'"for":"contact","id":"c"}\n{"do":"wait","for":"release","id":"d"}\n{"do":"felt","id":"e"}\n')
        told = [raw.hear() for _ in range(5)]
        assert [one["id"] for one in told] == ["a", "b", "c", "d", "e"]
        assert told[2]["met"] and told[3]["met"]
        assert told[4]["figures"]["peak_force_N"] > 0.1
        endless = b'{"do":"now","id":' + b"[" * 400 + b"]" * 400 + b"}\n"
        for wrong in (b"dance\n", b"[1]\n", b'{"do":3}\n', b"\xff\xfe\n", b'{"do":"set"}\n',
                      b'{"do":"now","id":NaN}\n', b'{"do":"now","id":1e999}\n', endless):  # fmt: skip
            raw.send(wrong)
            assert raw.hear()["error"]["code"] == "bad-line"
        assert raw.say(do="now", id=2.5)["id"] == 2.5
        assert "id" not in raw.say(do="now")


@pytest.mark.parametrize(
    "said",
    [b'{"token":"wrong"}\n', b'{"do":"now"}\n', b'{"token":7}\n', b"GET / HTTP/1.1\r\n\r\n", b'{"token":"\\ud800"}\n'],
)
def test_without_the_key_nobody_comes_in(served: Other, said: bytes) -> None:
    with Raw(served.key) as raw:
        raw.send(said)
        assert raw.hear()["error"]["code"] == "no-key"
        assert raw.hear() is None  # hung up


def test_the_key_is_for_this_user_alone(served: Other) -> None:
    assert stat.S_IMODE(served.key.stat().st_mode) == 0o600
    assert json.loads(served.key.read_text())["host"] == "127.0.0.1"
    assert json.loads(served.key.read_text())["token"] not in served.said
    with pytest.raises(StudyServerError, match="is being served"):
        StudyServer(served.key)
    with pytest.raises(StudyServerError, match="cannot listen on port"):
        StudyServer(served.key.with_name("other.json"), json.loads(served.key.read_text())["port"])
    with pytest.raises(ServedError, match="holds no key"):
        connect(served.key.with_name("nothing.json"))


def test_a_line_without_an_end_and_too_many_are_hung_up_on(served: Other) -> None:
    with Raw(served.key) as endless:
        assert endless.say(token=endless.token) == {"itouch": 1}
        with pytest.raises(OSError):  # reset or broken pipe, as the system likes
            while True:
                endless.send(b"x" * 65536)
    with connect(served.key) as touch:
        assert touch.describe()["study"] == "study"


def test_strangers_who_say_nothing_keep_nobody_out(tmp_path: Path) -> None:
    with StudyServer(tmp_path / "key.json") as server:
        known = socket.create_connection(("127.0.0.1", server.port), timeout=600.0)
        known.sendall(json.dumps({"token": json.loads((tmp_path / "key.json").read_text())["token"]}).encode() + b"\n")
        while not any(caller.known for caller in server.callers):
            server.look(0.1)
        silent = []
        for _ in range(3 * MOST):
            silent.append(socket.create_connection(("127.0.0.1", server.port), timeout=600.0))
            server.look(1.0)
        assert len(server.callers) == MOST
        assert sum(caller.known for caller in server.callers) == 1
        late = socket.create_connection(("127.0.0.1", server.port), timeout=600.0)
        late.sendall(json.dumps({"token": json.loads((tmp_path / "key.json").read_text())["token"]}).encode() + b"\n")
        for _ in range(4):
            server.look(1.0)
        assert sum(caller.known for caller in server.callers) == 2
        for line in (known, late, *silent):
            line.close()


def test_who_asks_without_an_end_costs_no_tick(served: Other) -> None:
    """The numbers that another one reads are those that it reads alone."""

    def waited(touch: client.Touch) -> float:
        touch.set(material="wood")
        before = float(touch.now()["seconds"])
        touch.go()
        touch.wait("contact", 5.0)
        return round(float(touch.wait("release", 5.0)["seconds"]) - before, 6)

    with connect(served.key) as touch, Raw(served.key) as flood:
        alone = waited(touch)
        assert flood.say(token=flood.token) == {"itouch": 1}
        flood.send(b'{"do":"now"}\n' * 3000)
        assert waited(touch) == alone


_LEADS = """
import sys
from itouch_tools.study.client import connect
touch = connect(sys.argv[1])
touch.set(material="wood")
print("waits", flush=True)
touch.wait("contact", 600.0)
"""


def test_in_real_time_killed_clients_cost_nothing_and_a_signal_ends_all(tmp_path: Path) -> None:
    other = Other(tmp_path)
    try:
        leader = subprocess.Popen([sys.executable, "-c", _LEADS, str(other.key)], stdout=subprocess.PIPE, text=True)
        assert leader.stdout is not None
        assert leader.stdout.readline() == "waits\n"
        leader.kill()
        leader.wait()
        leader.stdout.close()
        with connect(other.key) as touch:
            first = touch.now()
            time.sleep(0.05)
            assert touch.now()["seconds"] > first["seconds"]  # time goes on by itself
            assert touch.describe()["levels"] == {"material": "wood"}
            assert touch.touch(60.0)["void"] == ""
            os.kill(other.process.pid, signal.SIGTERM)
            with pytest.raises(ServedError) as caught:
                touch.wait("contact", 600.0)
            assert caught.value.code in ("ended", "lost")
        assert other.process.wait(300.0) == 128 + signal.SIGTERM
        assert not other.key.exists()
    finally:
        other.end()


def test_the_client_needs_the_standard_library_alone(tmp_path: Path, served: Other) -> None:
    """It is copied beside an experiment, where nothing of this package is."""
    source = Path(str(client.__file__)).read_text()
    (tmp_path / "touch_client.py").write_text(source)
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\nimport touch_client\n"
        "assert not any(name.startswith(('itouch', 'numpy')) for name in sys.modules)\n"
        "with touch_client.connect(sys.argv[2]) as touch:\n    print(touch.describe()['study'])\n"
    )
    words = [sys.executable, "-S", "-I", "-c", code, str(tmp_path), str(served.key)]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == "study\n"
