"""Whatever is done to a safety attribute of a shipped scene: refused, or nothing is looser than without it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import campaign
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene.elements import Safety
from itouch.schema.fields import specs, xml_name
from itouch.world import limits as default
from itouch.world.limits import DeviceLimits, ceilings, check_safety
from itouch.world.rig import build_devices

CATALOG = Catalog()
ELEMENT = re.compile(r"<(limits|safety)\b[^>]*>")
ATTRIBUTE = re.compile(r'\s([\w-]+)="([^"]*)"')


def shipped() -> Iterator[tuple[str, int, int, str, str]]:
    """Yield each safety attribute: file, span of the attribute with its space, name and value."""
    for path in sorted(SCENES.rglob("*.xml")):
        text = path.read_text(encoding="utf-8")
        for element in ELEMENT.finditer(text):
            for attribute in ATTRIBUTE.finditer(element.group()):
                first = element.start() + attribute.start()
                yield str(path.relative_to(SCENES)), first, first + len(attribute.group()), *attribute.groups()


SHIPPED = list(shipped())
#: The first attribute of each name; all others are tried in the long form.
FIRST_OF_ITS_NAME = set({one[3]: one for one in reversed(SHIPPED)}.values())
WHOLE = [path.name for path in sorted(SCENES.glob("*.xml")) if "<world" in path.read_text(encoding="utf-8")]
SPOILT = ("nan", "inf", "-inf", "nan N", "1e999 m/s", "", "abc", "-1", "0", "1_0", "15 inf degC", "nan 40 degC")


def scene_of(file: str) -> str:
    """Return the scene that a file is, or one that includes it."""
    if file in WHOLE:
        return file
    users = [name for name in WHOLE if f'"{file}"' in (SCENES / name).read_text(encoding="utf-8")]
    assert users, f"no shipped scene includes {file}"
    return users[0]


def in_force(scene: Path) -> dict[str, DeviceLimits] | None:
    """Return the limits in force by device, or None if the scene is refused."""
    try:
        loaded = itouch.load(scene)
    except itouch.SceneError:
        return None
    problems = list(check_safety(loaded))
    devices = build_devices(loaded, CATALOG, problems)
    if any(problem.severity == "error" for problem in problems):
        return None
    for device in devices.values():
        assert_no_looser(device.limits, ceilings(device.reads, device.commands))
    return {name: device.limits for name, device in devices.items()}


def assert_no_looser(found: DeviceLimits, before: dict[str, tuple[object, str]]) -> None:
    """Every limit is at least as tight as default and ceiling; trips are too."""
    for name, (ceiling, _) in before.items():
        value = getattr(found, name)
        if name == "temperature":
            assert ceiling[0] <= value[0] < value[1] <= ceiling[1]  # type: ignore[index]
        elif name == "contact_time":
            assert 0.0 < value <= default.CONTACT_TIME_LONGEST
        else:
            assert 0.0 < value <= ceiling, name  # type: ignore[operator]
    least, most = found.temperature_trip
    assert default.PLATE_TRIP[0] <= least < most <= default.PLATE_TRIP[1]
    assert found.plate_force_trip <= default.PLATE_FORCE_TRIP
    assert found.contact_time_trip <= default.CONTACT_TIME_TRIP
    assert (found.speed_near or 0.0) <= default.SPEED_NEAR
    assert math.isfinite(found.ramp)


@pytest.mark.parametrize("file", ["four_materials.xml", "four_materials_diy.xml"])
@pytest.mark.parametrize("asked", [None, 0.0, 0.3, default.RAMP, 2.0])
def test_hardware_ramps_in_for_as_long_as_by_default_or_longer(scenes: Path, file: str, asked: float | None) -> None:
    if asked is not None:
        text = (scenes / file).read_text(encoding="utf-8")
        assert text.count("<safety ") == 1
        (scenes / file).write_text(text.replace("<safety ", f'<safety ramp="{asked} s" '), encoding="utf-8")
    found = in_force(scenes / file)
    assert found
    least = default.RAMP if file == "four_materials_diy.xml" else 0.0
    assert {name: limits.ramp for name, limits in found.items()} == dict.fromkeys(found, max(asked or 0.0, least))


def changed(folder: Path, file: str, first: int, last: int, text: str) -> Path:
    """Put another text into a copy of the scenes, and return the scene that holds the file."""
    path = folder / file
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole[:first] + text + whole[last:], encoding="utf-8")
    return holder(folder, file)


def holder(folder: Path, file: str) -> Path:
    """Return the scene that a file is, or that includes it."""
    including = (name for name in WHOLE if f'file="{file}"' in (folder / name).read_text(encoding="utf-8"))
    return folder / (file if file in WHOLE else next(including))


def mutants(name: str, value: str) -> Iterator[tuple[str, str]]:
    """Yield what to put in the place of an attribute, with whether it must be refused."""
    yield "", "allowed"
    for index in range(len(name)):
        yield f' {name[:index] + name[index + 1 :]}="{value}"', "refused"
        yield f' {name[:index]}x{name[index:]}="{value}"', "refused"
    for spoilt in SPOILT:
        yield f' {name}="{spoilt}"', "refused"
    number, unit = value.split(" ", 1)
    for factor in (1.001, 10.0, 1e3, 1e9):
        numbers = " ".join(f"{float(word) * factor!r}" for word in value.split()[:-1])
        yield f' {name}="{numbers} {value.split()[-1]}"', "allowed"
    yield f' {name}="{value}" {name}="{value}"', "refused"
    yield f' {name}="{number}"', "allowed"
    yield f' {name}="{value}s"', "refused"


def test_the_shipped_scenes_have_safety_attributes() -> None:
    assert len(SHIPPED) >= 5
    assert {name for *_, name, _ in SHIPPED} >= {"force", "speed", "current", "temperature"}


@pytest.mark.parametrize(
    ("file", "first", "last", "name", "value"), campaign.some(SHIPPED, FIRST_OF_ITS_NAME.__contains__)
)
def test_no_change_of_a_shipped_attribute_loosens_anything(
    scenes: Path, file: str, first: int, last: int, name: str, value: str
) -> None:
    text = (scenes / file).read_text(encoding="utf-8")
    for mutant, expected in mutants(name, value):
        limits = in_force(changed(scenes, file, first, last, mutant))
        (scenes / file).write_text(text, encoding="utf-8")
        assert expected == "allowed" or limits is None, mutant


@pytest.mark.parametrize(
    ("file", "first", "last", "name", "value"), campaign.some(SHIPPED, FIRST_OF_ITS_NAME.__contains__)
)
def test_an_attribute_that_is_moved_elsewhere_is_refused_or_tightens(
    scenes: Path, file: str, first: int, last: int, name: str, value: str
) -> None:
    text = (scenes / file).read_text(encoding="utf-8")
    for tag in ("device", "mount", "devices", "itouch", "calibration", "box", "probe", "operator", "rates", "safety"):
        cut = text[:first] + text[last:]
        moved = re.sub(rf"<{tag}\b(?![\w-])", f'<{tag} {name}="{value}"', cut, count=1)
        (scenes / file).write_text(moved, encoding="utf-8")
        limits = in_force(holder(scenes, file))
        assert limits is None or moved == cut or tag == "safety"
    (scenes / file).write_text(text, encoding="utf-8")


_numbers = st.one_of(
    st.floats(-1e12, 1e12).map(repr), st.sampled_from(["nan", "inf", "-inf", "1e999", "0", "-0.0", "", "ten", "1e-320"])
)
_units = st.sampled_from(["", "N", "kN", "m/s", "mm/s", "degC", "K", "K/s", "s", "ms", "min", "h", "A", "W/m^2", "%"])
_values = st.one_of(
    st.tuples(_numbers, _units).map(" ".join), st.tuples(_numbers, _numbers, _units).map(" ".join), st.text(max_size=8)
)
_names = st.sampled_from([xml_name(name) for name in specs(Safety)])


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(_names, _values, max_size=3), st.dictionaries(_names, _values, max_size=3))
def test_no_safety_attributes_loosen_anything(tmp_path: Path, safety: dict[str, str], limits: dict[str, str]) -> None:
    path = tmp_path / "s.xml"
    path.write_text(
        '<itouch version="1.0"><devices>'
        f'<device name="arm" plugin="usb-arm"><limits{_written(limits)}/></device>'
        f'<device name="table" plugin="xyz-table"><limits{_written(limits)}/></device>'
        f'<device name="peltier" plugin="thermal"><limits{_written(limits)}/></device>'
        f"</devices><safety{_written(safety)}/></itouch>",
        encoding="utf-8", errors="replace",
    )  # fmt: skip
    in_force(path)


def _written(attributes: dict[str, str]) -> str:
    text = "".join(f" {name}={_quoted(value)}" for name, value in attributes.items())
    return "".join(letter for letter in text if letter >= " ")


def _quoted(value: str) -> str:
    escaped = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'"{escaped}"'


def test_a_deleted_tightening_returns_to_the_default_and_check_says_so(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from itouch_tools.cli import main

    scene = scenes / "four_materials.xml"
    text = scene.read_text(encoding="utf-8")
    scene.write_text(text.replace('<safety force="3 N"/>', '<safety force="1 N"/>'), encoding="utf-8")
    assert main(["check", str(scene)]) == 0
    assert f"force on the finger: 1 N, never beyond 8 N (<safety> at {scene}:" in capsys.readouterr().out
    scene.write_text(text.replace('<safety force="3 N"/>', ""), encoding="utf-8")
    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text(encoding="utf-8").replace('<limits force="3 N"/>', ""), encoding="utf-8")
    assert main(["check", str(scene)]) == 0
    assert "force on the finger: 3 N, never beyond 8 N (the default)" in capsys.readouterr().out
