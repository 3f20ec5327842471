"""What the page of codes shows of an example, and what the doctor says of a machine's timer."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from itouch_tools.cli.doctor import machine_checks
from itouch_tools.cli.explain import code_page
from itouch_tools.cli.explain.example import Example


@pytest.mark.parametrize(
    ("files", "more", "names"),
    [
        ({"scene.xml": "<itouch/>", "cube.obj": "v 0 0 0\n"}, {}, ["cube.obj"]),
        ({"scene.xml": "<itouch/>", "long.csv": "1\n" * 9, "short.csv": "1\n" * 8}, {}, ["short.csv"]),
        ({"scene.xml": "<itouch/>", "recording.mcap": b"\x89MCAP"}, {}, []),
        ({"scene.xml": "<itouch/>", "cube.obj": "v 0 0 0\n"}, {"note": "a cube of one corner"}, []),
        ({"scene.xml": "<itouch/>", "plugin.py": "class It: ...\n"}, {"plugin": True}, []),
    ],
)
def test_short_texts_stand_beside_the_file_that_is_wrong(
    files: dict[str, str | bytes], more: dict[str, str], names: list[str]
) -> None:
    assert [name for name, _ in code_page._beside(Example(files, **more))] == names  # type: ignore[arg-type]


@pytest.mark.parametrize(("usual", "status"), [(50e-6, "ok"), (900e-6, "lack")])
def test_the_doctor_tells_the_usual_and_the_greatest_lateness_of_a_sleep(
    usual: float, status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, sleeps = [10.0], [0]

    def sleep(seconds: float) -> None:
        now[0] += seconds + (2e-3 if sleeps[0] == 70 else 10e-6 if sleeps[0] == 7 else usual)
        sleeps[0] += 1

    clock = SimpleNamespace(CLOCK_MONOTONIC=1, clock_getres=lambda kind: 1e-9, perf_counter=lambda: now[0], sleep=sleep)
    monkeypatch.setattr(machine_checks, "time", clock)
    found = machine_checks.timer()
    assert found.status == status
    assert f"ends {usual * 1e6:.0f} us late, at worst 2000" in found.found
