"""The suites to inherit from: every check is a test of its own."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest

from itouch.moved import have_both_names
from itouch.plugin import Device, Modality
from itouch.testing import (
    call_times,
    continuation,
    contract,
    declared,
    declared_fields,
    drivers,
    emulators,
    engine_checks,
    hygiene,
    import_effects,
    joined,
    meaning,
    memory_checks,
    modality_checks,
    monitoring,
    twins,
)
from itouch.testing.checks import VITAL, Check, CheckResult, unexamined
from itouch.testing.harness import DeviceHarness
from itouch.testing.scenario import ModalityHarness

#: Checks of how a plugin behaves as a guest, which are part of every suite.
CONDUCT: tuple[Check, ...] = (
    hygiene.survives,
    hygiene.quiet,
    hygiene.surroundings,
    hygiene.errors_come_through,
    hygiene.params_untouched,
    memory_checks.allocates_nothing,
)
DRIVER_CHECKS: tuple[Check, ...] = (
    drivers.fills,
    memory_checks.driver_keeps_nothing,
    drivers.writes_in_read,
    call_times.driver_timing,
    call_times.lets_others_run,
    drivers.reopens,
)
#: The checks of each suite, in the order in which they are run.
DEVICE_CHECKS: tuple[Check, ...] = (
    contract.contract,
    declared.declarations,
    declared.units,
    meaning.meaning,
    meaning.roles,
    declared.documentation,
    declared.parameters,
    declared.limits_of_params,
    declared.locked_axes,
    monitoring.drives,
    monitoring.contract,
    import_effects.imported,
    *CONDUCT,
    hygiene.opens_nothing,
    twins.fills,
    twins.finite,
    twins.pose,
    twins.frame,
    twins.velocity,
    twins.kelvin,
    twins.rest,
    twins.command_untouched,
    twins.bounded,
    joined.twin,
    continuation.state_declared,
    continuation.determinism,
    memory_checks.keeps_nothing,
    call_times.twin_timing,
    hygiene.steady,
    engine_checks.runs,
    engine_checks.restores,
    engine_checks.stale,
    engine_checks.sigterm,
    *DRIVER_CHECKS,
    drivers.lifecycle,
    drivers.safe_on_exception,
    drivers.errors_are_named,
    drivers.transcript,
)
EMULATOR_CHECKS: tuple[Check, ...] = (
    *CONDUCT,
    emulators.still,
    emulators.agree,
    emulators.arrive,
    *DRIVER_CHECKS,
    emulators.unplug,
)
MODALITY_CHECKS: tuple[Check, ...] = (
    contract.contract,
    modality_checks.declarations,
    meaning.fields_meaning,
    modality_checks.documentation,
    modality_checks.parameters,
    import_effects.imported,
    *CONDUCT,
    hygiene.opens_nothing,
    modality_checks.runs,
    declared_fields.carries,
    declared_fields.touches,
    joined.modality,
    modality_checks.state_declared,
    modality_checks.determinism,
    modality_checks.own_fields,
    modality_checks.uses_given_state,
    call_times.modality_timing,
    hygiene.steady,
    modality_checks.measures,
    modality_checks.order,
)


class Suite:
    """What all suites have in common: one test per check, which is skipped if the check does not apply."""

    checks: ClassVar[Sequence[Check]] = ()
    _vital: ClassVar[dict[str, CheckResult]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        older = have_both_names(cls, "subject", "harness")
        if older:
            said = f"method 'subject' of {older} is 'harness' now: rename it"
            warnings.warn(said, DeprecationWarning, stacklevel=2)
        cls._vital = {}
        for one in cls.checks:
            name = "test_" + one.name.replace("-", "_")
            if name not in cls.__dict__ and not hasattr(cls, name):
                setattr(cls, name, _test(one))

    def harness(self) -> Any:
        """Return the harness in which the plugin is tested."""
        raise NotImplementedError

    def subject(self) -> Any:
        """Call ``harness`` of this class: the old name of that method, kept for one version."""
        warnings.warn("'subject' is 'harness' now: call that", DeprecationWarning, stacklevel=2)
        return Suite.harness(self)

    def examine(self, one: Check) -> CheckResult:
        """Run a check, unless a vital one has failed; each vital check is run once."""
        harness = self.harness()
        for vital in (other for other in self.checks if other.name in VITAL):
            if vital.name not in self._vital:
                self._vital[vital.name] = vital.examine(harness)
            if one is vital:
                return self._vital[vital.name]
            if self._vital[vital.name].outcome == "failed":
                return unexamined(one, vital.name)
        return one.examine(harness)


def _test(one: Check) -> Any:
    def test(self: Suite, record_property: Any) -> None:
        finding = self.examine(one)
        record_property(
            "itouch", [type(self).__name__, one.name, one.title, finding.outcome, finding.note, finding.seconds]
        )
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

    def harness(self) -> DeviceHarness:
        """Return the harness with the device class and its parameters."""
        return DeviceHarness(self.device, self.name, self.params, self.hardware, self.transcript)


class EmulatorTests(Suite):
    """Tests of a device's driver on its emulator; ``params`` name the port or address, or the emulator chooses one."""

    checks = EMULATOR_CHECKS
    device: ClassVar[type[Device]]
    name: ClassVar[str]
    params: ClassVar[Any] = None

    def harness(self) -> DeviceHarness:
        """Return the harness in which the driver runs on the device's emulator."""
        return DeviceHarness(self.device, self.name, self.params, emulated=True)


class ModalityTests(Suite):
    """Tests of a modality plugin; set ``modality`` and ``scene``, a file or the text of a scene that uses it.

    The scene is run until a touch has begun, slid and ended, and for at least ``seconds`` [s]; if it has no such touch,
    the operator's motion is replaced.  Without a scene, set ``name``, ``plugin.local``, and one is generated.
    """

    checks = MODALITY_CHECKS
    modality: ClassVar[type[Modality]]
    scene: ClassVar[str | Path | None] = None
    name: ClassVar[str] = ""
    seconds: ClassVar[float | None] = None

    def harness(self) -> ModalityHarness:
        """Return the harness with the modality class and its scene."""
        wanted = ModalityHarness(self.modality, self.scene, self.seconds, self.name)
        kept: ModalityHarness | None = type(self).__dict__.get("_kept")
        if kept is None or (kept.cls, kept.scene, kept.least, kept.name) != (
            wanted.cls,
            wanted.scene,
            wanted.least,
            wanted.name,
        ):
            kept = wanted
            setattr(type(self), "_kept", kept)  # its touch is found only once  # noqa: B010
        return kept
