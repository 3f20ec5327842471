"""A participant's session on twins: trial after trial, each written to disk before the next begins."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from itouch.loop import Clock, DeviceFaultError
from itouch.plugin.discovery import Catalog
from itouch.world.skin_source import BASELINE
from itouch_tools.study import orders
from itouch_tools.study.answer_sources import Answers, Question, Stopped
from itouch_tools.study.machine import Machine, Phase
from itouch_tools.study.operating import Operator, keep_note, lines_of
from itouch_tools.study.progression import Course, NextTrial
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.scene_switching import SceneSwitcher, note_stop
from itouch_tools.study.session_display import Show, Shown
from itouch_tools.study.study_elements import PRACTICE
from itouch_tools.study.study_store import Row, Store, StoredSession
from itouch_tools.study.tasks import choices_of, is_right, question_of, taken_answer
from itouch_tools.study.touch_figures import FLUX
from itouch_tools.study.touches import Presented, figures, rules_of


class Run:
    """Runs one participant's trials of a study, with the answers of a person or a script.

    Parameters
    ----------
    file, code
        The study and the participant.
    store
        The study's data.
    answers
        The source of answers.
    clock
        The loop's clock; default: as fast as it computes.
    show
        Called between ticks, at most some thirty times per second of the servo's clock, with what to show.
    record
        Keep a recording of the session, ``recordings/CODE-SESSION.mcap`` in the study's folder.
    operator
        Is shown the state of the session; may pause it, write notes, and stop it.
    """

    def __init__(
        self, file: StudyFile, code: str, store: Store, answers: Answers, catalog: Catalog, *,
        clock: Clock | None = None, show: Show | None = None, record: bool = False, operator: Operator | None = None,
    ) -> None:  # fmt: skip
        self._file, self._code, self._store, self._answers = file, code, store, answers
        self._study, self._show, self._operator = file.study, show, operator
        store.refuse_simulated()
        self.course = Course(file, code, store.rows(code))
        seed = int(orders.generator(file.study.seed, code, "twins").integers(2**31))
        recordings = store.folder / "recordings"
        #: This session of the participant, as it stands in the rows; its recording has that name, if there is one.
        self.name = _unused(recordings, code, {row.session for row in self.course.rows})
        kept = recordings / f"{self.name}.mcap" if record else None
        self.switcher = SceneSwitcher(file, catalog, seed=seed, clock=clock, record=kept)
        self.switcher.on_wait = lambda cue: self._wait(cue)
        self._due: NextTrial | None = None
        self._goes_on = False
        self._described: Mapping[str, Any] = {}
        self._baseline: float | None = None
        self._total = len(self.course.planned)
        self._said = ""
        self._shown_at = -1.0

    def trials(self) -> Iterator[Row]:
        """Run the remaining trials, and yield the row of each when it is on disk.

        Raises
        ------
        StoreError
            If a trial can't be kept: it will be run again.
        SessionError, SceneError
            If the scene can't be presented.
        """
        try:
            if self._due is None:
                self.prepare()
            due = self._due
            if due is not None and self._operator is not None and self._operator.stopped:
                raise Stopped
            if due is not None:
                self._begin(due)
            while due is not None:
                row = self._trial(due)
                self.switcher.rest()
                self.switcher.beside(partial(self._keep, row, self.switcher.standing(row.place)), whole=True)
                self._feed_back(row)
                yield row
                due = self.switcher.beside(self.course.next)
                if due is not None:
                    self._attend()
                    self._rest(due)
            self._tell(self._progress("done"))
        finally:
            self.switcher.close()

    def prepare(self) -> bool:
        """Build the scene of the next trial, in the State in which the last one ended if possible; nothing runs yet.

        Returns
        -------
        bool
            Whether a trial is left.

        Raises
        ------
        SessionError, SceneError
            If the scene can't be presented.
        """
        self._due = due = self.course.next()
        if due is None:
            return False
        self._described = self._store.described(self._code)
        stood = self._store.standing(self._code)
        self._goes_on = stood is not None and stood.place == due.place - 1 and self.switcher.take_up(stood)
        if not self._goes_on:
            self.switcher.prepare(due.shown[0])
        return True

    def stand(self) -> None:
        """Keep the State of a session that a fault has ended: used budgets stay used, and what has tripped stays so.

        Raises
        ------
        StoreError
            If it can't be written.
        """
        note_stop(self.switcher.session)
        self._store.stand(self._code, self.switcher.standing(len(self.course.rows) - 1))

    def _keep(self, row: Row, standing: StoredSession) -> None:
        self._store.add(row, standing)
        self.course.made(row)

    def _begin(self, due: NextTrial) -> None:
        """Begin the session, with a break first if one is due; measure the baseline of the skin if it is not known."""
        if self._goes_on:
            self.switcher.rest()
            self._rest(due)
        else:
            self.switcher.begin()
        kept = self._described.get("skin_baseline_K")
        if kept is not None:
            self._baseline = float(kept)
        if kept is not None or not self.switcher.feeling.measures_skin:
            return
        values: list[float] = []
        end = self.switcher.session.seconds + BASELINE

        def until() -> bool:
            sensed = self.switcher.sensed()
            if sensed.skin is not None:
                values.append(sensed.skin)
            return sensed.seconds >= end

        self.switcher.run(until)
        if values:
            self._baseline = sum(values) / len(values)
            self.switcher.rest()
            described = {**self._described, "skin_baseline_K": round(self._baseline, 3)}
            self.switcher.beside(partial(self._store.describe, self._code, described), whole=True)

    def _trial(self, due: NextTrial) -> Row:
        feeling = self.switcher.present(due.shown[0])
        self.switcher.session.mark("trial", {"place": due.place})  # marks its beginning in the recording
        machine = Machine(rules_of(self._study, feeling.index, len(due.shown), self._baseline))
        begun = self.switcher.session.seconds
        touches: list[Presented] = []
        answer, reaction = None, None
        self._said = ""
        while machine.phase is not Phase.END:
            phase = self._phase(machine)
            if phase is Phase.GO:
                self.switcher.go()
            elif phase is Phase.JUDGE:
                touches.append(self._felt(machine))
                if self.switcher.real:  # what follows needs no devices, so nobody need hold the switch for it
                    self.switcher.rest()
                    machine.step(self.switcher.sensed())
                machine.judged(touches[-1].void)
                if machine.phase is Phase.SKIN:
                    self.switcher.present(due.shown[machine.interval])
            if machine.phase is Phase.ANSWER:
                answer, reaction = self._asked(machine, due)
        if machine.void and not touches:
            touches.append(self._felt(machine))
        return self._row(due, machine.void, touches, answer, reaction, begun)

    def _felt(self, machine: Machine) -> Presented:
        return replace(self.switcher.felt(machine.void), back=machine.back[-1] if machine.back else None)

    def _phase(self, machine: Machine) -> Phase:
        """Run until the machine enters another phase, and return that phase."""
        before = machine.phase

        def until() -> bool:
            machine.step(self.switcher.sensed())
            self._display(machine)
            return machine.phase is not before

        try:
            self.switcher.run(until)
        except DeviceFaultError as error:
            machine.fail(f"fault: {error}")
            raise
        return machine.phase

    def _asked(self, machine: Machine, due: NextTrial) -> tuple[str | None, float | None]:
        """Ask, and run until there is an answer; return it as it is kept, and the reaction time [s]."""
        choices = tuple(shown for _, shown in choices_of(self._study))
        self._answers.ask(Question(due.place, question_of(self._study), choices))
        found: list[str] = []

        def until() -> bool:
            machine.step(self.switcher.sensed())
            self._display(machine)
            if machine.phase is not Phase.ANSWER:
                return True
            written = self._answers.poll(machine.since())
            if written is not None:
                taken = taken_answer(self._study, written)
                if taken is None:
                    self._said = f"'{written}' is not an answer: choose one of {', '.join(choices) or 'the numbers'}"
                    self._answers.tell(self._said)
                else:
                    found.append(taken)
            return bool(found)

        self.switcher.run(until)
        if not found:
            return None, None
        reaction = machine.since()
        machine.answered()
        return found[0], round(reaction, 6)

    def _row(
        self, due: NextTrial, void: str, touches: list[Presented], answer: str | None, reaction: float | None,
        begun: float
    ) -> Row:  # fmt: skip
        felt = [figures(touch) for touch in touches]
        fluxes = [one[FLUX.key] for one in felt]
        task, trial = self._study.task, due.trial
        right = None if void or answer is None else is_right(task, replace(trial, shown=due.shown), answer, fluxes)
        return Row(
            self._code, due.place, trial.block, task.kind, trial.condition, list(due.shown), round(begun, 6),
            round(self.switcher.session.seconds, 6), self.name, datetime.now(UTC).isoformat(timespec="seconds"),
            repeats=due.repeats, staircase=trial.staircase or None, level=due.level, answer=None if void else answer,
            right=right, reaction_s=reaction, void=void, felt=felt,
        )  # fmt: skip

    def _feed_back(self, row: Row) -> None:
        practice = self._study.practice
        if row.block == PRACTICE and practice is not None and practice.feedback and row.right is not None:
            self._said = "right" if row.right else "wrong"
            self._answers.tell(self._said)

    def _rest(self, due: NextTrial) -> None:
        """Run a break, if the study has one before this trial."""
        breaks = self._study.breaks
        if breaks is None or due.place == 0 or due.place % breaks.every:
            return
        self._answers.tell(f"a break of {breaks.duration:.0f} s")
        end = self.switcher.session.seconds + breaks.duration

        def until() -> bool:
            left = end - self.switcher.session.seconds
            self._tell(replace(self._progress("break"), left=max(0.0, left)))
            return left <= 0.0

        self.switcher.run(until)

    def _attend(self) -> None:
        """Let the operator pause or stop between two trials."""
        operator = self._operator
        if operator is None:
            return
        self._tell(self._progress("pause"))
        if operator.paused:
            self.switcher.run(self._waits_for_operator)
        if operator.stopped:
            raise Stopped

    def _waits_for_operator(self) -> bool:
        if self._due_to_show():
            self._tell(self._progress("break"))
        return self._operator is None or not self._operator.paused or self._operator.stopped

    def _wait(self, cue: str) -> None:
        if (self._show is not None or self._operator is not None) and self._due_to_show():
            self._tell(self._progress(cue))

    def _progress(self, cue: str) -> Shown:
        rows, void = self.course.rows, sum(bool(row.void) for row in self.course.rows)
        return Shown(cue, trial=len(rows) + 1, trials=max(self._total, len(rows)), void=void, message=self._said)

    def _display(self, machine: Machine) -> None:
        if (self._show is not None or self._operator is not None) and self._due_to_show():
            self._tell(self._face(machine))

    def _due_to_show(self) -> bool:
        now = self.switcher.session.seconds
        if 0.0 <= now - self._shown_at < 1.0 / 30.0:
            return False
        self._shown_at = now
        return True

    def _tell(self, shown: Shown) -> None:
        if self._show is not None:
            self._show(shown)
        if self._operator is not None:
            self._operator.show(shown, lines_of(self.switcher))
            for words in self._operator.notes():
                keep_note(self._store.folder, self._code, shown.trial, words)

    def _face(self, machine: Machine) -> Shown:
        contact, phase = self._study.contact, machine.phase
        cue, force, window, left = phase.value, None, None, None
        if phase is Phase.CONTACT:
            left = max(0.0, contact.duration - machine.since())
            cue = "lift" if left <= 0.0 else cue
            if contact.force is not None:
                probe = self.switcher.session.model.probes[0].name
                force = float(self.switcher.session.state[f"{probe}.total_force"])
                window = (contact.force - contact.tolerance, contact.force + contact.tolerance)
        elif phase is Phase.PAUSE:
            left = max(0.0, machine.rules.pause - machine.since())
        shown = self._progress(cue)
        if phase is Phase.ANSWER:
            choices = tuple(words for _, words in choices_of(self._study))
            shown = replace(shown, question=question_of(self._study), choices=choices)
        return replace(shown, left=left, force=force, window=window)


def _unused(recordings: Path, code: str, named: Collection[str]) -> str:
    """Return a name that no other session has: a recording may be of one that ended before its first trial."""
    number = 1 + len(named)
    while (name := f"{code}-{number}") in named or (recordings / f"{name}.mcap").exists():
        number += 1
    return name
