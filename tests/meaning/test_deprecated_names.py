"""What plugins were written with before it had other names: understood for one version, and told."""

from __future__ import annotations

import inspect
import math
import warnings
from pathlib import Path
from types import FunctionType
from typing import Any, ClassVar

import numpy as np
import pytest

import itouch
import itouch.plugin
from itouch.moved import HasOldNames
from itouch.plugin import (
    Attached,
    Contact,
    Device,
    Emulation,
    Field,
    OperatorInput,
    Record,
    Role,
    Timing,
    Twin,
    TwinInputs,
    discovery,
    temperature,
)
from itouch.testing import DeviceHarness, DeviceTests
from itouch.world import undeclared


class Older(Device):
    """A block whose twin learns the room's temperature, as it was written a version ago."""

    class Params:
        """Nothing."""

    reads = (temperature("block", Role.OTHER_TEMPERATURE),)
    led_by = "mouse"

    class Twin(Twin):
        """A block at the temperature of the room."""

        def stand(self, ambient: float, skin_temperature: float | None) -> None:
            super().stand(ambient, skin_temperature)
            self.room = ambient

        def fields(self) -> tuple[Field, ...]:
            return (Field("temperature", unit="K", doc="temperature of the block"),)

        def reset(self, state: Record, rng: np.random.Generator) -> None:
            state["temperature"] = self.room

        def step(self, state: Record, command: Record, touch: Any, period: float) -> None:
            pass

        def read(self, state: Record, reading: Record) -> bool:
            reading["block"] = state["temperature"]
            return True

    @classmethod
    def attached(cls) -> tuple[Attached, ...]:
        return (Attached("nowhere", False, "it is an example"),)


def test_an_older_device_is_found_led_and_stands_in_its_room() -> None:
    (found,) = Older.discover() or ()
    assert (found.where, Older.input_source) == ("nowhere", "mouse")
    twin = Older.Twin(Older.Params())
    with pytest.warns(DeprecationWarning, match="'stand' is 'set_environment' now"):  # its own call of the base's
        twin.set_environment(291.0, None)
    state, reading = Record.of(twin.fields()), Record.of(Field.of(channel) for channel in Older.reads)
    twin.reset(state, np.random.default_rng(0))
    assert twin.read(state, reading) and reading["block"] == 291.0


def test_what_is_called_otherwise_now_is_told_once_each() -> None:
    told = " ".join((*Older.deprecations, *Older.Twin.deprecations))
    with pytest.warns(DeprecationWarning, match="'undeclared' is 'declaration_problems' now: use that"):
        assert Older.undeclared == Older.declaration_problems  # type: ignore[attr-defined]
    with pytest.warns(DeprecationWarning, match="'outdated' is 'deprecations' now: use that"):
        assert Older.outdated == Older.deprecations  # type: ignore[attr-defined]
    for old, new in (("led_by", "input_source"), ("attached", "discover"), ("stand", "set_environment")):
        assert told.count(f"'{old}'") == 1 and f"'{new}'" in told


def test_old_names_that_are_used_warn_and_are_what_they_were() -> None:
    with pytest.warns(DeprecationWarning, match="TwinInputs"):
        assert itouch.plugin.Touch is itouch.plugin.TwinInputs  # type: ignore[attr-defined]
    with pytest.warns(DeprecationWarning, match="input_source"):
        assert OperatorInput(led_by="keyboard") == OperatorInput(input_source="keyboard")
    for old, new in (("Carries", "SurfaceFields"), ("Touches", "ContactFields"), ("HeardContact", "ContactArrays"),
                     ("Stamps", "Timestamps")):  # fmt: skip
        with pytest.warns(DeprecationWarning, match=f"'itouch.plugin.{old}' is '{new}' now: import that"):
            assert getattr(itouch.plugin, old) is getattr(itouch.plugin, new)
    with pytest.raises(AttributeError, match="no attribute 'Tuch'"):
        _ = itouch.plugin.Tuch  # type: ignore[attr-defined]


def _old_names() -> list[tuple[type[HasOldNames], str, str]]:
    """Return class, old and new name of each member that has another name now."""
    bases = [getattr(itouch.plugin, name) for name in itouch.plugin.__all__]
    kinds = dict.fromkeys(kind for base in bases if isinstance(base, type) for kind in base.__mro__)
    kept = [kind for kind in kinds if issubclass(kind, HasOldNames)]
    return [(kind, *names) for kind in kept for names in vars(kind).get("_OLD_NAMES", {}).items()]


def _made(base: type, **members: Any) -> type:
    """Return a class made of a base, without what its abstract methods would have to say."""
    made = type("Made", (base,), {"reads": (), **members} if issubclass(base, Device) else members)
    made.__abstractmethods__ = frozenset()  # type: ignore[attr-defined]
    return made


@pytest.mark.parametrize(("base", "old", "new"), _old_names())
def test_a_member_that_a_plugin_defines_by_its_old_name_is_the_member(base: type, old: str, new: str) -> None:
    member = inspect.getattr_static(base, new)
    if isinstance(member, FunctionType | classmethod):
        wrapped = type(member) if isinstance(member, classmethod) else (lambda method: method)
        older = _made(base, **{old: wrapped(lambda *given: "its own")})
        assert getattr(object.__new__(older), new)() == "its own"
    else:
        value = property(lambda self: "its own") if isinstance(member, property) else "its own"
        older = _made(base, **{old: value})
        assert getattr(object.__new__(older), new) == "its own"
    assert [one for one in older.deprecations if f"'{old}'" in one] == [f"'{old}' of Made is '{new}' now: rename it"]
    assert _made(older).deprecations == older.deprecations  # told once, not by each class below


@pytest.mark.parametrize(("base", "old", "new"), _old_names())
def test_a_member_is_reached_by_its_old_name_with_a_warning(base: type, old: str, new: str) -> None:
    member = inspect.getattr_static(base, new)
    if isinstance(member, FunctionType | classmethod):
        wrapped = type(member) if isinstance(member, classmethod) else (lambda method: method)
        one = object.__new__(_made(base, **{new: wrapped(lambda *given: "its own")}))
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{new}' now: call that") as told:
            assert getattr(one, old)() == "its own"
    else:
        one = object.__new__(_made(base, **{new: "its own"}))
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{new}' now: use that") as told:
            assert getattr(one, old) == "its own"
    assert len(told) == 1 and told[0].filename == __file__  # at the plugin's line


def _old_methods() -> list[tuple[type[HasOldNames], str, str]]:
    """Return those of ``_old_names`` that are methods."""
    return [
        (base, old, new) for base, old, new in _old_names()
        if isinstance(inspect.getattr_static(base, new), FunctionType | classmethod)
    ]  # fmt: skip


@pytest.mark.parametrize(("base", "old", "new"), _old_methods())
def test_what_an_older_class_calls_of_its_parent_is_what_the_parent_does(base: type, old: str, new: str) -> None:
    member = inspect.getattr_static(base, new)
    wrapped = type(member) if isinstance(member, classmethod) else (lambda method: method)
    newer = _made(base, **{new: wrapped(lambda *given: ["parent"])})

    def own(self: Any) -> list[str]:
        found: list[str] = [*getattr(super(older, self), old)(), "child"]
        return found

    older = _made(newer, **{old: wrapped(own)})
    for name in (old, new):
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{new}' now: call that"):
            assert getattr(object.__new__(older), name)() == ["parent", "child"]


def test_a_value_that_is_set_by_one_name_is_read_by_the_other() -> None:
    older = _made(itouch.plugin.Modality, hears=frozenset({Contact.END}))
    for one in (object.__new__(older), object.__new__(_made(itouch.plugin.Modality))):
        with pytest.warns(DeprecationWarning, match="'hears' is 'subscribes_to' now: set that"):
            one.hears = frozenset({Contact.BEGIN})
        assert one.subscribes_to == frozenset({Contact.BEGIN})
        one.subscribes_to = frozenset()
        with pytest.warns(DeprecationWarning, match="'hears' is 'subscribes_to' now: use that"):
            assert one.hears == frozenset()


def test_a_group_with_an_old_name_beside_what_is_declared_alone_loses_nothing() -> None:
    """Unfolding a group must not put its default in the place of what the class says by the old name."""
    older = _made(Device, timing=Timing(blocking=True), waits=0.01)
    assert (older.blocking, older.command_wait) == (True, 0.01)
    assert any("timing = Timing(command_wait=...)" in one for one in _made(Device, command_wait=0.01).deprecations)
    for _ in range(3):
        older = _made(older)  # classes of classes, as a test or a campaign makes them
        assert (older.blocking, older.command_wait) == (True, 0.01)
    grouped = _made(_made(_made(_made(Device, timing=Timing(command_wait=0.03)))))
    assert grouped.command_wait == 0.03 and not grouped.deprecations
    for _ in range(3):
        older = _made(older)  # classes of classes, as a test or a campaign makes them
        assert (older.blocking, older.command_wait) == (True, 0.01)
    grouped = _made(_made(_made(_made(Device, timing=Timing(command_wait=0.03)))))
    assert grouped.command_wait == 0.03 and not grouped.deprecations
    newer = _made(older, timing=Timing(command_wait=0.02))
    assert newer.command_wait == 0.02
    with pytest.warns(DeprecationWarning, match="'waits' is 'command_wait' now: use that"):
        assert newer.waits == 0.02


def test_an_older_device_reads_what_the_framework_sets_by_the_new_name() -> None:
    class Reading(Older):
        patience = 2.0  # it has declared its own, and still the framework's holds

        def open(self) -> None: ...

        def close(self) -> None: ...

        def read(self, reading: Record) -> bool:
            return bool(self.patience == 20.0 and self.stamps is self.limits)  # type: ignore[attr-defined]

    device = Reading(None)
    assert device.timeout_factor == 2.0
    device.timeout_factor, device.timestamps = 20.0, device.limits  # type: ignore[assignment]
    with pytest.warns(DeprecationWarning) as told:
        assert device.read(Record.of(()))
    assert {str(one.message) for one in told} == {
        "'patience' is 'timeout_factor' now: use that", "'stamps' is 'timestamps' now: use that",
    }  # fmt: skip


def test_methods_of_what_the_framework_makes_are_called_by_their_old_names() -> None:
    figure = itouch.plugin.Measured("k", "1", "d", required_value=True, failure_reason="it was not")
    times = itouch.plugin.Timestamps(["pose"])
    device = itouch.plugin.WorldDevice("d", "p", None, (), (), {}, True)
    watched = itouch.plugin.Watched("d", "p", None, (), ())
    for one, old, new, given in (
        (figure, "broken", "violated_by", (False,)), (figure, "told", "formatted", (0.25,)),
        (times, "left", "command_sent", ()), (times, "moments", "measurement_times", ()),
        (device, "truth", "true_field", (Role.HEAT_FLUX,)), (watched, "obeys", "commands_with", (Role.DRIVE,)),
    ):  # fmt: skip
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{new}' now: call that"):
            found = getattr(one, old)(*given)
        if old != "moments":  # it tells the time
            assert found == getattr(one, new)(*given)


def test_an_older_monitor_watches_as_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole session: its budget, its moments, what it forgets, and that it is checked with the finger's position."""

    class Watches(itouch.plugin.Monitor):
        name, placed, moments = "older", True, ("since",)
        heard: ClassVar[list[str]] = []

        @classmethod
        def of(cls, device: itouch.plugin.Watched) -> tuple[Watches, ...]:
            return (cls(device),) if device.obeys(Role.FORCE_ON_OPERATOR) else ()

        def fields(self) -> tuple[Field, ...]:
            return (Field("since", unit="s", doc="when it began"),)

        def forget(self, state: Record) -> None:
            self.heard.append("forget")

        def spent(self, state: Record) -> str:
            self.heard.append("spent")
            return ""

        def check(self, state: Record, reading: Record, sent: Record, moment: itouch.plugin.Moment) -> float:
            if math.isfinite(moment.strayed + moment.finger[0]):
                self.heard.append("placed")
            return 1.0

    offered = discovery.Catalog.monitors
    monkeypatch.setattr(discovery.Catalog, "monitors", lambda self: (*offered(self), Watches))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own uses of old names
        session = itouch.build(Path(__file__).parents[2] / "scenes" / "first_touch.xml")
        session.run(0.05)
    assert "forget" in Watches.heard
    told = " ".join(undeclared(session.model))
    for old in ("placed", "moments", "forget", "spent"):
        assert f"'{old}' of Watches is" in told
    (installed,) = [one for one in session.model.devices["arm"].monitors if one.name == "older"]
    assert installed.needs_finger_position and installed.time_fields == ("since",)


def test_an_older_twin_writes_to_its_inputs_by_their_old_names() -> None:
    touch = TwinInputs(force=1.5)
    for old, new in (("face", "force_and_gap"), ("skin", "skin_temperature"), ("taken", "heat_flux"),
                     ("beside", "total_heat_flux")):  # fmt: skip
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{new}' now: use that"):
            getattr(touch, old)[0] = 3.0
        assert getattr(touch, new)[0] == 3.0
    assert touch.force == 3.0


#: What is made with which old keywords -> by which new ones.
KEYWORDS: list[tuple[type, dict[str, Any], dict[str, Any], dict[str, str]]] = [
    (OperatorInput, {}, {"led_by": "mouse"}, {"led_by": "input_source"}),
    (Timing, {}, {"waits": 0.01}, {"waits": "command_wait"}),
    (Emulation, {}, {"fits": ()}, {"fits": "calibrations"}),
    (itouch.plugin.Moment, {}, {"strayed": 0.5}, {"strayed": "tracking_error"}),
    (
        itouch.plugin.Fit,
        {"kind": "k", "doc": "d", "columns": (), "solve": len},
        {"lacks": str, "days": 3.0},
        {"lacks": "missing_parameters", "days": "valid_days"},
    ),
    (
        itouch.plugin.Measured,
        {"key": "k", "unit": "1", "doc": "d"},
        {"must": True, "otherwise": "it was not", "worst": "greatest", "head": "h", "error": True},
        {
            "must": "required_value", "otherwise": "failure_reason", "worst": "maximum_label", "head": "short_title",
            "error": "relative_error",
        },
    ),
    (itouch.plugin.ContactFields, {"probe": "tip"}, {"damped": True}, {"damped": "add_damping"}),
    (
        itouch.plugin.SurfaceFields,
        dict.fromkeys(("probe", "device", "renders", "present", "distance", "gap"), "a"),
        {"coming": "c", "missed": "m", "yields": "y", "presses": "p", "risen": "r"},
        {
            "coming": "remaining_distance", "missed": "fault", "yields": "yield_distance",
            "presses": "pressing_force", "risen": "height_correction",
        },
    ),
]  # fmt: skip


@pytest.mark.parametrize(("cls", "rest", "given", "names"), KEYWORDS)
def test_old_keywords_and_attributes_of_named_values_are_understood(
    cls: Any, rest: dict[str, Any], given: dict[str, Any], names: dict[str, str]
) -> None:
    newer = cls(**rest, **{names[old]: value for old, value in given.items()})
    for old, value in given.items():
        with pytest.warns(
            DeprecationWarning, match=f"{cls.__name__}: '{old}' is '{names[old]}' now: write that"
        ) as told:
            others = {names[other]: given[other] for other in given if other != old}
            older = cls(**rest, **others, **{old: value})
        assert told[0].filename == __file__ and getattr(older, names[old]) == value
        with pytest.warns(DeprecationWarning, match=f"'{old}' is '{names[old]}' now: use that"):
            assert getattr(newer, old) == value
        if isinstance(newer, tuple):
            with pytest.warns(DeprecationWarning, match=f"'{old}' is '{names[old]}' now: write that"):
                assert newer._replace(**{old: value}) == newer  # type: ignore[attr-defined]


def test_new_names_are_reached_by_their_old_ones_from_outside() -> None:
    class Newer(Older):
        @classmethod
        def discover(cls) -> tuple[Attached, ...]:
            return ()

        class Twin(Older.Twin):
            def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
                self.room = ambient + 1.0

    twin = Newer.Twin(Newer.Params())
    twin.set_environment(290.0, None)
    assert twin.room == 291.0
    plain = type("Plain", (Twin,), {"step": lambda *_: None, "read": lambda *_: True})(None)
    with pytest.warns(DeprecationWarning):
        plain.stand(290.0, None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert OperatorInput() == OperatorInput(input_source="")


class NewerTwin(Twin):
    """A twin in today's words, of which others make their own."""

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
        self.heard = ambient, skin_temperature

    def step(self, state: Record, command: Record, touch: Any, period: float) -> None:
        pass

    def read(self, state: Record, reading: Record) -> bool:
        return True


def test_an_older_twin_made_of_a_newer_one_reaches_what_its_parent_does() -> None:
    class Made(NewerTwin):
        def stand(self, ambient: float, skin_temperature: float | None) -> None:
            super().stand(ambient + 1.0, skin_temperature)
            self.own = True

    class MadeOfThat(Made):
        def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
            super().set_environment(ambient + 1.0, skin_temperature)

    for cls, heard in ((Made, (291.0, 305.0)), (MadeOfThat, (292.0, 305.0))):
        for name in ("set_environment", "stand"):
            twin = cls(None)
            with pytest.warns(DeprecationWarning, match="'stand' is 'set_environment' now"):
                getattr(twin, name)(290.0, 305.0)
            assert (twin.heard, twin.own) == (heard, True), (cls.__name__, name)


def test_an_older_twin_made_of_the_thermal_displays_stands_in_its_room() -> None:
    from itouch_thermal.display.display_twin import DisplayTwin
    from itouch_thermal.display.params import DisplayParams

    class Made(DisplayTwin):
        def stand(self, ambient: float, skin_temperature: float | None) -> None:
            super().stand(ambient, skin_temperature)

    twin, plain = Made(DisplayParams()), DisplayTwin(DisplayParams())
    plain.set_environment(288.0, 303.0)
    with pytest.warns(DeprecationWarning):
        twin.set_environment(288.0, 303.0)
    assert twin.params == plain.params and twin.params.skin_temperature == 303.0
    states = [Record.of(one.fields()) for one in (twin, plain)]
    for one, state in zip((twin, plain), states, strict=True):
        one.reset(state, np.random.default_rng(0))
    assert states[0].tobytes() == states[1].tobytes()


def test_a_twin_that_takes_the_method_from_beside_its_base_has_it_under_both_names() -> None:
    class Beside:
        def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
            self.room = ambient

    class OlderBeside:
        def stand(self, ambient: float, skin_temperature: float | None) -> None:
            self.room = ambient

    parts = {"step": lambda *_: None, "read": lambda *_: True}
    for beside in (Beside, OlderBeside):
        for name in ("set_environment", "stand"):
            twin = type("Mixed", (beside, Twin), parts)(None)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                getattr(twin, name)(290.0, None)
            assert twin.room == 290.0, (beside.__name__, name)
    assert "OlderBeside" in type("Mixed", (OlderBeside, Twin), parts).deprecations[0]


def test_an_older_device_made_of_a_newer_one_finds_what_its_parent_finds() -> None:
    here, there = Attached("here", True, ""), Attached("there", True, "")

    class Newer(Device):
        reads = Older.reads

        @classmethod
        def discover(cls) -> tuple[Attached, ...]:
            return (here,)

    class Made(Newer):
        @classmethod
        def attached(cls) -> tuple[Attached, ...]:
            return (*(super().attached() or ()), there)

    for look in (Made.discover, Made.attached):
        with pytest.warns(DeprecationWarning, match="'attached' is 'discover' now"):
            assert look() == (here, there)


def test_a_suite_written_with_the_old_name_is_tested_in_its_own_harness_and_warns() -> None:
    with pytest.warns(DeprecationWarning, match="method 'subject' of Named is 'harness' now: rename it"):

        class Named(DeviceTests):
            device, name = Older, "older"

            def subject(self) -> DeviceHarness:
                return DeviceHarness(Older, "by another name")

    assert Named().harness().name == "by another name"
    newer = type("Newer", (DeviceTests,), {"device": Older, "name": "older"})()
    with pytest.warns(DeprecationWarning, match="'subject' is 'harness' now: call that"):
        assert newer.subject().name == "older"
