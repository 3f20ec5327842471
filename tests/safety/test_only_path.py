"""One way to the hardware: only the supervisor writes to devices, and it is tested to the last branch."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import mutation
from shipped import REPOSITORY

FRAMEWORK = REPOSITORY / "framework"
UNIT = [str(mutation.HERE / name) for name in mutation.SAFETY]
#: What takes most of the time with the compiler off, and reaches no branch that nothing else there reaches; to
#: find them, coverage with ``dynamic_context = test_function``.  All of them run in the short form, with the compiler.
SLOW = (
    "time_in_the_cold_is_used_up", "obeys_goes_down_however", "gone_back_and_still_feels", "lifted_quickly_and",
    "still_presses_goes_on and (0.01 or True)", "no_way_leads_further", "wired_backwards_lets_go_of_the_finger",
    "slow_one_has_the_time_that_its_legs", "wire_that_takes_no_command", "held_where_it_stood_if_its_witness",
    "touching_one_plate_and_then_another", "worn_display_lets_go", "worn_display_is_in_contact",
    "late_is_believed_when_it_answers", "tapping_does_not_get_past", "stiff_hand_moves_by_a_part", "drifted_sensor_is_on",
    "plate_that_may_stop_is_not_frozen", "not_believed_can_not_be_verified", "wrench_keeps_its_direction",
    "pad_is_off_or_within", "torque_is_limited_in_size", "stands_at_its_end_and_reads", "numbers_of_the_sequence",
    "without_a_tracked_finger_nothing", "plate_of_its_own_is_safe_when_both", "may_be_a_tenth_of_a_second_old",
    "stays_in_its_travel_and_below", "not_answered_for_a_tenth", "turns_round_again_while_it_is_driven_back",
    "ramps_to_its_target", "is_judged_when_its_last_command", "may_answer_now_and_then",
    "finger_that_nothing_moves_is_pressed", "all_measured_before_the_stop", "in_the_very_tick_of_the_stop",
    "came_up_again_has_not_gone_back", "held_blindly_goes_no_further", "on_its_way_back_that_pushes",
    "without_ends_retracts_nowhere", "follow_a_strong_drive_has_run_away", "stays_is_waited_for_three_tenths",
    "drive_that_is_on_and_a_fault", "still_being_driven_back_at_the_end", "turns_round_again_and_again_is_held",
    "stays_nearer_than_it_was_is_not_safe", "came_that_is_stuck_is_said", "presses_and_stands_is_told",
    "surface_that_does_not_go_is_told", "grow_by_no_more_than_noise", "nothing_new_was_measured",
    "second_fault_on_the_way", "command_that_stays_on_is_told", "lies_and_goes_the_wrong_way",
    "not_believed_or_has_fallen_silent", "drive_that_turns_round_begins", "backlog_from_before",
    "mean_flux_of_a_second_cuts", "never_answers_again", "answers_again_in_the_middle", "does_not_stop_under_a_steady",
    "device_takes_by_itself_counts", "falls_out_of_touch_as_fast", "nothing_is_heard_is_led",
    "late_wire_tells_of_the_time", "goes_wrong_twice_is_turned", "near_the_end_of_its_travel",
    "calls_a_surface_no_nearer", "true_place_of_a_twin", "was_found_to_go_the_wrong_way", "reading_that_stands_still",
    "in_balance_under_a_steady", "without_a_witness_it_goes_down", "went_the_wrong_way_stays",
    "held_as_soon_as_it_is_clear",
)  # fmt: skip


def device_writes(path: Path) -> list[int]:
    """Return the lines that call ``write`` of something called a device, but for devices that wrap another one."""
    source = path.read_text(encoding="utf-8")
    if ".write(" not in source:
        return []
    tree, found = ast.parse(source), []
    wrapping: list[ast.AST] = [
        node for node in ast.walk(tree)
        if (isinstance(node, ast.FunctionDef) and node.name == "write")
        or (isinstance(node, ast.ClassDef) and "Device" in {ast.unparse(base) for base in node.bases})
    ]  # fmt: skip
    passed_on = {id(node) for function in wrapping for node in ast.walk(function)}
    for node in [node for node in ast.walk(tree) if id(node) not in passed_on]:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "write":
            owner = ast.unparse(node.func.value)
            if "device" in owner.lower():
                found.append(node.lineno)
    return found


def test_only_the_supervisor_writes_to_a_device() -> None:
    writers = {
        str(path.relative_to(FRAMEWORK)): lines
        for path in FRAMEWORK.rglob("*.py")
        if (lines := device_writes(path)) and "testing" not in path.parts
    }
    assert len(writers.pop("itouch/safety/actuation.py")) == 1
    carriers = {name for name in writers if not name.startswith(("itouch/exchange/", "itouch/servo/"))}
    assert carriers == set()  # threads and sockets carry on what the supervisor has let through


def test_every_branch_of_the_supervisor_is_tested(tmp_path: Path) -> None:
    # with the compiler off: coverage sees the branches of compiled functions as Python runs them
    data = {**os.environ, "COVERAGE_FILE": str(tmp_path / "coverage"), "NUMBA_DISABLE_JIT": "1"}
    run = [
        "run",
        "--branch",
        "--source=itouch.safety,itouch.monitors",
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-k",
        " and ".join(f"not ({words})" for words in SLOW),
        *UNIT,
    ]
    done = subprocess.run(
        [sys.executable, "-m", "coverage", *run], env=data, cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]
    report = [sys.executable, "-m", "coverage", "report", "--fail-under=100", "--show-missing", "--skip-covered"]
    done = subprocess.run(report, env=data, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
