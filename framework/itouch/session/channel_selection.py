"""Which channels a scene's `<record>` selects, at which rate, and the name of its file: `-2`, `-3` if that exists."""

from __future__ import annotations

import fnmatch
import os
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import PurePath

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.recording.tracks import Track
from itouch.scene import Scene
from itouch.scene.elements import RecordElement
from itouch.scene.elements.recorded_tracks import RecordChannels
from itouch.scene.loader import in_file_order
from itouch.schema import Problem, SceneError
from itouch.schema.diagnostics import nearest
from itouch.session.row_layout import Wish, chosen_tracks, real_device_of, recordable, replay_tracks
from itouch.world import Model, Survey, declared, make_state, survey


def tracks_of(model: Model, state: Record) -> list[Track]:
    """Return the tracks to record of a session: those that a replay needs, and those that the scene chooses.

    Raises
    ------
    SceneError
        If the scene chooses a channel that does not exist, or an impossible rate.
    """
    element, found = model.scene.record, replay_tracks(model, state)
    if element is None:
        return found
    problems = list(_wrong(model, state, element))
    if problems:
        raise SceneError(problems)
    return [*found, *chosen_tracks(model, state, selections_of(element, model.scene.rates.servo))]


def _wrong(
    model: Model, state: Record, element: RecordElement, passed: Collection[str] = (), *, rates: bool = True
) -> Iterator[Problem]:
    """Yield a problem for each rate that is impossible and each pattern that matches nothing, at its attribute.

    Patterns for what one of the ``passed`` elements has are passed over, and rates if they are not to be checked.
    """
    groups: list[tuple[RecordElement | RecordChannels, str, str, float | None]] = [
        (element, "channels", element.channels, element.rate),
        *((more, "of", more.of, more.rate) for more in element.more),
    ]
    servo, places = model.scene.rates.servo, model.scene.places
    for owner, attribute, text, rate in groups:
        # a rate is tried without a pattern, a pattern with the servo's rate, so that each problem has its own place
        tries: list[tuple[str, Wish, str]] = []
        if rate and text.split() and rates:
            tries.append(("rate", ([], rate), "write the rate that the message gives"))
        tries += [
            (attribute, ([pattern], servo), "")
            for pattern in text.split()
            if not _passed(pattern.partition(".")[0], passed, state)
        ]
        for name, wish, advice in tries:
            try:
                chosen_tracks(model, state, [wish])
            except ValueError as error:
                place = places.of(owner, name) or places.of(owner) or places.of(element)
                yield Problem("unknown-channel", f"<{owner.TAG}>: {error}", place, advice or _advice(state, *wish[0]))


def _passed(owner: str, passed: Collection[str], state: Record) -> bool:
    """Tell whether a pattern's owner is, or may be, one of the ``passed`` elements, of which one may have any name."""
    if fnmatch.filter(passed, owner):
        return True
    return "" in passed and not nearest(owner, {name.partition(".")[0] for name in state})


def _advice(state: Record, pattern: str) -> str:
    """Advise the channel that was meant, or where all of them are listed."""
    plain = "*" not in pattern and pattern not in state
    if plain and (close := nearest(pattern, (name for name in state if recordable(state, name)))):
        return f"did you mean '{close}'?"
    return "channels are names of State, such as arm.pose or finger.*; `itouch-py inspect SCENE` lists them"


def recording_problems(found: Survey) -> list[Problem]:
    """Return what is wrong with the channels that the scene wants recorded.

    Of a scene with errors these are the channels that no element has which is left out because of an error.
    """
    if found.part is None:
        return []
    if found.model is None:
        with suppress(Exception):  # half a scene may not allow it
            return list(_sure(found.part, found.doubtful))
        return []
    try:
        tracks_of(found.model, make_state(found.model))
    except SceneError as error:
        return list(error.problems)
    return []


def every_problem(scene: Scene, catalog: Catalog, known: Sequence[Problem]) -> list[Problem]:
    """Return all that is wrong with a scene in file order; ``known`` is what was found while it was read."""
    found = survey(scene, catalog, known)
    return in_file_order([*known, *found.problems, *recording_problems(found)])


def _sure(part: Model, doubtful: Collection[tuple[str, str]]) -> Iterator[Problem]:
    """Yield a problem for each channel and rate that are wrong, whatever the ``doubtful`` elements will be."""
    if part.scene.record is None:
        return
    rates = ("section", "rates") in doubtful
    yield from _wrong(part, make_state(part), part.scene.record, [name for _, name in doubtful], rates=not rates)


def recording_notes(model: Model) -> list[str]:
    """Return a sentence for each of the scene's patterns that records nothing because a device is real."""
    element = model.scene.record
    if element is None:
        return []
    names = list(declared(model))
    patterns = [pattern for patterns, _ in selections_of(element, model.scene.rates.servo) for pattern in patterns]
    return [
        f"'{pattern}' is recorded only where device '{device}' is a twin: here it is real"
        for pattern in patterns
        if not fnmatch.filter(names, pattern) and (device := real_device_of(model, pattern))
    ]


def selections_of(element: RecordElement, servo: float) -> list[Wish]:
    """Return the patterns of an element, each group with its rate [Hz]."""
    listed = [(element.channels, element.rate), *((more.of, more.rate) for more in element.more)]
    return [(text.split(), rate or servo) for text, rate in listed if text.split()]


def file_name(pattern: str, source: str, seed: int) -> str:
    """Return the name of the file to record to; a number is added if that file exists already."""
    scene = PurePath(source).stem or "scene"
    now = time.strftime("%Y%m%d-%H%M%S")
    name = pattern.replace("{scene}", scene).replace("{time}", now).replace("{seed}", str(seed))
    stem, number = name.removesuffix(".mcap"), 1
    while os.path.exists(name):
        number += 1
        name = f"{stem}-{number}.mcap"
    return name
