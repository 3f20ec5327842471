"""What a test needs of the machine: where it is missing the test is skipped, and fails where ``CI`` is set.

There, a test that is skipped in any other way fails, too (``forms.py``): what may be left out everywhere says so here.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
from typing import NoReturn

import pytest

#: The reasons for which tests may be left out where ``CI`` is set, too: nothing that could be installed is missing.
MEANT: set[str] = set()


def meant(reason: str) -> str:
    """Return the reason for which a test is left out, also where ``CI`` is set: on this machine it has no meaning."""
    MEANT.add(reason)
    return reason


def not_here(reason: str) -> NoReturn:
    """Skip a test that has no meaning here, or not now, also where ``CI`` is set."""
    pytest.skip(meant(reason))


def missing(sentence: str) -> NoReturn:
    """Skip a test for want of something, with what to install; fail where ``CI`` is set, which installs it."""
    (pytest.fail if os.environ.get("CI") else pytest.skip)(sentence)


def need_program(*names: str, package: str) -> str:
    """Return the path of the first of some programs that is there; where none is, the test is skipped."""
    for name in names:
        if found := shutil.which(name):
            return found
    missing(f"{names[0]} is not installed (Debian: {package})")


def need_package(module: str, *, extra: str) -> None:
    """Skip where a package of an extra that the tests' own does not hold is not installed."""
    if importlib.util.find_spec(module) is None:
        missing(f"{module} is not installed: pip install -e '.[{extra}]'")
