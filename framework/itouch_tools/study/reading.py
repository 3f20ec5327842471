"""From a study's file to a checked `Study`, with the place of everything in it, and all problems at once."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from itouch.plugin.discovery import Catalog, PluginError
from itouch.scene import Scene
from itouch.scene.binding import Binder
from itouch.scene.edits import Edit
from itouch.scene.loader import in_file_order, read_scene
from itouch.scene.places import Places
from itouch.scene.source import Attribute, Node, SourceError, read_root
from itouch.schema.diagnostics import Place, Problem, SceneError, did_you_mean
from itouch.schema.hold_until import Until
from itouch.world import Model, survey
from itouch.world.scene_files import SceneFile
from itouch.world.skin_source import LONGEST
from itouch_tools.study.adaptive import Staircase
from itouch_tools.study.plugin_tasks import TaskError, offered, task_names, task_of
from itouch_tools.study.study_elements import TASKS, UNCOUNTED, VERSION, Adaptive, Exclude, Factor, Study

#: How far [m] the end of a scripted hand's path may be from its start.
CLOSED = 1e-3
#: A staircase with the default values.
USUAL = Staircase("quest", 0.0, 1.0, 0.5)
#: A prior is narrow if the range of the levels is more than this many times as wide.
NARROW = 20.0
#: Noise that is added to a display's current before each touch of a blind study, above that of its own control.
PRESET_NOISE = "0.2 A"
#: Tasks whose answer says nothing where there is one level only.
COMPARING = ("identify", "colder", "odd", "same")
#: The level of each factor by its name, and that of a staircase by its name.
Condition = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class StudyFile:
    """A study as it was read: the paths of its file and of its scene, and the place of each element.

    ``files`` are the other files that its scene names at any level, such as meshes, by name; they are known when the
    study has been checked.
    """

    study: Study
    path: str
    scene_path: str
    places: Places
    files: dict[str, SceneFile] = field(default_factory=dict, compare=False, repr=False)

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.study.name or Path(self.path).stem

    def conditions(self) -> list[dict[str, str]]:
        """Return all combinations of levels that are shown, in the order of the file."""
        names = [factor.name for factor in self.study.factors]
        crossed = itertools.product(*(factor.names for factor in self.study.factors))
        found = [dict(zip(names, levels, strict=True)) for levels in crossed]
        return [condition for condition in found if self.excluded_by(condition) is None]

    def excluded_by(self, condition: Condition) -> Exclude | None:
        """Return the ``<exclude>`` that leaves out a combination of levels; none: it may be shown."""
        for one in self.study.excluded:
            if all(condition.get(factor) == level for factor, level in one.pairs.items()):
                return one
        return None

    def instructions(self) -> list[str]:
        """Return the lines of the participant's instructions; none: the study has no such element.

        Raises
        ------
        OSError
            If they can't be read.
        """
        path = self.instructions_path()
        return [] if path is None else path.read_text(encoding="utf-8").splitlines()

    def instructions_path(self) -> Path | None:
        """Return the file of the participant's instructions; None: the study has no such element."""
        element = self.study.instructions
        return None if element is None else Path(os.path.dirname(self.path)) / element.file

    def edits(self, condition: Condition) -> list[Edit]:
        """Return what a condition sets in the scene."""
        edits: list[Edit] = []
        for factor in self.study.factors:
            if factor.name in condition:
                value = factor.taken[factor.names.index(condition[factor.name])]
                edits += self._set(factor, factor.set_, value)
        for staircase in self.study.staircases:
            if staircase.name in condition:
                edits += self._set(staircase, staircase.set_, f"{condition[staircase.name]} {staircase.unit}".strip())
        return edits

    def _set(self, element: Factor | Adaptive, paths: str, value: str) -> Iterator[Edit]:
        place = self.places.of(element, "set_") or self.places.of(element) or Place(self.path, 1, 1)
        for path in paths.split():
            yield Edit(path, Attribute(value, place))

    def scene(self, condition: Condition, catalog: Catalog, more: Sequence[Edit] = ()) -> tuple[Scene, list[Problem]]:
        """Return the scene of a condition (and ``more`` edits), and its problems."""
        edits = [*self.edits(condition), *more]
        scene, problems = read_scene(self.scene_path, catalog, edits=edits)
        equal = self._equalised(scene)
        return read_scene(self.scene_path, catalog, edits=[*edits, *equal]) if equal else (scene, problems)

    def _equalised(self, scene: Scene) -> list[Edit]:
        """Return the edits that make modalities take the same time before every touch, where they can (``<blind>``)."""
        blind = self.study.blind
        if blind is None or not blind.equalise:
            return []
        place = self.places.of(blind) or Place(self.path, 1, 1)
        values = {"equalise": "yes", "preset_time": f"{blind.approach:g} s", "preset_noise": PRESET_NOISE}
        return [
            Edit(f"{part.name}.{name.replace('_', '-')}", Attribute(value, place))
            for part in scene.modalities if hasattr(part.params, "equalise")
            for name, value in values.items() if hasattr(part.params, name)
        ]  # fmt: skip

    def model(self, condition: Condition, catalog: Catalog, more: Sequence[Edit] = ()) -> Model:
        """Return the compiled scene of a condition (and ``more`` edits).

        Raises
        ------
        SceneError
            If the scene has problems; with all of them.
        """
        scene, problems = self.scene(condition, catalog, more)
        if any(problem.severity == "error" for problem in problems):
            raise SceneError(problems)
        return Model.of(scene, catalog)


def load_study(path: str | os.PathLike[str], catalog: Catalog) -> StudyFile:
    """Load a study, and check it against its scene.

    Raises
    ------
    SceneError
        With all problems of study and scene in file order.
    """
    found, problems = read_study(path, catalog)
    if found is None or any(problem.severity == "error" for problem in problems):
        raise SceneError(problems)
    return found


def read_study(path: str | os.PathLike[str], catalog: Catalog) -> tuple[StudyFile | None, list[Problem]]:
    """Return a study, as far as it can be read, and the problems found, in file order."""
    shown = os.fspath(path)
    try:
        root = read_root(shown, "study", f'<study version="{VERSION}" scene="SCENE.xml" seed="1">')
    except SourceError as error:
        return None, [error.problem]
    problems: list[Problem] = []
    places = Places()
    study = Binder(catalog, problems, places).bind(root, Study)
    if study is None:
        return None, in_file_order(problems)
    problems += _wanting(study, root)
    found = StudyFile(study, shown, os.path.join(os.path.dirname(shown), study.scene), places)
    if not problems:
        problems += _contradictions(found)
    if not problems:
        problems += _scenes(found, catalog)
    if not problems:
        problems += _pointless(found, catalog)
    return found, in_file_order(problems)


def _wanting(study: Study, root: Node) -> Iterator[Problem]:
    if study.version != VERSION:
        place = root.attributes["version"].place
        sentence = f"the file is written for study format {study.version}, this program reads {VERSION}"
        yield Problem("bad-version", sentence, place, f'write version="{VERSION}"')
    for tag in ("task", "contact"):
        if not any(node.tag == tag for node in root.children):
            yield Problem("missing-element", f"<study> needs the element <{tag}>", root.place, f"write <{tag} .../>")
    if not any(node.tag in ("factor", "staircase") for node in root.children):
        advice = "write a <factor> or a <staircase>"
        yield Problem("missing-element", "<study> varies nothing", root.place, advice)


def _contradictions(file: StudyFile) -> Iterator[Problem]:
    """Yield the contradictions of a study, such as names of things that it does not have."""
    study, places = file.study, file.places
    yield from _unknown_task(file)
    levels = {factor.name: factor.names for factor in study.factors}
    owners: list[Factor | Adaptive] = [*study.factors, *study.staircases]
    names = [owner.name for owner in owners]
    for name in sorted({name for name in names if names.count(name) > 1}):
        owner = [owner for owner in owners if owner.name == name][1]
        yield Problem("duplicate-name", f"'{name}' is defined twice", places.of(owner, "name"))
    asked = study.task.factor
    if asked not in levels and asked not in names:
        advice = did_you_mean(asked, names, "the study varies")
        yield Problem("unknown-name", f"there is no factor named '{asked}'", places.of(study.task, "factor"), advice)
    elif asked in levels and study.task.standard and study.task.standard not in levels[asked]:
        advice = did_you_mean(study.task.standard, levels[asked], "its levels are")
        sentence = f"'{study.task.standard}' is not a level of '{asked}'"
        yield Problem("unknown-name", sentence, places.of(study.task, "standard"), advice)
    if study.order.by and study.order.by not in levels:
        advice = did_you_mean(study.order.by, levels, "the factors are")
        sentence = f"there is no factor named '{study.order.by}'"
        yield Problem("unknown-name", sentence, places.of(study.order, "by"), advice)
    for one in study.excluded:
        for factor, level in one.pairs.items():
            if level not in levels.get(factor, ()):
                sentence = f"there is no level '{level}' of a factor '{factor}'"
                advice = (
                    did_you_mean(level, levels.get(factor, ()), "its levels are") or f"factors: {', '.join(levels)}"
                )
                yield Problem("unknown-name", sentence, places.of(one, "where"), advice)
    try:
        file.instructions()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not UTF-8 text"
        sentence = f"cannot read the instructions: {why}"
        yield Problem("bad-value", sentence, places.of(study.instructions, "file") if study.instructions else None)
    if study.staircases and study.task.kind != "colder":
        sentence = f"a staircase needs <task kind=\"colder\">, not '{study.task.kind}'"
        yield Problem("bad-value", sentence, places.of(study.task, "kind"))
    yield from _odd_staircases(file)
    for each in study.factors:
        taken = sorted(UNCOUNTED.intersection(each.names))
        if each.name == study.order.by and study.order.kind == "blocked" and taken:
            sentence = f"a block can't be called '{taken[0]}': this name marks trials that do not count"
            yield Problem("bad-value", sentence, places.of(each, "levels"), "rename the level")
    yield from _wrong_catch(file, levels)
    if study.factors and not file.conditions():
        yield Problem("bad-value", "every combination of levels is excluded", places.of(study.excluded[0]))


def _wrong_catch(file: StudyFile, levels: Mapping[str, Sequence[str]]) -> Iterator[Problem]:
    """Yield problems of catch trials that name what the study does not vary, or leave a factor open."""
    catch = file.study.catch
    if catch is None:
        return
    place = file.places.of(catch, "where")
    if not levels:
        yield Problem("bad-value", "catch trials show levels of factors, and this study has none", place)
        return
    for factor, level in catch.condition.items():
        if level not in levels.get(factor, ()):
            advice = did_you_mean(level, levels.get(factor, ()), "its levels are") or f"factors: {', '.join(levels)}"
            yield Problem("unknown-name", f"there is no level '{level}' of a factor '{factor}'", place, advice)
    if open_ := [name for name in levels if name not in catch.condition]:
        sentence = f"catch trials must say a level of every factor: '{open_[0]}' is open"
        yield Problem("bad-value", sentence, place, f"add {open_[0]}={levels[open_[0]][0]}")


def _odd_staircases(file: StudyFile) -> Iterator[Problem]:
    """Yield problems of staircases that would go the wrong way, or whose attributes would have no effect."""
    study, places = file.study, file.places
    if study.staircases and study.factors:
        sentence = "the trials of staircases vary their levels only: a factor beside them has no effect"
        yield Problem("bad-value", sentence, places.of(study.factors[0], "name"),
                      "make a study of it for each of its levels, or set it in the scene")  # fmt: skip
    for one in study.staircases:
        if one.standard >= one.start:
            sentence = f"the levels of '{one.name}' begin at {one.start:g}, and the standard is {one.standard:g}"
            advice = (
                "a right answer lowers the level: it has to come nearer to the standard, which lies below the start"
            )
            yield Problem("bad-value", sentence, places.of(one, "standard"), advice)
        bayes = one.procedure != "up-down"
        if bayes and one.target != USUAL.target:
            sentence = f"target is of the up-down procedure: {one.procedure} finds the middle of the function"
            yield Problem("bad-value", sentence, places.of(one, "target"), "remove it")
        if bayes and one.prior == USUAL.prior and one.high - one.low > NARROW * one.prior:
            sentence = (
                f"the prior of '{one.name}', {one.prior:g}, is narrow for levels from {one.low:g} to {one.high:g}"
            )
            advice = f'write what you expect, as prior="{(one.high - one.low) / 4.0:.2g}"'
            yield Problem("bad-value", sentence, places.of(one, "name"), advice)


def _unknown_task(file: StudyFile) -> Iterator[Problem]:
    """Yield the problem of a task that no plugin brings, or that needs what the study does not have."""
    task, place = file.study.task, file.places.of(file.study.task, "kind")
    if task.kind in TASKS:
        return
    try:
        brought = task_of(task.kind)
        factor = next((one for one in file.study.factors if one.name == task.factor), None)
        brought.choices(factor.names if factor is not None else ())
    except (TaskError, PluginError) as error:
        if offered(task.kind):
            yield Problem("bad-value", str(error), place)
        else:
            advice = did_you_mean(task.kind, [*TASKS, *task_names()], "there are")
            yield Problem("unknown-name", f"there is no task '{task.kind}'", place, advice)
        return
    if brought.intervals > 1 and not task.standard:
        sentence = f"'{task.kind}' compares with a standard: say which level of '{task.factor}' that is"
        yield Problem("bad-value", sentence, place, 'write standard="LEVEL"')


def _scenes(file: StudyFile, catalog: Catalog) -> Iterator[Problem]:
    """Yield the problems of the scene, and of each level in it."""
    base, problems = read_scene(file.scene_path, catalog, place=file.places.of(file.study, "scene"))
    yield from problems
    if any(problem.severity == "error" for problem in problems):
        yield from survey(base, catalog, problems).problems
        return
    known = [each.name for each in base.world.objects]
    wanted = file.study.contact.object_
    if wanted not in known:
        advice = did_you_mean(wanted, known, "its objects are")
        sentence = f"the scene has no object named '{wanted}'"
        yield Problem("unknown-name", sentence, file.places.of(file.study.contact, "object_"), advice)
    yield from _open_motions(base)
    told: set[str] = set()
    for condition in each_level_once(file):
        scene, found = file.scene(condition, catalog)
        compiled = survey(scene, catalog, found)
        file.files.update({one.file: one for one in compiled.model.files} if compiled.model is not None else {})
        for problem in (*found, *compiled.problems):
            if problem.severity == "error" and problem.sentence not in told:
                told.add(problem.sentence)
                shown = ", ".join(f"{name}={level}" for name, level in condition.items())
                yield replace(problem, sentence=f"{problem.sentence} (in the condition {shown})")


def _pointless(file: StudyFile, catalog: Catalog) -> Iterator[Problem]:
    """Yield a note where no trial can count, or no answer can say anything, as far as that is known before a trial."""
    study = file.study
    asked = next((factor for factor in study.factors if factor.name == study.task.factor), None)
    if study.task.kind in COMPARING and asked is not None and len(asked.names) == 1:
        sentence = f"'{asked.name}' has one level, '{asked.names[0]}': every answer to '{study.task.kind}' is known"
        place = file.places.of(asked, "levels")
        yield Problem("bad-value", sentence, place, "add the levels that are told apart", severity="warning")
    scene, _ = read_scene(file.scene_path, catalog)
    if not all(device.twin for device in scene.devices):
        return  # a person touches, not the scripted hand
    for operator in scene.operators:
        targets = operator.motion.targets
        if len(targets) < 2:
            continue
        away = targets[-1].in_ + sum(target.in_ + _longest(target.hold) for target in targets[1:-1])
        if away < study.contact.duration:
            sentence = (
                f"no trial will count: a touch lasts {study.contact.duration:g} s at least, and the scripted hand of "
                f"'{operator.probe}' is back after {away:g} s"
            )
            place = file.places.of(study.contact, "duration")
            advice = "ask for a shorter touch, or let the hand hold longer (<to hold> in the scene)"
            yield Problem("bad-value", sentence, place, advice, severity="warning")


def _longest(hold: float | Until) -> float:
    """Return how long a hold may last at most [s]."""
    return hold if isinstance(hold, float | int) else LONGEST


def _open_motions(scene: Scene) -> Iterator[Problem]:
    """Yield a problem for each scripted hand that does not end where it begins: its arm would jump between trials."""
    for operator in scene.operators:
        targets = operator.motion.targets
        if len(targets) > 1 and math.dist(targets[0].pos, targets[-1].pos) > CLOSED:
            sentence = f"the hand of '{operator.probe}' does not end where it begins: the next trial begins there"
            yield Problem(
                "bad-value", sentence, scene.places.of(targets[-1], "pos"), "end with the pos of the first <to>"
            )


def each_level_once(file: StudyFile) -> Iterator[dict[str, str]]:
    """Yield conditions that together contain every level; staircases are at their low, high and standard level."""
    conditions = file.conditions() if file.study.factors else [{}]
    seen: set[tuple[str, str]] = set()
    ends = [
        {one.name: f"{getattr(one, end):.9g}" for one in file.study.staircases} for end in ("low", "high", "standard")
    ]
    for condition in conditions:
        new = set(condition.items()) - seen
        if new or not seen:
            seen |= set(condition.items())
            for end in ends if file.study.staircases else [{}]:
                yield {**condition, **end}
        if not condition:
            return
