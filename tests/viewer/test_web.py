"""A session in a browser: what the library is sent, by a client of our own; who may look; Chromium in the long form."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from program import program
from shipped import SCENES

import itouch
from itouch.plugin import poses
from itouch_tools.viewer.colours import of_temperature
from itouch_tools.viewer.scene_graph import SceneGraph
from itouch_tools.viewer.temperatures import plate_temperature
from itouch_tools.viewer.web import Access
from itouch_tools.viewer.web.access import COOKIE, Gate, Request
from itouch_tools.viewer.web.browser_scene import BrowserScene

viser = pytest.importorskip("viser")
import msgspec  # noqa: E402
import zstandard  # noqa: E402
from websockets.exceptions import InvalidStatus  # noqa: E402
from websockets.sync.client import ClientConnection, connect  # noqa: E402

TOKEN = "a-token-of-22-letters_"


class Client:
    """What a browser is: it keeps every node of the scene as it was told last."""

    def __init__(self, line: ClientConnection) -> None:
        self._line = line
        self.nodes: dict[str, dict[str, Any]] = {}
        self.words = ""

    def until(self, words: str) -> None:
        """Take messages until the words beside the picture are these: they are told last."""
        while self.words != words:
            data = self._line.recv(timeout=600)
            assert isinstance(data, bytes)
            size = int.from_bytes(data[8:16], "little")
            whole = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
            at, buffers = 16 + size, []
            for length in whole["binaryBufferLengths"]:
                at += -at % 8
                buffers.append(data[at : at + length])
                at += length
            for message in whole["messages"]:
                self._take(message, buffers)

    def _take(self, message: dict[str, Any], buffers: list[bytes]) -> None:
        name, kind = message.get("name"), message["type"]
        if kind in ("SetPositionMessage", "SetOrientationMessage", "SetSceneNodeVisibilityMessage"):
            self.nodes.setdefault(name, {}).update({k: v for k, v in message.items() if k not in ("type", "name")})
        elif kind == "SceneNodeUpdateMessage" or "props" in message and name is not None:
            found = message.get("updates") or message["props"]
            for key, value in found.items():
                if isinstance(value, dict) and "__binary_index" in value:
                    found[key] = np.frombuffer(
                        buffers[value["__binary_index"]], np.float32 if key == "points" else "u1"
                    )
            self.nodes.setdefault(name, {}).update(found)
        elif kind == "GuiUpdateMessage":
            self.words = message["updates"].get("_markdown", self.words)

    def pose(self, path: str) -> NDArray[np.float64]:
        """Return the pose (7,) of a node in the world: as told, below what it stands under."""
        found = np.array([0, 0, 0, 1, 0, 0, 0], float)
        parts = path.strip("/").split("/")
        for count in range(1, len(parts) + 1):
            node = self.nodes.get("/" + "/".join(parts[:count]), {})
            own = np.array([*node.get("position", (0, 0, 0)), *node.get("wxyz", (1, 0, 0, 0))], float)
            found = poses.compose(found, own)
        return found

    def path(self, last: str) -> str:
        """Return the path of the node of this name."""
        return next(path for path in self.nodes if path.endswith("/" + last))


class Served:
    """A gate before the library's server, in a thread, as `view --web` has it in its process."""

    def __init__(self, inner: tuple[str, int], token: str = "") -> None:
        self._ready, self._loop = threading.Event(), asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(inner, token),))
        self._thread.start()
        assert self._ready.wait(300)

    async def _run(self, inner: tuple[str, int], token: str) -> None:
        self._end = asyncio.Event()
        async with Gate(Access(port=0, token=token), inner) as gate:
            self.port = gate.port
            self._ready.set()
            await self._end.wait()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(300)
        self._loop.close()

    def ask(self, target: str = "/", **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body of a request that a browser makes."""
        import http.client

        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=600)
        line.request("GET", target, headers=headers)
        answer = line.getresponse()
        found = answer.status, dict(answer.getheaders()), answer.read()
        line.close()
        return found

    def look(self, **headers: str) -> ClientConnection:
        return connect(f"ws://127.0.0.1:{self.port}", subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
                       additional_headers=headers, compression=None, max_size=None)  # fmt: skip


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    from itouch_tools.viewer.web.session_stream import _server

    with _server("a session") as found:
        yield found


@pytest.fixture(scope="module")
def served(server: Any) -> Iterator[Served]:
    found = Served((server.get_host(), server.get_port()))
    yield found
    found.close()


@pytest.mark.parametrize(
    ("scene", "steps"), [("four_materials_hurried.xml", 3), ("first_touch.xml", 4), ("moving.xml", 2)]
)
def test_what_is_sent_is_where_the_state_says(scene: str, steps: int, server: Any, served: Served) -> None:
    from itouch_tools.viewer.web.browser_scene import BrowserScene

    server.scene.reset()
    server.gui.reset()
    engine = itouch.build(SCENES / scene)
    browser_scene = BrowserScene(server, engine.model, engine.state)
    pushed = 0
    with served.look() as line:
        client = Client(line)
        for step in range(steps):
            engine.run(0.5)
            browser_scene.show(engine.state, f"step {step}")
            client.until(f"step {step}")
            state = engine.state
            for index, name in enumerate(engine.model.objects):
                found = [path for path in client.nodes if path.endswith(f"object:{name}")]
                near = min(np.abs(client.pose(path) - state["objects.pose"][index]).max() for path in found)
                assert near < 1e-6, name
            for probe in engine.model.probes:
                for part in ("hip", "proxy"):
                    place = client.pose(client.path(f"{probe.name}:{part}"))[:3]
                    assert np.abs(place - state[f"{probe.name}.{part}"]).max() < 1e-6
                arrow, force = client.nodes[client.path(f"{probe.name}:force")], state[f"{probe.name}.contact_force"]
                size = float(np.linalg.norm(force))
                assert arrow["visible"] == (size >= 0.01)
                if arrow["visible"]:
                    pushed += 1
                    tip = arrow["points"].reshape(2, 3)[1]
                    assert tip == pytest.approx(force / size * min(0.08, 0.02 * size), abs=1e-6)
            for name, device in engine.model.devices.items():
                matrix, found_pose = (
                    SceneGraph(engine.model).place(state, device),
                    client.pose(client.path(f"device:{name}")),
                )
                assert np.abs(found_pose[:3] - matrix[:3, 3]).max() < 1e-6
                assert np.abs(poses.matrix(found_pose[3:].tolist()) - matrix[:3, :3]).max() < 1e-6
        if scene == "four_materials_hurried.xml":
            label = client.nodes[client.path("peltier:temperature")]["text"]
            kelvin = plate_temperature(engine.state, engine.model.devices["peltier"])
            assert kelvin is not None and label == f"{kelvin - 273.15:.1f} °C"
            face = client.nodes[client.path("peltier:face")]["color"]
            assert tuple(face) == pytest.approx([255 * part for part in of_temperature(kelvin)], abs=2)
    assert pushed > 0 or scene != "first_touch.xml"
    engine.close()


def test_a_browser_begins_with_everything_in_the_picture() -> None:
    """The camera looks at the middle, also of a scene that lies beside the origin."""
    session = itouch.build(SCENES / "two_fingers.xml")
    low, high = SceneGraph(session.model).bounds(session.state)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    assert np.abs(middle).max() > 1e-3, "it would be in the middle anyway"
    server: Any = SimpleNamespace(initial_camera=SimpleNamespace(), scene=mock.MagicMock())
    itself: Any = SimpleNamespace(_model=session.model, _server=server)
    BrowserScene._look(itself, session.state)
    assert server.initial_camera.look_at == pytest.approx(middle)
    assert 0.6 * size < np.linalg.norm(server.initial_camera.position - middle) < 2.0 * size


def test_a_browser_that_comes_later_sees_the_same_and_a_still_session_sends_nothing(
    server: Any, served: Served
) -> None:
    from itouch_tools.viewer.web.browser_scene import BrowserScene

    server.scene.reset()
    server.gui.reset()
    engine = itouch.build(SCENES / "first_touch.xml")
    browser_scene = BrowserScene(server, engine.model, engine.state)
    engine.run(0.5)
    browser_scene.show(engine.state, "there")
    with served.look() as line:
        client = Client(line)
        client.until("there")
        finger = engine.model.probes[0].name
        assert client.pose(client.path(f"{finger}:hip"))[:3] == pytest.approx(engine.state[f"{finger}.hip"], abs=1e-6)
        browser_scene.show(engine.state, "there")
        with pytest.raises(TimeoutError):
            line.recv(timeout=0.3)
    engine.close()


def test_nothing_that_a_browser_says_opens_a_way_to_the_internet(
    server: Any, served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Any] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *about: opened.append(about))
    asked = threading.Event()
    before = server.request_share_url
    monkeypatch.setattr(server, "request_share_url", lambda: (before(), asked.set()))
    with served.look() as line:
        line.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        assert asked.wait(300)
    assert not opened


def test_a_page_of_another_address_is_not_answered(served: Served) -> None:
    assert served.ask()[0] == 200
    assert served.ask(Host=f"localhost:{served.port}")[0] == 200
    assert served.ask(Host="evil.example")[0] == 403  # a name of theirs that leads to this machine
    assert served.ask(Host=f"evil.example:{served.port}")[0] == 403
    with pytest.raises(InvalidStatus, match="403"):
        served.look(Origin="http://evil.example")


def test_other_machines_show_the_token(server: Any) -> None:
    gate = Served((server.get_host(), server.get_port()), TOKEN)
    try:
        assert gate.ask(Host="lab.example:8080")[0] == 401
        assert gate.ask("/?token=another", Host="lab.example:8080")[0] == 401
        status, headers, _ = gate.ask(f"/?token={TOKEN}", Host="lab.example:8080")
        assert status == 303 and headers["Location"] == "/" and "HttpOnly" in headers["Set-Cookie"]
        kept = headers["Set-Cookie"].partition(";")[0]
        assert gate.ask(Host="lab.example:8080", Cookie=kept)[0] == 200
        with pytest.raises(InvalidStatus, match="401"):
            gate.look()
        with gate.look(Cookie=kept):
            pass
    finally:
        gate.close()


@settings(max_examples=25)
@given(st.text(max_size=12), st.text(max_size=12), st.text(alphabet="abc:.[]0", max_size=9), st.booleans())
def test_without_the_token_nothing_passes(cookie: str, shown: str, host: str, near: bool) -> None:
    headers = {"host": "localhost" if near else host, "cookie": f"{COOKIE}={cookie}"}
    refused = Gate(Access("0.0.0.0", 0, TOKEN), ("", 0)).refusal(Request(f"/?token={shown}", headers, b""))
    assert refused is not None and refused.startswith(b"HTTP/1.1 401")


def test_what_is_no_request_of_a_browser_harms_nothing(served: Served) -> None:
    import socket

    for words in (b"\0\1\2\r\n\r\n", b"POST / HTTP/1.1\r\n\r\n", b"x" * 40_000, b"GET /\r\n\r\n", b""):
        with socket.create_connection(("127.0.0.1", served.port), timeout=600) as line:
            try:
                line.sendall(words)
                line.shutdown(socket.SHUT_WR)
                assert b"200" not in line.recv(100)
            except OSError:
                pass  # it was cut off while it still spoke
    assert served.ask()[0] == 200


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--web", "--host", "0.0.0.0"), "say with --token TEXT"),
        (("--web", "--token", "short"), "so that nobody guesses it"),
        (("--web", "--port", "70000"), "a port is 0 to 65535"),
        (("--port", "8080"), "go with --web"),
        (("none-of-this-name", "--web"), "no running session named"),
    ],
)
def test_what_can_not_be_shown_is_said(words: tuple[str, ...], said: str) -> None:
    done = program("view", *words)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr


@pytest.mark.long
def test_chromium_shows_it_and_dies_and_hangs_and_the_loop_goes_on(tmp_path: Path) -> None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "report"))
    from browser import Browser, need_chromium

    handle = itouch.launch(SCENES / "four_materials_hurried.xml", linger=True, seconds=900.0)
    words = [sys.executable, "-m", "itouch_tools.cli", "view", handle.link.name, "--web", "--port", "0"]
    view = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert view.stdout is not None
        address = view.stdout.readline().strip()
        for round_ in range(2):
            browser = Browser(need_chromium())
            browser.go(address, width=1280, height=800)
            _until(lambda seen=browser: f"{handle.link.name}\n" in seen.run("document.body.innerText"), 90)
            if round_ == 0:
                _until(lambda: handle.link.state["finger.object"] >= 0, 60)  # for the picture: it touches something
                _until(lambda seen=browser: _bright(seen, tmp_path / "web.png"), 60)  # the library's scene fades in
                assert all(asked.split("/")[2].startswith("localhost:") for asked in browser.asked), browser.asked
                browser.signal(signal.SIGKILL)
                browser.close()
                continue
            browser.signal(signal.SIGSTOP)
            tick = handle.link.tick
            _until(lambda before=tick: handle.link.tick > before + 3000, 60)
            browser.signal(signal.SIGCONT)
            browser.close()
        assert view.poll() is None and handle.running
        os.kill(view.pid, signal.SIGINT)
        assert view.wait(300) == 0 and handle.running
        assert json.dumps(handle.report()["faults"]) == "[]"
    finally:
        view.kill()
        view.wait()
        if view.stdout is not None:
            view.stdout.close()
        handle.close()


@pytest.mark.long
def test_the_bench_watches_the_loop_beside_a_browser() -> None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "report"))
    from browser import need_chromium

    from itouch_evidence import viewer_servo
    from itouch_evidence.viewer_web import Browsers

    need_chromium()
    rows = viewer_servo.measure(0.3, 1, browsers=Browsers)
    assert [row.situation for row in rows] == [
        viewer_servo.NONE, viewer_servo.THERE, viewer_servo.KILLED, viewer_servo.FROZEN,
    ]  # fmt: skip
    assert all(row.ticks > 0 and row.late.sum() == row.ticks for row in rows) and rows[2].reopened >= 1


def _until(true: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.1)


def _bright(browser: Any, path: Path) -> bool:
    """Say whether something is lit in the middle of the picture, where the scene is."""
    browser.shoot(path)
    from PIL import Image

    with Image.open(path) as picture:
        middle = np.asarray(picture.convert("L"))[300:560, 380:860]
    return bool((middle > 90).mean() > 0.15)
