"""The modality contract: a rendering engine that owns State, receives contact events and may command devices."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from itouch.moved import HasOldNames, with_old_fields
from itouch.plugin.bound import Bound
from itouch.plugin.contact_events import Contact, ContactArrays, ContactEvent
from itouch.plugin.measured import Measured
from itouch.plugin.record import Field, Record
from itouch.plugin.world import World


@with_old_fields(
    coming="remaining_distance", missed="fault", yields="yield_distance", presses="pressing_force",
    risen="height_correction", said="declared",
)  # fmt: skip
class SurfaceFields(NamedTuple):
    """A modality's declaration that it brings a device's surface to a probe's finger, and which of its fields say how.

    Each field is one that the modality declares (``fields``), has one number, and is named without the modality's name
    in front.

    Attributes
    ----------
    probe, device
        The probe, and the device that it names in ``surface-to``.
    renders
        Field: 1 where the surface renders the contact, 0 where the arm does so alone.
    present
        Field: 1 while it is the surface that touches the finger, so that its temperature is felt.
    distance
        Field: distance of the finger's pad from the surface [m]; below 0 while it is pressed in, infinite out of reach.
    gap
        Field: how far the surface is below the virtual one [m]; below 0 if it is above, infinite if there is no virtual
        one.  Over the first millimetre the arm takes over the normal force.
    remaining_distance
        Field: how far [m] the surface still has to move: to come, where it renders, or to withdraw, where the arm does;
        0 once it is there, below 0 if that is not known.  Until it is there, the force is handed over gradually between
        surface and arm.
    fault
        Field: why the surface renders no more: 1, it was not felt where it should be; 2, it was felt below that; 0,
        nothing is wrong.  The arm then renders the contact, and report and log tell where it happened first.
        `itouch.plugin.carried_surfaces` has these values, and the others on which framework and modality agree.
    yield_distance
        Field: how far [m] its command already yields because the surface presses too hard.  The framework (K4) then
        lowers the surface only by as much as its own yielding exceeds this, not by all of it again.
    pressing_force
        Field: how hard the finger presses on the surface now [N], where the device's reading is older than this tick:
        the arm's force follows it, and where it is more than the reading, safety leaves the arm less.  Below 0: as the
        device reads.
    height_correction
        Field: how much higher the surface is now than the device reads [m], where that reading is older; 0: it is where
        the device reads.  Monitors take the readings as they are.
    """

    probe: str
    device: str
    renders: str
    present: str
    distance: str
    gap: str
    remaining_distance: str = ""
    fault: str = ""
    yield_distance: str = ""
    pressing_force: str = ""
    height_correction: str = ""

    @property
    def declared(self) -> tuple[str, ...]:
        """The fields that are named."""
        return tuple(name for name in self[2:] if name)


@with_old_fields(damped="add_damping", said="declared")
class ContactFields(NamedTuple):
    """A modality's declaration that it computes the contact of a probe, and which of its fields say what it found.

    Each field is one that the modality declares (``fields``) and is named without the modality's name in front.  All is
    in the world frame.  It names ``object``, ``force``, ``normal`` and ``point``, or else ``found``.

    Attributes
    ----------
    probe
        The probe.
    object
        Field, one number: the number of the object that is touched; -1: none.
    force
        Field, three numbers: the force on the finger [N].  It may have any direction, except that the part along the
        normal never pulls: below 0 it counts as 0.
    normal
        Field, three numbers: the unit normal of the touched surface, out of the object.
    point
        Field, three numbers: the point of the surface that is touched [m].
    proxy
        Field, three numbers: where the finger's centre would be, were the surface not to give way [m].  Left out: where
        the finger touches ``point`` from outside.
    found
        Field: all of that as `itouch.plugin.geometry.proxy_step` writes it (``FOUND`` numbers), with up to four objects
        that are touched at once.
    add_damping
        Whether the framework is to add the damping of ``PROBE.coupling.damping`` along the normal; else ``force`` has
        all damping.
    """

    probe: str
    object: str = ""
    force: str = ""
    normal: str = ""
    point: str = ""
    proxy: str = ""
    found: str = ""
    add_damping: bool = False

    @property
    def declared(self) -> tuple[str, ...]:
        """The fields that are named."""
        return tuple(name for name in self[1:7] if name)


class Modality(HasOldNames, ABC):
    """A modality plugin.  ``model`` is what ``compile`` returned, read-only; everything that changes is in State.

    The fields that it declares appear in State as ``NAME.field``; it may write these, and the command channels that
    ``commands`` names, and nothing else.
    """

    _OLD_NAMES = {
        "hears": "subscribes_to", "goes_on": "persistent_fields", "dropped": "removed_fields",
        "lengthened": "extended_fields", "keeps_to": "probe_attributes", "carries": "surface_fields",
        "touches": "contact_fields", "attends": "uses_intermediate_ticks", "between": "on_intermediate_tick",
        "left_out": "on_skipped_time", "witness": "on_ground_truth", "ended": "contact_summary",
        "remarks": "contact_warnings",
    }  # fmt: skip

    #: Frozen dataclass of schema fields: its element under ``<interaction>``.
    Params: ClassVar[type]
    #: Frozen dataclass of schema fields: its element under ``<material>``, if it has one.
    Material: ClassVar[type | None] = None
    #: Kinds of event for which ``on_contact`` is called; MOVE comes in every tick of a contact.
    subscribes_to: ClassVar[frozenset[Contact]] = frozenset(Contact)
    #: What it measures of a contact, in the order of the columns on terminal, page and summary.
    measured: ClassVar[tuple[Measured, ...]] = ()
    #: Its fields that concern the person or the devices: they keep their values when a scene with other objects
    #: replaces this one between two touches.  All other fields begin as after ``reset``.
    persistent_fields: ClassVar[tuple[str, ...]] = ()
    #: Fields of earlier versions whose content is no longer needed: a session stored with them can still be restored.
    removed_fields: ClassVar[frozenset[str]] = frozenset()
    #: Fields whose arrays have become longer at their end than in earlier versions: what a session stored keeps its
    #: place, and the rest begins as after ``reset``.
    extended_fields: ClassVar[frozenset[str]] = frozenset()
    #: If it carries a surface: which of the probe's attributes ``clearance`` and ``plate-angle`` it respects.  A scene
    #: that sets the other, which then has no effect, gets a warning.
    probe_attributes: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def compile(self, name: str, params: Any, world: World) -> Any:
        """Return the read-only model.

        Raises
        ------
        ValueError
            If the parameters cannot work together; the message becomes a problem at the place of the element, or, for a
            `ParameterError`, of the attribute.
        """

    def notices(self, model: Any) -> tuple[str, ...]:
        """Return what must be known before a run, one sentence each; shown by check and run, and put in the report."""
        return ()

    def fields(self, model: Any) -> tuple[Field, ...]:
        """Return the State that the modality needs."""
        return ()

    def commands(self, model: Any) -> tuple[str, ...]:
        """Return the command channels that it writes, as ``device.channel``; each has exactly one writer."""
        return ()

    def surface_fields(self, model: Any) -> SurfaceFields | None:
        """Return the declaration of the surface that it brings to a finger in place of the default carrier, or None.

        Its ``update`` then runs in each tick after contact and before the force on the finger: it finds the virtual
        surface in ``PROBE.surface_height`` (the highest below the finger), ``PROBE.normal`` and ``PROBE.object`` (-1:
        nothing is touched), and commands the device.  Touch-off, the withdrawal of T4, the speed at which a surface
        may approach, and every other limit stay with the framework, and have the last word.
        """
        return None

    def contact_fields(self, model: Any) -> ContactFields | None:
        """Return the declaration of the contact that it computes in place of the framework's proxy, or None.

        Its ``update`` then runs in each tick right after the readings, and finds the finger in ``PROBE.hip`` [m] and
        ``PROBE.velocity`` [m/s], the objects in ``objects.pose`` and ``objects.twist``, and how stiff and damped each
        is to be in ``PROBE.coupling.stiffness`` [N/m] and ``PROBE.coupling.damping`` [N s/m], one number per object:
        that of its material, less what would not be stable on the arm; behind a wire that changes while running.  The
        shapes are in ``World.geometry``.  Effects of surfaces, events, limits, heat and what a surface renders follow
        from what it says as they do from the framework's own contact.
        """
        return None

    def reads(self, model: Any) -> tuple[str, ...] | None:
        """Return the fields of State that it reads besides its own, to be shown in the plan; None: not declared.

        A name that ends in ``*`` stands for all fields that begin like this.
        """
        return None

    @abstractmethod
    def reset(self, model: Any, state: Record) -> None:
        """Set its fields to their initial values."""

    def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
        """Receive a contact event; called within the tick, before ``update``."""

    def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound | None:
        """Return what ``on_contact`` does with these, which stay the same, as one compiled call; None: it is Python.

        The numbers of an event stand in ``event`` then; where its kind is none of those in ``subscribes_to``, or -1,
        nothing is done.  A call that returns another number than 0 has changed nothing, and leaves this event to
        ``on_contact``.
        """
        return None

    def uses_intermediate_ticks(self, model: Any) -> bool:
        """Tell whether ``on_intermediate_tick`` is to be called in the ticks between its updates."""
        return False

    def on_intermediate_tick(self, model: Any, state: Record) -> None:
        """Use what has arrived in a tick without an ``update``, and write its commands anew if there is a reason to.

        ``DEVICE.measured`` in State has, for each reading of the device, the tick in which it was measured, which may
        be long ago.  For a device behind a wire, ``DEVICE.out.CHANNEL`` has the newest command that has left, and
        ``DEVICE.left`` the tick in which it left.
        """

    @abstractmethod
    def update(self, model: Any, state: Record, period: float) -> None:
        """Advance its fields by one period and write its commands."""

    def on_skipped_time(self, model: Any, state: Record, seconds: float) -> None:
        """Advance its fields by the ``seconds`` [s] that a late loop has left out between two ticks.

        Called only with hardware in the rig, before the next tick: in that time a real finger has gone on touching, and
        a real display heating, unobserved.  Readings are still those from before.  Simulated devices have stood still:
        for what models one of these (``WorldDevice.twin``) there is nothing to do.
        """

    def on_ground_truth(self, model: Any, state: Record, twins: Mapping[str, Record]) -> None:
        """Receive the true State of the devices' twins, for its figures; only if a virtual rig runs the scene in step.

        Called after each tick with the State of each device's twin as it was when that tick's readings were taken.
        Nothing that is rendered may depend on it.
        """

    def bound_update(self, model: Any, state: Record, period: float) -> Bound | tuple[Bound, ...] | None:
        """Return ``update`` with these arguments, which stay the same, as compiled calls; None: it is Python.

        They run joined with the steps beside them.  A call that does not return 0 must have changed nothing, and leaves
        this tick to ``update``.  Several calls run one after the other; only the first one may leave it to ``update``.
        """
        return None

    def measures(
        self, model: Any, state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return the report's entries for the contact that has just ended, or is still open.

        Figures that ``measured`` declares have a column of their own wherever contacts are shown, and are null if they
        are not returned; other keys go to the report's data only.
        """
        return {}

    def contact_summary(self, model: Any, entry: Mapping[str, Any]) -> str:
        """Return a few words that a terminal shows when a contact has ended; empty: nothing.

        ``entry`` is the report's entry of the contact, with what ``measures`` has returned.
        """
        return ""

    def contact_warnings(self, model: Any, entry: Mapping[str, Any]) -> tuple[str, ...]:
        """Return what was wrong in a contact, one sentence each, which a terminal shows below the table.

        ``entry`` is the report's entry of the contact.
        """
        return ()

    def status(self, model: Any, state: Record) -> str:
        """Return a few words on it for the live line, such as ``plate 60 %``; empty: nothing."""
        return ""

    def report(self, model: Any, state: Record) -> dict[str, Any]:
        """Return the report's entries for the whole run, as plain data for JSON; empty: nothing."""
        return {}
