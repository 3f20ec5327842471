"""The contact-heat solver by itself: it needs NumPy and Numba, and nothing of the framework."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import contact_heat
from contact_heat import hosting

PACKAGE = Path(contact_heat.__file__).parent

#: Runs README's listing in an interpreter in which the framework, its plugins and SciPy can't be imported.
ALONE = """
import importlib.abc, json, pkgutil, sys
class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("itouch", "itouch_thermal", "scipy", "lxml", "trimesh", "pyglet", "rich"):
            raise ImportError(f"{name} is blocked")
sys.meta_path.insert(0, Blocked())
sys.path.insert(0, sys.argv[1])
scope = {}
exec(sys.argv[2], scope)
import contact_heat
for found in pkgutil.iter_modules(contact_heat.__path__):
    __import__(f"contact_heat.{found.name}")
print(json.dumps({"flux": scope["solve"](scope["touch"], [1e-3, 0.1, 10.0]).flux.tolist(),
                  "stepped": float(scope["stepper"].step(1e-4)),
                  "foreign": sorted({name.partition(".")[0] for name in sys.modules if name.startswith("itouch")})}))
"""


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """Return what README's listing gives where there is nothing but NumPy and Numba."""
    listing = re.search(r"```python\n(.*?)```", (PACKAGE / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert listing is not None
    done = subprocess.run(
        [sys.executable, "-c", ALONE, str(PACKAGE.parent), listing[1]],
        capture_output=True, text=True, check=True, cwd=tmp_path_factory.mktemp("alone"),
    )  # fmt: skip
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_it_runs_without_the_framework_and_finds_the_same(alone: dict[str, object]) -> None:
    assert alone["foreign"] == []
    listing = re.search(r"```python\n(.*?)```", (PACKAGE / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert listing is not None
    scope: dict[str, object] = {}
    exec(listing[1], scope)
    here = scope["solve"](scope["touch"], [1e-3, 0.1, 10.0]).flux.tolist()  # type: ignore[operator]
    assert alone["flux"] == pytest.approx(here, rel=1e-12)
    assert alone["stepped"] == pytest.approx(scope["stepper"].step(1e-4), rel=1e-12)  # type: ignore[attr-defined]


def test_readme_names_modules_that_are_there() -> None:
    text = (PACKAGE / "README.md").read_text(encoding="utf-8").split("| module |")[1]
    named = {
        name for row in re.findall(r"^\| (`.*?) \|", text, flags=re.MULTILINE) for name in re.findall(r"`(\w+)`", row)
    }
    assert len(named) > 10 and all((PACKAGE / f"{name}.py").is_file() for name in named)


def test_within_the_framework_its_stores_are_used() -> None:
    import itouch_thermal.solver_stores
    from itouch.compiling import KernelCache

    assert isinstance(hosting._HOST[0], itouch_thermal.solver_stores.Framework)
    from contact_heat.live import contact_step

    cache = getattr(contact_step, "_cache", None)
    assert cache is None or isinstance(cache, KernelCache)  # none where compiling is switched off


def test_the_old_names_still_lead_there() -> None:
    with pytest.warns(DeprecationWarning, match="contact_heat"):
        from itouch_thermal.solver.layers import Layer
    assert Layer is contact_heat.Layer
    from itouch_thermal.solver.materials import material

    from itouch_thermal.rendering import materials

    assert material is materials.material


@pytest.mark.parametrize(
    ("given", "said"),
    [({"thickness": -1.0}, "thickness = -1.0 is out of range: 1e-09 to 100 m"),
     ({"density": float("nan")}, "density = nan is out of range"), ({"conductivity": True}, "is not a number")],
)  # fmt: skip
def test_a_layer_out_of_range_is_told(given: dict[str, float], said: str) -> None:
    values = {"conductivity": 0.4, "density": 1000.0, "specific_heat": 3500.0} | given
    with pytest.raises(ValueError, match=re.escape(said)):
        contact_heat.Layer(**values)


def test_it_can_be_installed_alone_with_the_versions_that_the_program_allows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hatchling.build import build_wheel

    root = PACKAGE.parents[2]
    own, whole = (tomllib.loads((at / "pyproject.toml").read_text(encoding="utf-8")) for at in (PACKAGE, root))
    assert set(own["project"]["dependencies"]) < set(whole["project"]["dependencies"])
    assert own["project"]["optional-dependencies"]["peers"] == whole["project"]["optional-dependencies"]["bench"]
    for key in ("version", "requires-python", "license"):
        assert own["project"][key] == whole["project"][key]
    monkeypatch.chdir(PACKAGE)
    with zipfile.ZipFile(tmp_path / build_wheel(str(tmp_path))) as wheel:
        found = {Path(name).name for name in wheel.namelist() if name.startswith("contact_heat/")}
    assert found == {path.name for path in PACKAGE.glob("*.py")} | {"README.md", "py.typed"}
