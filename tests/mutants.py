"""Mutants of the program: cosmic-ray makes them, drawn over all rooms alike; what they are, and how one is put in place.

``tests/mutation.py`` lets tests meet them.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.abc
import importlib.util
import random
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

HERE = Path(__file__).resolve().parent
TREE = HERE.parent
#: Tests of the supervisor and its monitors that need no scene and no compiler; those that do.
SAFETY = (
    *(f"safety/test_{name}.py" for name in (
        "guard", "finger", "supervisor", "hold_connect", "sequence", "blind_retreat", "joined_steps", "edges",
        "check_warm_up", "blind_legs", "never_enabled", "device_opening",
    )),
    *(f"monitors/test_{name}.py" for name in ("readings", "heat", "carrier", "monitors", "at_the_limits")),
)  # fmt: skip
SCENES = (
    *(f"safety/test_{name}.py" for name in (
        "two_on_one_finger", "phases", "unknown_devices", "attack_findings", "exchanged", "late_in_a_stop",
        "several_of_a_kind", "torque",
    )),
    "monitors/test_laws.py",
)  # fmt: skip
#: Tests of what goes between processes, in one; those that start and kill some are left out, but for the launch.
SERVO = ("memory", "watchdogs", "launch", "both_ends", "deadman_holders")
#: The page of all attributes, which says the bounds and the default of each.
PAGE = "docs/test_reference_pages.py"
#: Room -> the folder of its modules and the tests that answer for it, if they are not those in the folder of its name.
ROOMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "safety": ("framework/itouch/safety", (*SAFETY, *SCENES)),
    "monitors": ("framework/itouch/monitors", (*SAFETY, *SCENES)),
    **{name: (f"framework/itouch/{name}", (name,)) for name in (
        "exchange", "loop", "recording", "session", "arms", "dynamics", "world",
    )},
    **{name: (f"framework/itouch_tools/{name}", (name,)) for name in ("report", "sound", "study")},
    "export": ("framework/itouch_tools/export", ("export", "recording", "cli/test_session_commands.py")),
    "authoring": ("framework/itouch_tools/authoring", ("authoring", "scene")),
    "scene": ("framework/itouch/scene", ("scene", "authoring", "meaning", "twin/test_hand_skin_waits.py", PAGE)),
    "schema": ("framework/itouch/schema", ("schema", "scene", "authoring", PAGE)),
    "faults": ("framework/itouch/faults", ("faults",)),
    "servo": ("framework/itouch/servo", (
        *(f"servo/test_{name}.py" for name in SERVO),
        "servo/test_hanging_process.py::test_a_silent_process_has_its_time_by_what_it_gets_of_a_processor",
    )),
    "cli": ("framework/itouch_tools/cli", (
        "cli", "scene/test_problems.py", "docs/test_codes.py", "session/test_triggers.py",
        "study/test_power_and_exports.py", "study/test_report_intervals.py",
    )),
    "plugin": ("framework/itouch/plugin", (
        "plugin", "world", "loop/test_engine.py", "loop/test_modality_write_protection.py",
        "compiling/test_compiled_noise.py",
    )),
    "twin": ("framework/itouch/twin", ("twin", "loop/test_engine.py", "world/test_coupling.py")),
    "viewer": ("framework/itouch_tools/viewer", ("viewer/test_picture_content.py", "viewer/test_recording_seek.py")),
    "contact": ("framework/itouch/contact", ("contact",)),
    "thermal": ("plugins/thermal/contact_heat", ("plugins/thermal",)),
    "thermal-display": ("plugins/thermal/itouch_thermal/display", ("plugins/thermal_display", PAGE)),
    "thermal-flux": ("plugins/thermal/itouch_thermal/flux", ("plugins/thermal_display", PAGE)),
    "thermal-drivers": ("plugins/thermal/itouch_thermal/drivers", ("plugins/thermal_drivers", PAGE)),
    "xyz-table": ("plugins/xyz_table/itouch_xyz_table", ("plugins/xyz_table", PAGE)),
    "encountered": (
        "plugins/xyz_table/itouch_encountered", ("integration/test_encountered_surface.py", "loop/test_missing_plate.py"),
    ),
    "usb-arm": ("plugins/usb_arm/itouch_usb_arm", ("plugins/usb_arm", PAGE)),
}  # fmt: skip
_FAMILIES = ("ReplaceBinaryOperator_Add_Sub", "ReplaceBinaryOperator_Sub_Add", "ReplaceBinaryOperator_Mul_Div",
             "ReplaceBinaryOperator_Div_Mul", "ReplaceBinaryOperator_FloorDiv_Mul", "ReplaceBinaryOperator_Mod_Mul",
             "ReplaceBinaryOperator_Pow_Mul", "ReplaceBinaryOperator_BitAnd_BitOr",
             "ReplaceBinaryOperator_BitOr_BitAnd", "ReplaceComparisonOperator_Lt_LtE",
             "ReplaceComparisonOperator_LtE_Lt", "ReplaceComparisonOperator_Gt_GtE", "ReplaceComparisonOperator_GtE_Gt",
             "ReplaceComparisonOperator_Lt_Gt", "ReplaceComparisonOperator_LtE_GtE", "ReplaceComparisonOperator_Gt_Lt",
             "ReplaceComparisonOperator_GtE_LtE", "ReplaceComparisonOperator_Eq_NotEq",
             "ReplaceComparisonOperator_NotEq_Eq", "ReplaceComparisonOperator_Is_IsNot",
             "ReplaceComparisonOperator_IsNot_Is", "ReplaceUnaryOperator_Delete_USub",
             "ReplaceUnaryOperator_Delete_Not", "AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue",
             "ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak",
             "ExceptionReplacer", "NumberReplacer", "ZeroIterationForLoop")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one module: the file, the line, the operator that made it, and the changed source."""

    room: str
    path: Path
    line: int
    operator: str
    source: str

    @property
    def name(self) -> str:
        """File, line and operator."""
        return f"{self.path.relative_to(TREE)}:{self.line}: {self.operator}"

    @property
    def change(self) -> tuple[str, str, str]:
        """The file, the lines that are changed as they stand, and as they are changed; blanks do not count."""
        before, after = self.path.read_text(encoding="utf-8").splitlines(), self.source.splitlines()
        codes = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
        spans = [span for span in codes if span[0] != "equal"]
        old = [line for _, first, last, _, _ in spans for line in before[first:last]]
        new = [line for _, _, _, first, last in spans for line in after[first:last]]
        return str(self.path.relative_to(TREE)), bare("\n".join(old)), bare("\n".join(new))


def bare(text: str) -> str:
    """Return a text without blanks."""
    return "".join(text.split())


def equivalents() -> dict[tuple[str, str, str], str]:
    """Return the changes that change nothing, with the reason: file, line as it stands, line as it is changed."""
    content = tomllib.loads((HERE / "equivalent_mutants.toml").read_text(encoding="utf-8"))
    return {
        (entry["file"], bare(entry["line"]), bare(changed)): entry["reason"]
        for entry in content["mutant"]
        for changed in entry["changed"]
    }


def modules(room: str, name: str = "") -> list[Path]:
    """Return the modules of a room, or those of this name."""
    found = sorted(path for path in (TREE / ROOMS[room][0]).rglob("*.py") if path.stat().st_size > 200)
    return [path for path in found if name in ("", path.stem)]


#: The decorators of functions that are compiled.
COMPILING = frozenset(
    ("kernel", "nogil_kernel", "entry", "inner", "making", "linked", "inlined", "part_of_its_caller", "flat", "njit")
)


def is_compiled(path: Path) -> bool:
    """Tell whether functions of a module are compiled: coverage does not see them."""
    found = re.findall(r"^\s*@(?:\w+\.)*(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    return not COMPILING.isdisjoint(found)


def draw(rooms: Sequence[str], count: int, seed: int, module: str = "") -> list[Mutant]:
    """Draw mutants at random: of each room as many, within it each place of each module, or of one, alike."""
    dice, found = random.Random(seed), list[Mutant]()
    share = -(-count // len(rooms))
    for room in rooms:
        places = [(path, place) for path in modules(room, module) for place in _places(path)]
        dice.shuffle(places)
        taken = 0
        for path, place in places:
            if taken == share or len(found) == count:
                break
            mutant = _mutant(room, path, *place)
            if mutant is not None:
                found.append(mutant)
                taken += 1
    return found


def _places(path: Path) -> Iterator[tuple[int, str, int]]:
    """Yield line, operator and occurrence of each place of a file where an operator has something to change."""
    import parso  # noqa: F401  - first: the next import would go round in a circle
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
    for name in _FAMILIES:
        operator, occurrence = get_operator(f"core/{name}")(), 0
        for node in nodes:
            for (line, _), _ in operator.mutation_positions(node):
                yield line, name, occurrence
                occurrence += 1


def _mutant(room: str, path: Path, line: int, name: str, occurrence: int) -> Mutant | None:
    """Return a mutant, or None if it says the same: in an annotation, or not at all."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    before = path.read_text(encoding="utf-8")
    after = mutate_code(before, get_operator(f"core/{name}")(), occurrence)
    try:
        if after is None or _meaning(after) == _meaning(before):
            return None
    except SyntaxError:
        return None
    return Mutant(room, path, line, name, after)


class _Bare(ast.NodeTransformer):
    """Leaves out what has no effect when the program runs: annotations, ``TYPE_CHECKING``, names of slots."""

    def visit_arguments(self, node: ast.arguments) -> ast.AST:
        """Take no notice of the bare ``*`` or ``/`` of a signature: it is no operator, and computes nothing."""
        node.args, node.posonlyargs = [*node.posonlyargs, *node.args, *node.kwonlyargs], []
        node.defaults += [default for default in node.kw_defaults if default is not None]
        node.kwonlyargs, node.kw_defaults = [], []
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if "TYPE_CHECKING" in ast.unparse(node.test) else self.generic_visit(node)


def _meaning(source: str) -> str:
    return ast.dump(_Bare().visit(ast.parse(source)))


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Offers a mutant in the place of its module."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant
        root = next(p for p in mutant.path.parents if not (p / "__init__.py").exists())
        self.name = ".".join(mutant.path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")

    def find_spec(self, name: str, path: object, target: object = None) -> Any:
        """Answer for the one module."""
        if name != self.name:
            return None
        package = self.mutant.path.name == "__init__.py"
        return importlib.util.spec_from_file_location(
            name, self.mutant.path, loader=self,
            submodule_search_locations=[str(self.mutant.path.parent)] if package else None,
        )  # fmt: skip

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(compile(self.mutant.source, str(self.mutant.path), "exec"), module.__dict__)


def find(room: str, file: str, operator: str, change: tuple[str, str], line: int) -> Mutant | None:
    """Return the mutant of a file that is a change of what stands there into something, of these the nearest to a line."""
    path, found = TREE / file, list[Mutant]()
    for at, name, occurrence in _places(path) if path.is_file() else ():
        if name == operator:
            mutant = _mutant(room, path, at, name, occurrence)
            if mutant is not None and mutant.change[1:] == change:
                found.append(mutant)
    return min(found, key=lambda mutant: abs(mutant.line - line), default=None)
