"""Fixtures for all tests: scenes in a temporary folder, and a catalog with devices of the tests' own."""

from __future__ import annotations

import gc
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from forms import (  # noqa: F401  - hooks
    pytest_addoption,
    pytest_configure,
    pytest_configure_node,
    pytest_runtest_logreport,
    pytest_runtest_makereport,
    pytest_sessionfinish,
    pytest_terminal_summary,
    pytest_testnodedown,
)
from forms import pytest_collection_modifyitems as _choose
from hypothesis import HealthCheck, settings
from shipped import SCENES

# a machine may be busy with other work: how long an example takes says nothing
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.load_profile("any machine")

# started in the background by a shell, Ctrl-C is ignored here, and so by every program that a test starts
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: The files that take longest, longest first, as a worker that began one of them last would be waited for; between them
#: those that wait for clocks and wires, so that one worker waits while the others compute.
LONGEST = (
    "test_exchanged", "test_only_path", "test_emulator_suites", "test_matrix", "test_four_materials",
    "test_bad_answers_of_a_t7", "test_bench_surface", "test_every_entrance", "test_tmcl", "test_wires_in_use",
    "test_deaths", "test_protections", "test_outside_plugin", "test_launch", "test_session_baud", "test_laws_of_a_stop",
    "test_laws", "test_rigs_with_habits", "test_shelves", "test_faults_in_flight", "test_strange_instruments",
    "test_limits_everywhere", "test_live_window", "test_external_control", "test_harm_from_inside", "test_own_guardian",
    "test_sweeping", "test_hanging_process", "test_restore", "test_thermal_drivers", "test_listeners_in_a_stop",
    "test_house", "test_irregular_timing", "test_compiling", "test_shipped", "test_busy_can_bus", "test_outside_monitor",
    "test_sequence", "test_operator_commands", "test_joined", "test_device_suite", "test_from_recordings",
    "test_no_name_decides", "test_reproduce", "test_estimator", "test_layouts",
)  # fmt: skip


#: Compiles what most tests need, in one process: what is not kept by itself, as it is part of what is, is compiled once.
MOST = """
import numpy as np
from itouch.contact import Box, Friction, Geometry, Proxy, Surface
from itouch.contact.step import step
from itouch.servo.prepare import prepare

for name in ("four_materials", "mesh", "four_materials_wire", "moving", "texture_and_sound"):
    prepare(f"{name}.xml", seed=0, twin=None, rig=None)
proxy = Proxy(Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
proxy.step([0.0, 0.0, 1.0])
proxy.follow([[0.0, 0.0, 1.0]])
box = Geometry.build([Box((1.0, 1.0, 1.0))], [Friction(0.0, 0.0)])
pose = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
step(box.world, None, pose, np.zeros((1, 6)), np.ones(1), np.zeros(3), 0.1, 0.1, box.new_memory(), box.new_result())
"""


@pytest.fixture(scope="session", autouse=True)
def unwatched() -> Generator[None]:
    """Drive fake hardware here without a guardian, which could not open it: tests/servo/test_own_guardian.py has one."""
    from itouch.session import Session

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Session, "GUARDIAN", "unwatched:watch")
        yield


@pytest.fixture(scope="session", autouse=True)
def together(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Generator[None]:
    """Compile what workers need at the same time in one of them; the others wait for it."""
    from itouch.compiling import compile_together

    if worker_id != "master":
        place = tmp_path_factory.getbasetemp().parent / "compiling"
        place.mkdir(exist_ok=True)
        compile_together(place)
    yield
    compile_together(None)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let every other worker go through the folders from the last: what one has read of a file, the other finds kept."""
    report = yield
    number = getattr(collector.config, "workerinput", {}).get("workerid", "gw0").removeprefix("gw")
    if isinstance(collector, pytest.Directory) and int(number) % 2:
        report.result = list(report.result or ())[::-1]
    return report


@pytest.hookimpl(tryfirst=True)  # before the groups are read
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files that take longest; a file's tests share a worker (pyproject.toml), as they share fixtures."""
    longest = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (longest.get(item.path.stem, len(longest)), item.path))
    _choose(config, items)


#: What compiles before the tests, while it does.
_compiling: list[subprocess.Popen[bytes]] = []


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile what most tests need once, as a first start does, before the workers of a whole run would do so each."""
    config = session.config
    if config.args_source is config.ArgsSource.TESTPATHS and config.getoption("numprocesses", None):
        _compiling.append(subprocess.Popen([sys.executable, "-c", MOST], cwd=SCENES))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished() -> None:
    """Give out no test before that is over; the workers have collected meanwhile, where a core was idle."""
    while _compiling:
        try:
            _compiling[-1].wait(600.0)
        except subprocess.TimeoutExpired:  # the tests compile it themselves then, each worker on its own
            print("compiling before the tests did not end in 600 s", file=sys.stderr)
        _end_compiling()


def _end_compiling() -> None:
    while _compiling:
        process = _compiling.pop()
        process.kill()
        process.wait()


def pytest_unconfigure() -> None:
    """Leave nothing that compiles behind, though no test was collected."""
    _end_compiling()


def pytest_collection() -> None:
    """Collect thousands of tests without looking for garbage among them; not one of them is."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over thousands of tests, and look seldom for what a test leaves in circles."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
    gc.enable()


@pytest.fixture(scope="class", autouse=True)
def passed_over(request: pytest.FixtureRequest) -> None:
    """Let the collector pass over what is there, too, where the conformance suite collects after every step."""
    if hasattr(request.cls, "test_allocates_nothing"):
        gc.collect()
        gc.freeze()


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """Return a copy of the shipped scenes that a test may change."""
    folder = tmp_path / "scenes"
    shutil.copytree(SCENES, folder)
    return folder


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    """Return a function that writes a file into the test's folder."""

    def put(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return put
