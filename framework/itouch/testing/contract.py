"""Whether a class is a plugin at all, which every other check takes for granted."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

import numpy as np

from itouch.plugin import Channel, Emulator, Twin
from itouch.plugin.record import dtype_of
from itouch.testing.checks import CheckError, check
from itouch.testing.child_process import described
from itouch.testing.harness import DeviceHarness
from itouch.testing.scenario import ModalityHarness


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("contract", "it has all that a plugin needs")
def contract(harness: DeviceHarness | ModalityHarness) -> None:
    """Check parameters, methods, channels and the State fields of the twin."""
    cls: Any = harness.cls
    missing = sorted(getattr(cls, "__abstractmethods__", ()))
    if missing:
        raise _fail(
            f"{cls.__name__} lacks {', '.join(missing)}",
            "a method is not written yet, or is misspelt",
            "write it; the contract is in itouch.plugin",
        )
    kind = getattr(cls, "Params", None)
    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)):
        raise _fail(
            f"{cls.__name__}.Params is {kind!r}",
            "@dataclass(frozen=True) is missing, or Params",
            "write @dataclass(frozen=True) class Params, with schema fields, and name it in the class",
        )
    if isinstance(harness, DeviceHarness):
        _channels(harness)
        _twin(harness)


def _channels(harness: DeviceHarness) -> None:
    cls = harness.cls
    params = harness.require_params()
    try:
        reads, commands = cls.channels(params)
    except Exception as error:  # whatever the plugin's code raises
        raise _fail(
            f"channels(params) raised {described(error)}", "a mistake in channels()", "return (reads, commands)"
        ) from error
    for name, channels in (("reads", reads), ("commands", commands)):
        if not isinstance(channels, (tuple, list)) or not all(isinstance(one, Channel) for one in channels):
            raise _fail(
                f"{name} = {channels!r} is not a tuple of channels",
                "a comma is missing after the only channel, or another container",
                f"write {name} = (pose(), ...)",
            )
    if not reads and not commands:
        raise _fail("the device neither reads nor obeys anything", "`reads` was forgotten", "declare its channels")


def _twin(harness: DeviceHarness) -> None:
    for name, kind, base in (("Twin", harness.cls.Twin, Twin), ("Emulator", harness.cls.Emulator, Emulator)):
        if kind is None:
            continue
        if not (inspect.isclass(kind) and issubclass(kind, base)):
            raise _fail(f"{name} = {kind!r}", f"not a class of {name}s", f"derive it from itouch.plugin.{name}")
        missing = sorted(getattr(kind, "__abstractmethods__", ()))
        if missing:
            raise _fail(f"{kind.__name__} lacks {', '.join(missing)}", "not written yet, or misspelt", "write it")
    if harness.cls.Twin is None:
        return
    try:
        dtype = dtype_of(harness.cls.Twin(harness.require_params()).fields())
    except Exception as error:  # whatever the plugin's code raises
        raise _fail(
            f"the twin's fields() raised {described(error)}", "a mistake in fields()", "return a tuple of Field"
        ) from error
    wrong = [name for name in dtype.names or () if np.dtype(dtype[name].base).kind not in "fiubV"]
    if wrong:
        raise _fail(
            f"the State field '{wrong[0]}' is of type {dtype[wrong[0]]}",
            "objects and texts are not numbers",
            "State is numbers of a fixed size: f8, i8, u8, or a table of them",
        )
