"""A constant has one home: what has the same name and the same value in two rooms is imported, or only looks the same."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from types import CodeType
from typing import Any

from rooms import room
from sources import Module, modules

#: Names that say what a number is for in their own file only: how long something waits, how often it looks, how many.
OWN = {
    "AGAIN", "BACKLOG", "BLOCK", "EVERY", "LEAST", "LONGEST", "LOOK", "MOST", "PATIENCE", "QUIET", "SECONDS", "SHORTEST",
    "STALE", "STEPS", "TRIES",
}  # fmt: skip
#: What the evidence judges by is its own: it must not follow what it judges.
EVIDENCE = "itouch_evidence"
#: Name and value -> why two rooms have it.
CHANCE = {
    ("ANSWER", 0.1): "how long devices are asked in the safe sequence, and how long an arm's service may take",
    ("AXES", "xyz"): "the order of letters in two protocols",
    ("CONTACT_TIME", 10.0): "the scene's room lies below the monitors' (tests/docs/test_limits_page.py compares)",
    ("DAMPING_RATIO", 0.9): "that of the table's twin, and the one that the carrier takes any device to have",
    ("DRIVEN", 0.02): "a share of full strength, and a current [A]",
    ("FORCE", 8.0): "common desktop arms, and what is stated of one of them",
    ("LONGEST_WATCHDOG", 0.5): "what two makers' controllers can do",
    ("NEAR", 0.02): "K5's distance, and within which the carrier waits for a slow device",
    ("SKIN", 306.15): "that of the conformance suite, and those of two studies of heat",
    ("SLOW", 0.02): "a speed [m/s], and a speed as a share",
    ("STIFFNESS", 3000.0): "common desktop arms, and what is stated of one of them",
    ("VERSION", "1.0"): "the formats of scenes, studies and sweeps change each by itself",
    ("WATCHDOG", 0.1): "that of a twin behind a wire, and that of the table's axes",
    ("WEBER", 0.43): "tools and plugins import nothing of one another (tests/plugins/thermal compares)",
    ("CATCH_UP", 0.25): "how far two plugins' virtual arms, which share nothing, may fall behind",
    ("LARGEST", 32 << 20): "a result that is kept, and a file of records",
    ("LEARNT", 0.2): "weights of one exchange in two estimates: the framework's, and the carrier's own",
    ("PART", 0.1): "a time [s], and a share",
    ("PERIOD", 1e-3): "the usual period of a servo loop, in three studies that choose theirs",
    ("RATE", 250.0): "of what is streamed to a laboratory's recorder, and to a viewer",
    ("RATE", 30.0): "of what a viewer is shown of a recording, and in a browser",
    ("ROUNDING", 1e-9): "a depth [m], and a relative tolerance",
    ("STEP", 1e-3): "the time steps of six simulations",
    ("STEP", 5.0): "a jump of a plate's sensor [K], and the ends of a colour scale [degC]",
    ("STILL", 0.1): "parts of two wholes: of a leg, and of a strength",
    ("ROOM", 296.15): "the solver knows no framework, and the framework no plugin",
}  # fmt: skip


def constants(module: Module) -> Iterator[tuple[str, Any]]:
    """Yield name and value of each constant of a module that is a literal number or word, or a tuple of them."""
    for node in module.tree.body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            target, value = node.target, node.value
        else:
            continue
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=True))
        for name, given in pairs:
            if isinstance(name, ast.Name) and name.id.isupper() and _literal(given):
                yield name.id.strip("_"), eval(_compiled(given))


def _literal(value: ast.expr) -> bool:
    """Tell whether an expression has literals only, such as ``8 << 20``."""
    allowed = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.operator, ast.unaryop, ast.expr_context)
    return all(isinstance(part, allowed) for part in ast.walk(value))


def _compiled(value: ast.expr) -> CodeType:
    return compile(ast.Expression(value), "constant", "eval")


def plain(value: Any) -> bool:
    """Tell whether a value is one that many constants have: a flag, a small whole number, a letter, or some of these."""
    if isinstance(value, tuple):
        return all(plain(part) for part in value)
    if isinstance(value, str):
        return len(value) < 3
    return value in (0, 1, -1, 2) if isinstance(value, float) else not isinstance(value, int) or abs(value) <= 10


def twice(every: dict[str, Module]) -> dict[tuple[str, Any], dict[str, list[str]]]:
    """Return what is defined in more than one room: by name and value, the modules by room."""
    found: dict[tuple[str, Any], dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for module in every.values():
        if room(module.name) != EVIDENCE:
            for name, value in constants(module):
                if name not in OWN and not plain(value):
                    found[name, value][room(module.name)].append(module.name)
    return {what: dict(places) for what, places in found.items() if len(places) > 1}


def test_no_constant_is_copied_from_room_to_room() -> None:
    """Import it from the lowest room that may have it; a plugin, from `itouch.plugin`.  Or say in CHANCE why not."""
    found = twice(modules())
    assert {what: places for what, places in found.items() if what not in CHANCE} == {}


def test_what_is_excused_is_there() -> None:
    found = twice(modules())
    assert set(CHANCE) - set(found) == set()


def test_a_copy_is_found_whatever_hides_it() -> None:
    first = Module(
        "itouch.loop.one", modules()["itouch"].path, "A, FAR = 1, 2.5e-3\nMANY: Final = 8 << 20\nIS = (0.5, 7.5)\n"
    )
    other = Module("itouch_thermal.two", first.path, "_FAR = 0.0025\nMANY = 8388608\nA = 1\nIS = (0.5, 7.5)\n")
    same = Module("itouch.loop.three", first.path, "FAR = 2.5e-3\n")
    assert set(twice({one.name: one for one in (first, other)})) == {
        ("FAR", 0.0025),
        ("MANY", 8388608),
        ("IS", (0.5, 7.5)),
    }
    assert not twice({one.name: one for one in (first, same)})
