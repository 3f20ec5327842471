"""What the operator of a session sees and may do: devices, pause, notes, stop; nothing of it reveals a condition."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from itouch.loop import Status
from itouch_tools.study.scene_switching import SceneSwitcher
from itouch_tools.study.session_display import Shown


class Operator(Protocol):
    """The operator of a session: a window, or a stand-in for it.  All methods return at once."""

    paused: bool
    stopped: bool
    #: Whether the dead-man's switch is held; hardware needs it.
    held: bool

    def show(self, face: Shown, lines: Sequence[tuple[str, bool]]) -> None:
        """Show the state of the session; ``lines`` are pairs (words, whether all is well)."""

    def notes(self) -> Sequence[str]:
        """Return the notes that were written since the last call."""


def lines_of(switcher: SceneSwitcher) -> list[tuple[str, bool]]:
    """Return lines on devices, dead-man's switch, readiness and losses, as pairs (words, whether all is well)."""
    state = switcher.session.state
    found = []
    for name in switcher.session.model.devices:
        status = Status(int(state[f"{name}.status"]))
        found.append((f"{name}: {status.name.lower()}", status is Status.ENABLED))
    if switcher.real:
        held = switcher.session.held
        found.append(("the switch is held" if held else "the switch is not held: the devices wait", held))
    ready = switcher.sensed().ready
    found.append(("ready" if ready else "not ready yet", True))
    return [*found, *((f"not recorded: {loss}", False) for loss in switcher.losses[:1])]


def keep_note(folder: Path, code: str, trial: int, words: str) -> None:
    """Add a note to ``notes.tsv`` of a study's folder: when (UTC), participant, number of the trial, words.

    If it can't be kept, that is printed, with its words: nobody may lose a trial for a note.
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    try:
        with (folder / "notes.tsv").open("a", encoding="utf-8") as stream:
            stream.write(f"{now}\t{code}\t{trial}\t{' '.join(words.split())}\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        print(f"the note '{words}' can't be kept: {error.strerror or error}", file=sys.stderr)
