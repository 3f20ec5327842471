"""Fixtures for all tests: scenes in a temporary folder, and a catalog with devices of the tests' own."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from forms import (  # noqa: F401  - hooks
    pytest_addoption,
    pytest_collectreport,
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
from punctuality import pytest_runtest_protocol  # noqa: F401  - a hook
from shipped import SCENES

# a machine may be busy with other work: how long an example takes says nothing
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.load_profile("any machine")

# started in the background by a shell, Ctrl-C is ignored here, and so by every program that a test starts; below nohup,
# the end of a terminal
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

#: The files that take long and need nothing compiled: one worker begins with them while the others wait for that.
UNCOMPILED = (
    "test_single_hardware_path", "test_t7_bad_answers", "test_repository_rules", "test_no_hardcoded_names",
    "test_line_protocol_variants", "test_session_baud", "test_instrument_protocol_variants", "test_array_docstrings",
    "test_busy_can_bus", "test_thread", "test_editors", "test_power_and_exports", "test_study", "test_links",
    "test_units_oracle", "test_tec_controller_refusals", "test_moteus", "test_falcon_fault_matrix",
    "test_falcon_faults", "test_falcon_usb", "test_blind_retreat_legs", "test_serialport", "test_sweep_benches",
    "test_pages", "test_bounded_memory", "test_mutation", "test_gltf_oracle", "test_bench_wire", "test_sweep_store",
    "test_tmcl_protocol_variants", "test_servo_protocol_variants", "test_falcon_protocol_variants", "test_plans",
    "test_parameters", "test_dataclasses", "test_single_importer_modules", "test_duplicate_constants",
    "test_plugins_import",
)  # fmt: skip

#: The files that take longest, longest first, as a worker that began one of them last would be waited for; between them
#: those that wait for clocks and wires, so that one worker waits while the others compute.
LONGEST = (
    "test_fault_matrix_over_exchanges", "test_emulator_suites", "test_fault_matrix", "test_four_materials",
    "test_rearming", "test_bench_surface", "test_commands_with_renamed_channels", "test_stop_during_device_opening",
    "test_study_on_hardware", "test_tmcl", "test_wires_in_use", "test_process_deaths", "test_recorder",
    "test_attack_regressions", "test_protections", "test_third_party_plugin", "test_launch", "test_blind_retreat_laws",
    "test_laws", "test_package_layers", "test_device_opening", "test_progress", "test_restore_with_active_faults",
    "test_limits_after_restore", "test_servo_stale_answers", "test_device_motion_after_stop", "test_live_window",
    "test_external_control", "test_harmful_plugin_code", "test_guardian_for_scripts",
    "test_contact_handover_continuity", "test_realtime_commands", "test_sweeping", "test_hanging_process",
    "test_command_options", "test_restore", "test_gc_policy", "test_memory", "test_thermal_drivers",
    "test_listener_errors_during_stop", "test_irregular_timing", "test_compiling", "test_shipped", "test_sequence",
    "test_operator_commands", "test_compiled_equals_python", "test_device_suite", "test_continue_from_recording",
    "test_reproduce", "test_estimator", "test_state_layout_changes",
)  # fmt: skip


#: Compiles what most tests need, in two processes: what is part of what is kept, and not kept by itself, is compiled once.
MOST = """
import os, subprocess, sys
place = os.environ["ITOUCH_TESTS_COMPILE"]
ahead = [sys.executable, "-m", "itouch.servo.compile_ahead", "four_materials.xml"]  # from the last to the first
beside = subprocess.Popen([*ahead, "--parent", str(os.getpid()), "--together", place], close_fds=True)

from pathlib import Path
import numpy as np
from itouch.compiling import compile_together
from itouch.contact import Box, Friction, Geometry, Proxy, Surface
from itouch.contact.step import step
from itouch.plugin import Bound
from itouch.plugin.geometry import FOUND, proxy_step
from itouch.servo import prepare as companions
from itouch.servo.prepare import prepare

compile_together(Path(place))
companions._COMPANIONS = 0  # each would begin anew with every scene

for name in ("four_materials", "mesh", "four_materials_wire", "moving", "texture_and_sound"):
    prepare(f"{name}.xml", seed=0, twin=None, rig=None)
beside.kill()
beside.wait()
proxy = Proxy(Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
proxy.step([0.0, 0.0, 1.0])
proxy.follow([[0.0, 0.0, 1.0]])
box = Geometry.build([Box((1.0, 1.0, 1.0))], [Friction(0.0, 0.0)])
pose = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
step(box.world, None, pose, np.zeros((1, 6)), np.ones(1), np.zeros(3), 0.1, 0.1, box.new_memory(), box.new_result())
read = [pose, np.zeros((1, 6)), np.ones(1), np.zeros(3)]
for array in read:
    array.flags.writeable = False
for shapes in (proxy.geometry, box):  # as a modality that computes contact calls it
    own = shapes.new_memory(), np.zeros(FOUND), shapes.new_scratch()
    call = Bound(proxy_step, shapes.world, shapes.mesh, *read, 0.1, 0.1, *own)
    call()
    call.join()
"""


@pytest.fixture(scope="session", autouse=True)
def no_guardian() -> Generator[None]:
    """Give fake hardware no guardian, which cannot open it: tests/servo/test_guardian_for_scripts.py has one."""
    from itouch.session import Session

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Session, "GUARDIAN", "no_guardian:watch")
        yield


@pytest.fixture(scope="session", autouse=True)
def together(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Generator[Path | None]:
    """Compile nothing that another worker is compiling already, but wait for it; the folder in which they say what."""
    from itouch.compiling import compile_together
    from itouch.servo import prepare

    place = None
    with pytest.MonkeyPatch.context() as patched:
        if worker_id != "master":
            place = Path(os.environ.get(TOGETHER) or tmp_path_factory.getbasetemp().parent / "compiling")
            place.mkdir(exist_ok=True)
            compile_together(place)
            # the workers are as many as the processors: who helps a start only takes from them, in a place of its own
            patched.setattr(prepare, "_COMPANIONS", 0)
        yield place
    compile_together(None)


@pytest.fixture(autouse=True)
def again_together(together: Path | None) -> None:
    """Compile together again, after a test in which this process has compiled with others, or alone."""
    from itouch import compiling

    if compiling._together != together:
        compiling.compile_together(together)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin when what most tests need is compiled, but in the worker that is given what needs nothing compiled."""
    global _begun
    if not _begun and TOGETHER in os.environ and item.path.stem not in UNCOMPILED:
        _wait_for_most(Path(os.environ[TOGETHER]))
    _begun = True


_begun = False


def _wait_for_most(place: Path) -> None:
    """Return when the process that compiles ``MOST`` has ended: it holds a lock as long as it lives."""
    limit = time.monotonic() + 600.0
    with open(place / "most", "ab") as held:
        while time.monotonic() < limit:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            time.sleep(0.1)
    print("compiling before the tests did not end in 600 s", file=sys.stderr)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let each worker begin with other folders: what one has read and rewritten of a file, the others find kept."""
    report = yield
    given = getattr(collector.config, "workerinput", {})
    if isinstance(collector, pytest.Directory) and given:
        found = list(report.result or ())
        begin = len(found) * int(given["workerid"].removeprefix("gw")) // given["workercount"]
        report.result = found[begin:] + found[:begin]
    return report


@pytest.hookimpl(tryfirst=True)  # before the groups are read
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files that take longest; a file's tests share a worker (pyproject.toml), as they share fixtures."""
    # the other workers take one file each before they wait
    first = (UNCOMPILED[0], *LONGEST[:2], *UNCOMPILED[1:], *LONGEST[2:])
    longest = {name: place for place, name in enumerate(first)}
    items.sort(key=lambda item: (longest.get(item.path.stem, len(longest)), item.path))
    _choose(config, items)


#: Environment variable that names the folder in which the processes of a whole run say what they compile.
TOGETHER = "ITOUCH_TESTS_COMPILE"
#: The process that compiles what most tests need, while the run lasts.
_compiling: list[subprocess.Popen[bytes]] = []


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile what most tests need once, as a first start does, where the workers of a whole run would do so each."""
    config = session.config
    if config.args_source is config.ArgsSource.TESTPATHS and config.getoption("numprocesses", None):
        os.environ[TOGETHER] = place = tempfile.mkdtemp(prefix="itouch-tests-")
        with open(Path(place, "most"), "ab") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            _compiling.append(subprocess.Popen([sys.executable, "-c", MOST], cwd=SCENES, pass_fds=[held.fileno()]))
        _read_libraries()


#: Libraries that the files of tests import; of those that a plugin of pytest or ``MOST`` imports nothing is said.
LIBRARIES = ("pandas", "scipy.stats", "pyarrow", "xmlschema", "viser", "mujoco", "pint", "mpmath", "rosbags", "pyglet")


def _read_libraries() -> None:
    """Import what tests need once, in a new environment: its workers would all translate the same files at once."""
    found = importlib.util.find_spec("scipy")
    if sys.dont_write_bytecode or found is None or found.cached is None or Path(found.cached).exists():
        return
    words = "import contextlib, importlib, sys\nfor name in sys.argv[1:]:\n with contextlib.suppress(ImportError): importlib.import_module(name)"
    subprocess.run([sys.executable, "-W", "ignore", "-c", words, *LIBRARIES], check=False, timeout=300.0)


def _end_compiling() -> None:
    while _compiling:
        process = _compiling.pop()
        process.kill()
        process.wait()
        shutil.rmtree(os.environ.pop(TOGETHER), ignore_errors=True)


def pytest_unconfigure() -> None:
    """Leave nothing that compiles behind, though no test was collected."""
    _end_compiling()


def pytest_collection() -> None:
    """Collect thousands of tests without looking for garbage among them; not one of them is."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over thousands of tests, and look seldom for what a test leaves in circles."""
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
