"""The State fields of the encountered surface, and their indices for kernels: what it reports and what it remembers."""

from __future__ import annotations

from dataclasses import replace

from itouch.plugin import Field
from itouch.plugin.kernels import Block, places

#: For how many ticks at most it is remembered how the slope changed: 6 ms at 4 kHz.
MOST_KINKS = 24
#: First what is reported of the surface (`itouch.plugin.SurfaceFields`), then what is remembered.
FIELDS = tuple(
    Field(name, unit=unit, doc=doc, show="no")
    for name, unit, doc in (
        ("takes", "1", "1: it takes the contact to be the surface's to render, 0: the arm's"),
        ("at_finger", "1", "1: it takes what touches the finger to be the surface"),
        ("distance", "m", "how far the finger's pad is from it, below 0 where it is pressed in"),
        ("gap", "m", "by how much it is short of the virtual surface, infinite where there is none"),
        ("coming", "m", "how far it still has to come or to go"),
        ("lost", "1", "1: it was not felt where it should be, 2: it was felt below that"),
        ("yields", "m", "how far it gives way, as it presses harder than it may"),
        ("arrived", "1", "1: it is where the virtual surface is, 0: it comes or goes"),
        ("press", "m", "how far it may be in the finger as it comes or goes; below 0: away from it"),
        ("free", "s", "how long there has been no virtual contact"),
        ("unfelt", "s", "how long it should have been felt and was not"),
        ("give", "m/N", "how far the device gives way under a force, as learned"),
        ("lag", "s", "how late the device is where it goes up or down, as learned"),
        ("unasked", "s", "how long it has been felt though there is no virtual contact; less again while it is not"),
        ("bends", "m/s^2", "how fast the speed of the virtual surface's height changes, smoothed"),
        ("haste", "m/s^2", "how much of that is because finger or object change their speed"),
        ("inertia", "s^2", "how far behind the device is for each m/s2 of that, as learned"),
        ("here", "m", "its height a tick ago"),
        ("speed", "m/s", "how fast it rose then"),
        ("rushes", "m/s^2", "how fast that changed, smoothed as its control does"),
        ("shift", "m", "height offset commanded for the virtual surface's curvature"),
        ("slower", "m/s", "by how much slower it comes to the finger, because the finger accelerates downwards"),
        ("waited", "m", "by how much less it has therefore come since it set out"),
    )
)
FIELDS += (
    Field(
        "evened", unit="m", doc="the height of the virtual surface without the steps in which an arm reads", show="no"
    ),
    Field("evened_x", unit="m", doc="x of the finger, a step of its reading in 1 ms", show="no"),
    Field("evened_y", unit="m", doc="y of it, likewise", show="no"),
    Field("evened_z", unit="m", doc="height of its lowest point, likewise", show="no"),
    Field("kinks", "f8", MOST_KINKS, unit="m/s^2", doc="how fast a slope bends it, the newest tick first", show="no"),
)

#: For how many ticks the motion of the virtual surface is remembered behind a wire: older readings teach nothing.
PAST = 128
#: What is also remembered behind a wire: the finger, the wire, and where device and virtual surface are when a command
#: acts.
OVER_WIRE: tuple[Field, ...] = (
    Field("goes", "f8", 6, unit="mixed", doc="place [m], speed [m/s] and acceleration [m/s2] of the finger, x and y"),
    Field("lifts_before", unit="m/s", doc="how fast the object lifted the virtual surface a tick ago, smoothed"),
    Field("lift_speed", unit="m/s", doc="how fast it lifts that"),
    Field("lift_hastens", unit="m/s^2", doc="how fast that changes"),
    Field("ahead", unit="s", doc="observed delay from a command to the midpoint of its effect"),
    Field("hold", unit="s", doc="for how long a command acts, as observed"),
    Field("commands", unit="1", doc="how many commands had left"),
    Field("read_at", unit="tick", doc="when the newest reading was measured"),
    Field("climbs_by", unit="m", doc="how much higher the virtual surface will be when its command acts"),
    Field("since", unit="m", doc="how much higher it is by its commands than when it was read last"),
    Field("behind", unit="m", doc="how far it is below the command that acts"),
    Field("rests", unit="s", doc="for how long it has rested at the virtual surface with a finger on it"),
    Field("pressed_now", unit="N", doc="how hard the finger presses on it now, by the last reading and since"),
    Field("place", unit="m", doc="how high it was a tick ago, by readings and commands"),
    Field("sent_to", unit="m", doc="how high its commands had sent it then"),
    Field("at_most", unit="m", doc="how much higher than when it was read last it may be, by its commands since then"),
    Field("past", "f8", (PAST, 3), unit="mixed", doc="of each tick: how long it had rested [s], how fast the speed of "
          "the virtual surface changed [m/s2], and how high the finger's lowest point was [m]"),
)  # fmt: skip
OVER_WIRE = tuple(replace(field, show="no") for field in OVER_WIRE)

#: Where the parts of a device's frame begin: its origin [m], and each row of its rotation, into the world.
_frame = Block()
ORIGIN, ROW_X, ROW_Y, ROW_Z = _frame.parts(3, 3, 3, 3)
#: Height of the origin, and the cosine of the tilt.
ORIGIN_Z, UPRIGHT = ORIGIN + 2, ROW_Z + 2

_at = places((*FIELDS, *OVER_WIRE))
TAKES, AT_FINGER, DISTANCE, GAP = _at["takes"], _at["at_finger"], _at["distance"], _at["gap"]
COMING, LOST, YIELDS, ARRIVED, PRESS = _at["coming"], _at["lost"], _at["yields"], _at["arrived"], _at["press"]
FREE, UNFELT, GIVE, LAG, UNASKED = _at["free"], _at["unfelt"], _at["give"], _at["lag"], _at["unasked"]
BENDS, HASTE, INERTIA, HERE, SPEED = _at["bends"], _at["haste"], _at["inertia"], _at["here"], _at["speed"]
RUSHES, SHIFT, SLOWER, WAITED = _at["rushes"], _at["shift"], _at["slower"], _at["waited"]
EVENED, KINKS = _at["evened"], _at["kinks"]
EVENED_X, EVENED_Y, EVENED_Z = _at["evened_x"], _at["evened_y"], _at["evened_z"]
GOES, LIFTED, LIFTS, HOISTS = _at["goes"], _at["lifts_before"], _at["lift_speed"], _at["lift_hastens"]
WAY, HOLD, COMMANDS, READ_AT, RISE = _at["ahead"], _at["hold"], _at["commands"], _at["read_at"], _at["climbs_by"]
SINCE, BEHIND, RESTS, PRESSES = _at["since"], _at["behind"], _at["rests"], _at["pressed_now"]
PLACE, SENT_TO, AT_MOST, GONE_BY = _at["place"], _at["sent_to"], _at["at_most"], _at["past"]
