"""Optional groups of a device's declarations: timing, opening, emulation, operator input, mechanics.

Each attribute of a group was once an attribute of `Device` with the same name, and can still be declared as one.  The
framework reads these attributes: a group that a class declares is unfolded into them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

from itouch.moved import HasOldNames, with_old_fields
from itouch.plugin.emulator import Emulator as _Emulator
from itouch.plugin.fit import Fit


@with_old_fields(waits="command_wait")
@dataclass(frozen=True, slots=True)
class Timing:
    """How long an exchange with the device takes, and how long it can do without one.

    Attributes
    ----------
    blocking
        True if ``read`` and ``write`` wait for the wire and must run in an I/O thread.
    period
        Time between two exchanges [s]; 0 means one in every servo tick.
    delay
        Time that one exchange of a blocking device takes [s]; its twin's readings are that old, its commands that late.
    exchange_time
        Time that one exchange over the wire takes in practice [s]; used only for simulating it in step.
    command_wait
        How long [s] a blocking device waits after an exchange for a command that differs from the last one, before it
        exchanges without one; so a new command leaves at once.  0: it exchanges again immediately.
    watchdog
        Time without a command [s] after which the device makes itself safe; armed by ``open``.  None: it does not.
    """

    blocking: bool = False
    period: float = 0.0
    delay: float = 0.0
    exchange_time: float = 0.0
    command_wait: float = 0.0
    watchdog: float | None = None


@dataclass(frozen=True, slots=True)
class Opening:
    """What opening the device does, and who may do it; ``discover`` finds such devices.

    Attributes
    ----------
    moves_on_open
        True if ``open`` moves the mechanism, as homing does: a restored session then opens it only when it is enabled.
    second_opener
        True if another process may open the device too, and call ``make_safe``, when the servo process has died.
    twin_only
        True if no working driver is shipped and only the twin can run.
    """

    moves_on_open: bool = False
    second_opener: bool = False
    twin_only: bool = False


@with_old_fields(fits="calibrations")
@dataclass(frozen=True, slots=True)
class Emulation:
    """The emulator of the device's wire, and the calibrations of the device.

    Attributes
    ----------
    Emulator
        The class that speaks the device's protocol with the twin behind it; None: there is no emulator.
    calibrations
        Calibrations that the device offers besides those of its mount.
    """

    Emulator: type[_Emulator] | None = None
    calibrations: tuple[Fit, ...] = ()


@with_old_fields(led_by="input_source")
@dataclass(frozen=True, slots=True)
class OperatorInput:
    """Who moves the finger on the device's twin, if not the scene's operator.

    Attributes
    ----------
    input_source
        "mouse", "keyboard" or "gamepad", with which a person leads the operator's hand; or "recording", whose path is
        given; empty: the scene's operator.
    """

    input_source: str = ""


@dataclass(frozen=True, slots=True)
class Mechanics:
    """The stiffness and damping of virtual walls that a device bears.

    Attributes
    ----------
    max_stiffness
        Greatest stiffness [N/m] that the device can render stably; None: not stated.
    damping
        Its own damping [N s/m]; None: not stated.
    """

    max_stiffness: float | None = None
    damping: float | None = None


#: Attribute of `Device` -> class of its group.
GROUPS: dict[str, type] = {
    "timing": Timing, "opening": Opening, "emulation": Emulation, "operator_input": OperatorInput,
    "mechanics": Mechanics,
}  # fmt: skip


class Grouped(HasOldNames):
    """Unfolds the groups that a class declares into single attributes, which the framework reads."""

    _OLD_NAMES = {"fits": "calibrations", "led_by": "input_source", "waits": "command_wait"}

    timing: ClassVar[Timing] = Timing()
    opening: ClassVar[Opening] = Opening()
    emulation: ClassVar[Emulation] = Emulation()
    operator_input: ClassVar[OperatorInput] = OperatorInput()
    mechanics: ClassVar[Mechanics] = Mechanics()

    #: The attributes of the groups as they were declared before there were groups: for the framework and older plugins.
    blocking: ClassVar[bool] = False
    period: ClassVar[float] = 0.0
    delay: ClassVar[float] = 0.0
    exchange_time: ClassVar[float] = 0.0
    command_wait: ClassVar[float] = 0.0
    watchdog: ClassVar[float | None] = None
    moves_on_open: ClassVar[bool] = False
    second_opener: ClassVar[bool] = False
    twin_only: ClassVar[bool] = False
    Emulator: ClassVar[type[_Emulator] | None] = None
    calibrations: ClassVar[tuple[Fit, ...]] = ()
    input_source: ClassVar[str] = ""
    max_stiffness: ClassVar[float | None] = None
    damping: ClassVar[float | None] = None

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)  # first: what is declared by an old name is then no more missing
        old = []
        for name, kind in GROUPS.items():
            members = [member.name for member in fields(kind)]
            if name in cls.__dict__:
                group = cls.__dict__[name]
                if not isinstance(group, kind):
                    raise TypeError(f"{cls.__name__}.{name} is {group!r}: write {name} = {kind.__name__}(...)")
                for member in members:
                    if member not in cls.__dict__:
                        setattr(cls, member, getattr(group, member))
            else:
                old += [f"attribute '{m}' belongs to a group: write {name} = {kind.__name__}({m}=...)"
                        for m in members if m in cls.__dict__]  # fmt: skip
        cls.deprecations = tuple(dict.fromkeys([*cls.deprecations, *old]))
