"""What a test needs of the machine: where it is missing the test is skipped, and fails where ``CI`` is set."""

from __future__ import annotations

import os
import shutil
from typing import NoReturn

import pytest


def missing(sentence: str) -> NoReturn:
    """Skip a test for want of something, with what to install; fail where ``CI`` is set, which installs it."""
    (pytest.fail if os.environ.get("CI") else pytest.skip)(sentence)


def need_program(*names: str, package: str) -> str:
    """Return the path of the first of some programs that is there; where none is, the test is skipped."""
    for name in names:
        if found := shutil.which(name):
            return found
    missing(f"{names[0]} is not installed (Debian: {package})")
