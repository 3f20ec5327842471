"""Every code that a message may carry, in one table: ``error[CODE]`` of a file, ``fault[CODE]`` of a running device."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Code:
    """A kind of problem: its stable name, what is wrong, and what to do about it."""

    name: str
    wrong: str
    remedy: str


#: Codes by heading, in the order of the reference.
FILES = (
    Code("no-such-file", "a file is missing, cannot be read, or is a folder",
         "paths are relative to the file that names them"),
    Code("outside-folder", "a path leads out of the scene's folder, or to the network",
         "copy the file into the folder of the scene, or below it"),
    Code("include-cycle", "a file includes itself, directly or through others",
         "remove one of the includes; the chain is shown"),
    Code("duplicate-include", "a file is included twice without different prefixes",
         "remove one, or give it a `prefix`"),
    Code("too-many-includes", "includes are nested more than 16 deep, or there are more than 256 documents",
         "put the files together"),
    Code("too-large", "a scene file is larger than 8 MiB", "keep numbers in meshes and recordings"),
    Code("not-a-scene", "a saved session or a recording where a scene, a study or a sweep belongs",
         "the message names the commands that take it"),
    Code("not-utf-8", "the file is not UTF-8 text", "save it with encoding UTF-8"),
    Code("not-well-formed", "the file is not XML: a tag is not closed, a value not quoted, an attribute given twice",
         "look at the place: what is missing is there or before it"),
    Code("doctype", "the file has a DOCTYPE; entities are not supported", "use `<include>` and `<defaults>`"),
    Code("too-deep", "elements are nested more than 64 deep", "a scene is at most six deep"),
    Code("too-many-attributes", "an element has more than 128 attributes", "remove some"),
    Code("too-many-elements", "a file has more than 100 000 elements", "split the scene"),
    Code("wrong-root", "the outermost element is not `<itouch>`", 'begin with `<itouch version="1.0">`'),
    Code("bad-version", "the version is not a format version", 'write `version="1.0"`'),
    Code("newer-version", "the file is written for a newer format", "install a newer itouch-py"),
)  # fmt: skip
NAMES = (
    Code("unknown-element", "an element that does not exist, or may not stand there",
         "write the name that the message offers, or remove the element"),
    Code("unknown-attribute", "an attribute that the element does not have",
         "write the name that the message offers, or remove the attribute"),
    Code("unknown-prefix", "a namespace prefix that is not declared", "declare the plugin's namespace on `<itouch>`"),
    Code("unknown-name", "a reference to something that the scene does not have",
         "write the name that the message offers, or define what is named"),
    Code("duplicate-name", "two things of one scene have the same name", "rename one; both places are shown"),
    Code("missing-attribute", "a required attribute is missing", "add it; the message says what it takes"),
    Code("missing-element", "a required element is missing", "add the one that the message names"),
    Code("duplicate-element", "an element stands twice where only one is allowed", "keep one; both places are shown"),
    Code("unexpected-text", "text inside an element", "write values as attributes; remove the text"),
    Code("base-cycle", "a material is its own base, directly or through others", "remove one of the bases"),
    Code("mount-cycle", "a device is mounted on itself, directly or through others", "mount it elsewhere"),
)  # fmt: skip
VALUES = (
    Code("bad-value", "a value of the wrong kind, unit or count", "write what the message says is expected"),
    Code("out-of-range", "a number outside its range; a temperature of 22 is 22 K",
         "write a value within the range that the message gives"),
    Code("exclusive", "attributes or elements that exclude one another", "keep one of them"),
    Code("together", "of attributes that must stand together, one is missing", "add the other, or remove both"),
    Code("requires", "an attribute that means nothing without another", "add the other"),
    Code("one-of", "exactly one of several must be given, and none is, or more than one", "give exactly one"),
)  # fmt: skip
DEVICES = (
    Code("unknown-plugin", "a plugin that is not installed", "install it, or correct its name; the nearest is offered"),
    Code("plugin-failed", "a plugin is installed, but does not load, or its code fails",
         "`itouch-py devices` shows the whole reason"),
    Code("wrong-plugin", "a device contains the element of another plugin", "write the element of its own plugin"),
    Code("device", "a device rejects its parameters, or a file that they name", "the message says what it expects"),
    Code("twin-only", "hardware is asked for, but the device has no working driver", 'write `twin="yes"`'),
    Code("no-watchdog", "hardware has neither a watchdog of its own nor a second opener: nothing would "
         "stop it if the servo process died", "its plugin must state one of the two"),
    Code("stale-readings", "warning: a device's readings get older between two exchanges than its watchdog (W1) allows",
         "its plugin must exchange more often, or state when in an exchange it measures"),
    Code("no-plate-force", "warning: hardware carries a surface to a finger and measures no force; an error if it "
         "is to perform touch-off", "limit its speed, or use drives that measure a force"),
    Code("calibration-stale", "a calibration beside the scene has expired, or does not fit its device any more",
         "run `itouch-py calibrate SCENE`, with `--extend` if it still holds"),
    Code("rig", "a rig file whose devices are not those of the scene, or that holds more than devices",
         "give it the devices of the scene, by the same names"),
    Code("missing-channel", "something needs a channel that a device does not have", "bind another device"),
    Code("locked-dof", "a probe can only command directions in which the device does not move",
         "bind a device that moves"),
    Code("two-writers", "two things write the same command", "bind one of them elsewhere"),
    Code("loosened-limit", "a limit looser than the default, or than the device's own",
         "a scene may only tighten limits"),
    Code("limit-without-channel", "a limit on something that the device does not have",
         "set it on the device that has it; a pad that heats must declare its temperature reading"),
    Code("unmonitored-drive", "a drive that could hurt, and no monitor watches its effect on a finger",
         "declare the reading that shows its effect, or bring a monitor"),
    Code("missing-role", "a command in A, V, W, K, N or Pa does not say what it is for", "write its role"),
    Code("harmless-refused", "a temperature, electrode or ultrasound drive is called harmless",
         "remove `harmless`; bring a monitor"),
    Code("monitor-failed", "a monitor that a distribution offers cannot be loaded", "remove or repair it"),
    Code("fault-on-hardware", "a `<fault>` of a device that is not a twin", "remove it, or run with `--twin all`"),
    Code("out-of-reach", "warning: the table cannot carry a surface to an object", "move the object or the table"),
)  # fmt: skip
SCENE = (
    Code("rate", "a modality's rate does not divide the servo rate",
         "write the nearest that does, which the message gives"),
    Code("modality", "a modality rejects its parameters or a file; warning: it is left out, as its device is missing",
         "the message says what it expects"),
    Code("modality-cycle", "modalities that take their input from one another, in a circle", "break the circle"),
    Code("unknown-channel", "`<record>` names an unknown channel, or a rate that does not divide the servo's",
         "`itouch-py inspect SCENE` lists the channels"),
    Code("bad-recording", "a recorded motion that cannot be read, or lacks the probe",
         "`itouch-py inspect FILE` says what it holds"),
    Code("texture", "the file of a texture is not a height map", "give a PNG, PGM or .npy file of values 0 to 1"),
    Code("motion", "an object's motion is not a table of poses, or repeats without ending where it begins",
         "its columns are t x y z, or t x y z qw qx qy qz, in SI"),
    Code("dynamics", "an object cannot be a rigid body", "give it another shape, mass or inertia"),
    Code("missing-extra", "something that the scene needs is not installed",
         "the message gives the command that installs it"),
)  # fmt: skip
MESHES = (
    Code("mesh-format", "a mesh in a format that is not read, compressed or archived", "export it as STL, OBJ or PLY"),
    Code("mesh-empty", "a mesh without triangles that have an area", "is the file complete?"),
    Code("mesh-too-large", "a mesh, or all meshes of a scene together, are too large", "simplify them"),
    Code("mesh-damaged", "a mesh file is cut off, or its header is wrong", "export it again"),
    Code("mesh-not-finite", "a corner of a triangle is not a number", "export it again"),
    Code("mesh-units", "error: longer than 100 m or shorter than 10 um; warning: longer than 10 m or shorter than 1 mm",
         "give a `scale`"),
    Code("mesh-open", "warning: the mesh has holes", "close them, or state `sides`"),
    Code("mesh-crowded-edges", "warning: edges with three triangles or more", "the inside may not be where it seems"),
    Code("mesh-overlap", "warning: closed parts reach into one another", "make their union in a modeller"),
    Code("mesh-winding", "warning: the surface has no front and back", 'write `sides="two"`'),
)  # fmt: skip
#: Codes of devices that were stopped while they ran: ``fault[CODE]``, and ``trip`` in the report.
RUNNING = (
    Code("not-a-number", "a reading or a command is not a number", "look at the sensor or modality that is named"),
    Code("sensor-range", "a reading outside what its device can read", "check the sensor and its unit"),
    Code("sensor-jump", "a reading jumped farther than the quantity can change", "check cable and sensor"),
    Code("sensor-frozen", "the plate's sensor reads exactly the same while the drive changes", "check the sensor"),
    Code("sensor-disagree", "two sensors contradict one another, or a force is felt where no finger is",
         "calibrate both; check what touches the plate"),
    Code("plate-temperature", "the plate is, or is about to be, past its trip (T1, T2)", "check module and sensor"),
    Code("sink-temperature", "the heat sink is past its trip (T7)", "let it cool; is the fan running?"),
    Code("plate-rate", "the plate changes too fast under the finger (T5)", "check the driver of the module"),
    Code("flux", "the mean flux is past its trip (T6)", "check the flux sensor; begin nearer to the skin"),
    Code("dose", "the thermal dose of a session is used up (T3)", "end the session; a dose is not given back"),
    Code("cold", "a cold plate has been touched for as long as a session allows (T4c)",
         "end the session; let the hand get warm"),
    Code("finger-force", "the forces on one finger, taken together, are too large (K1)", "check the force sensors"),
    Code("finger-torque", "an arm was sent a larger torque than it may have (K1)", "report it: nothing limited it"),
    Code("monitor", "a plugin's monitor has stopped its device", "the sentence says what the device did"),
    Code("monitor-error", "a monitor's own code has failed, or returned neither a share of the drive nor a trip",
         "report it to its author"),
    Code("runaway", "the plate does not follow its drive, or goes the other way (T9)", "check the module's polarity"),
    Code("plate-force", "the plate presses on the finger past its trip (K4)", "press less; check the force sensor"),
    Code("contact-time", "the plate is still touched long after it should have withdrawn (T4)",
         "lift the finger; check the table"),
    Code("speed", "the finger on the arm is faster than its trip (K2)", "move slower; check the arm's encoders"),
    Code("surface-speed", "a surface moves faster than any command allows (K5)", "check the table's drive"),
    Code("tracking", "a surface is too far from its command (K6)", "look for what is in the table's way"),
    Code("silent", "a device was silent for longer than its watchdog allows (W1)", "check the link and the machine"),
    Code("device-error", "a device's driver or twin failed", "the driver's own message says how; then reconnect"),
    Code("modality-error", "a modality's code has raised an error", "its message says where; report it to its author"),
    Code("calibration", "the plate was not felt during touch-off", "check the force sensor and the mount"),
    Code("released", "nobody holds the switch (W3)", "hold Space in the window, or the device's button"),
    Code("overrun",
         'the loop fell behind, and the scene says `servo-overrun="stop"`; or hardware was left to itself for 0.2 s',
         "`itouch-py doctor` says why"),
    Code("injected", "not a trip: a `<fault>` of the scene took effect", "remove it when you have seen enough"),
)  # fmt: skip

#: What `check` remarks on a scene that is legal; with ``--strict`` these count as errors.
ODD = (
    Code("metres", "an object has a large length without a unit, which is metres", "write the unit"),
    Code("overlap", "solids of different materials overlap", "move one of them, or make it smaller"),
    Code("clipped-stiffness", "a material is stiffer than what the arm can render stably",
         "write the stiffness that is rendered, or lower the damping"),
    Code("out-of-band", "the temperature of an object or of the room is outside the plate's range",
         "give it a temperature within that range"),
    Code("untouched", "the scripted operator never comes near any object", "lower a `<to>` of its motion"),
    Code("two-heights", "the finger rests over two tops, and the plate has one height", "move it over one of them"),
    Code("slow-servo", "the loop is too slow for a contact that passes between arm and plate",
         "raise the servo rate to 1 kHz"),
)  # fmt: skip

#: All codes by heading.
HEADINGS: dict[str, tuple[Code, ...]] = {
    "Files and XML": FILES,
    "Names and places": NAMES,
    "Values": VALUES,
    "Devices and limits": DEVICES,
    "Modalities, recordings, surfaces, motion": SCENE,
    "Mesh files": MESHES,
    "Valid but unusual": ODD,
    "While running": RUNNING,
}
#: All codes by name.
CODES: dict[str, Code] = {code.name: code for codes in HEADINGS.values() for code in codes}
