"""Output that goes nowhere: no stream at all, a full disk behind it, a reader that has gone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from shipped import SCENES

COMMAND = f"{sys.executable} -m itouch_tools.cli"
CHECK = f"{COMMAND} check {SCENES / 'first_touch.xml'}"
RUN = f"{COMMAND} run {SCENES / 'first_touch.xml'} --headless --for 0.1s"


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        (f"{CHECK} >&-", 0, ""),
        (f"{RUN} >&-", 0, ""),
        (f"{CHECK} >&- 2>&-", 0, ""),
        (f"{CHECK} >/dev/full", 2, "cannot write: No space left on device"),
        (f"{RUN} >/dev/full", 2, "cannot write: No space left on device"),
        (f"{COMMAND} check nowhere.xml 2>/dev/full", 2, ""),
        (f"{COMMAND} --color some 2>/dev/full", 2, ""),
        (f"{COMMAND} frobnicate 2>/dev/full >/dev/full", 2, ""),
        (f"ITOUCH_KEPT=here {RUN} --report r.json 2>/dev/full && test -s r.json", 0, ""),
        (f"{CHECK} | (exec <&-; sleep 3); exit ${{PIPESTATUS[0]}}", 141, ""),
        (f"mkfifo p; {RUN} --report p", 2, "'p' is a pipe, which may have no reader; name a file, or /dev/stdout"),
        (f"set -o pipefail; {RUN} --quiet --report /dev/stdout | grep -q servo", 0, ""),
        (f"{RUN} --pace real >&-", 0, ""),
        (f"{RUN} --pace real >&- 2>&- <&-", 0, ""),
    ],
    ids=[
        "check",
        "run",
        "check, no errors",
        "check, full",
        "run, full",
        "an error, full",
        "an option, full",
        "an unknown command, all full",
        "a note, full",
        "check, broken pipe",
        "run, pipe",
        "run, report",
        "real time",
        "real time, nothing",
    ],  # the commands have the path of this checkout
)
def test_a_command_with_closed_output_ends_without_a_traceback(
    tmp_path: Path, command: str, code: int, said: str
) -> None:
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert said in done.stderr
