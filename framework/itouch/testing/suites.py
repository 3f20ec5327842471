"""The suites to inherit from: every check is a test of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest

from itouch.plugin import Device, Modality
from itouch.testing import declared, drivers, emulators, modalities, running, twins
from itouch.testing.checks import Check
from itouch.testing.subject import DeviceSubject, ModalitySubject

#: The checks of each suite, in the order in which they are run.
DEVICE_CHECKS: tuple[Check, ...] = (
    declared.declarations,
    declared.documentation,
    declared.parameters,
    declared.locked_axes,
    declared.imported,
    twins.fills,
    twins.finite,
    twins.pose,
    twins.frame,
    twins.kelvin,
    twins.rest,
    twins.command_untouched,
    twins.bounded,
    twins.state_declared,
    twins.determinism,
    twins.keeps_nothing,
    twins.allocates_nothing,
    twins.timing,
    running.runs,
    running.restores,
    running.stale,
    running.sigterm,
    drivers.fills,
    drivers.keeps_nothing,
    drivers.writes_in_read,
    drivers.reopens,
    drivers.timing,
    drivers.lifecycle,
    drivers.safe_on_exception,
    drivers.errors_are_named,
    drivers.transcript,
)
EMULATOR_CHECKS: tuple[Check, ...] = (emulators.agree, emulators.still, emulators.unplug)
MODALITY_CHECKS: tuple[Check, ...] = (
    modalities.declarations,
    modalities.documentation,
    modalities.runs,
    modalities.state_declared,
    modalities.determinism,
    modalities.own_fields,
    modalities.allocates_nothing,
    modalities.measures,
    modalities.order,
)


class Suite:
    """What all suites have: one test a check, which skips where the check does not apply."""

    checks: ClassVar[Sequence[Check]] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for one in cls.checks:
            name = "test_" + one.name.replace("-", "_")
            if name not in cls.__dict__ and not hasattr(cls, name):
                setattr(cls, name, _test(one))

    def subject(self) -> Any:
        """Return what is examined."""
        raise NotImplementedError


def _test(one: Check) -> Any:
    def test(self: Suite) -> None:
        finding = one.examine(self.subject())
        if finding.outcome == "left out":
            pytest.skip(finding.note)
        if finding.outcome == "failed":
            pytest.fail(f"{one.name}: {finding.note}", pytrace=False)

    test.__doc__ = one.title
    return test


class DeviceTests(Suite):
    """Tests of a device plugin; set ``device`` and ``name``, and ``params`` if not all have defaults."""

    checks = DEVICE_CHECKS
    device: ClassVar[type[Device]]
    name: ClassVar[str]
    params: ClassVar[Any] = None
    hardware: ClassVar[bool] = False
    transcript: ClassVar[Path | None] = None

    def subject(self) -> DeviceSubject:
        """Return the device class with its parameters."""
        return DeviceSubject(self.device, self.name, self.params, self.hardware, self.transcript)


class EmulatorTests(Suite):
    """Tests of a device's driver against its emulator; ``params`` say where both meet."""

    checks = EMULATOR_CHECKS
    device: ClassVar[type[Device]]
    name: ClassVar[str]
    params: ClassVar[Any] = None

    def subject(self) -> DeviceSubject:
        """Return the device class with its parameters."""
        return DeviceSubject(self.device, self.name, self.params)


class ModalityTests(Suite):
    """Tests of a modality plugin; set ``modality`` and ``scene``, a file or the text of one that uses it."""

    checks = MODALITY_CHECKS
    modality: ClassVar[type[Modality]]
    scene: ClassVar[str | Path]
    seconds: ClassVar[float] = 1.5

    def subject(self) -> ModalitySubject:
        """Return the modality class with its scene."""
        return ModalitySubject(self.modality, self.scene, self.seconds)
