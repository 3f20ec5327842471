"""Functions with which a sweep collects: of an installed package, or in a file beside the sweep."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from itouch.schema import ItouchError


class FunctionError(ItouchError):
    """A function that cannot be found; ``advice`` says what to do."""

    def __init__(self, sentence: str, advice: str = "") -> None:
        super().__init__(sentence)
        self.advice = advice


def in_file(function: str) -> str:
    """Return the file of ``file.py:function``, or an empty string."""
    home = function.partition(":")[0]
    return home if home.endswith(".py") else ""


def check_function(function: str, sweep: str) -> None:
    """Check that a function exists, before anything runs.

    Raises
    ------
    FunctionError
        If it does not.
    """
    load_function(function, Path(sweep).parent)


def load_function(function: str, folder: Path) -> Callable[..., Any]:
    """Return a function; files are looked for in the folder, and never outside it.

    Raises
    ------
    FunctionError
        If it cannot be found or imported.
    """
    home, _, name = function.partition(":")
    module = _of_file(home, folder) if in_file(function) else _of_package(home)
    found = getattr(module, name, None)
    if not callable(found):
        raise FunctionError(f"'{home}' has no function '{name}'", "its name follows the colon")
    return found  # type: ignore[no-any-return]


def _of_package(home: str) -> Any:
    try:
        if find_spec(home) is None:
            raise FunctionError(f"there is no module '{home}'", "install it, or name a file: file.py:function")
        return import_module(home)
    except (ImportError, ValueError) as error:
        raise FunctionError(f"'{home}' cannot be imported: {error}", "install it, or name a file.py:function") from None


def _of_file(home: str, folder: Path) -> Any:
    path = (folder / home).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise FunctionError(f"'{home}' lies outside the folder of the sweep", "put it beside the sweep")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FunctionError(f"cannot read '{home}': {error.strerror}", "its path is relative to the sweep") from None
    name = f"itouch_sweep_{hashlib.sha256(content).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FunctionError(f"'{home}' is not a Python file")
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # a user's file may raise anything
        del sys.modules[name]
        raise FunctionError(f"'{home}' cannot be imported: {type(error).__name__}: {error}") from error
    return module
