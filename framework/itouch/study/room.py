"""The room of a study: twins that go on from trial to trial while the scene above them changes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from itouch.loop import Clock
from itouch.plugin.discovery import Catalog
from itouch.session import Session, SessionError
from itouch.session.succession import succeed
from itouch.study.machine import Sensed
from itouch.study.reading import StudyFile
from itouch.study.store import Standing
from itouch.study.touches import Feeling, Presented, Toucher, TouchError, felt_by


class Room:
    """One session after the other, each on from the State of the one before.

    Parameters
    ----------
    file, catalog
        The study and the plugins.
    seed
        Of the twins' noise.
    clock
        What paces the loop.
    record
        File that all of them are recorded to; a State with other fields needs one more, ``NAME-2.mcap``.
    """

    def __init__(
        self, file: StudyFile, catalog: Catalog, *, seed: int, clock: Clock | None = None, record: Path | None = None
    ) -> None:
        self._record, self._recorded = record, 0
        #: What is not kept any more of the recording, a sentence each.
        self.losses: list[str] = []
        self._file, self._catalog, self._seed, self._clock = file, catalog, seed, clock
        self._models = Toucher(file, catalog)
        self._session: Session | None = None
        self._feeling: Feeling | None = None
        self.condition: Mapping[str, str] = {}

    @property
    def session(self) -> Session:
        """The session that runs now.

        Raises
        ------
        ValueError
            If nothing was presented yet.
        """
        if self._session is None:
            raise ValueError("nothing was presented yet")
        return self._session

    @property
    def feeling(self) -> Feeling:
        """What is noted of the interval.

        Raises
        ------
        ValueError
            If nothing was presented yet.
        """
        if self._feeling is None:
            raise ValueError("nothing was presented yet")
        return self._feeling

    def present(self, condition: Mapping[str, str]) -> Feeling:
        """Put a condition's scene over the devices, the hand at the begin of its path, which waits.

        A twin's hand that is still under way ends its path first: no arm can be at another place at once.

        Raises
        ------
        SessionError
            If a device is real, or something is touched.
        SceneError
            If the scene has problems.
        """
        before = self._session
        session = self._built(condition)
        if before is not None:
            if self._under_way:
                self.run(lambda: before.done)
            succeed(session, before.state)
        self._take(session, condition)
        if not int(session.state["ready"]):  # the rig finds its heights by touch
            self.run(lambda: bool(session.state["ready"]))
        self.hold()
        return self.feeling

    def take_up(self, standing: Standing) -> bool:
        """Stand where a participant's session stood; tell whether that was possible with this program."""
        session = self._built(standing.condition)
        if standing.layout != layout_of(session):
            return False
        session.adopt(standing.state)
        session.settle(always=True)
        self._take(session, standing.condition)
        return True

    def standing(self, place: int) -> Standing:
        """Return where the session stands after a trial."""
        session = self.session
        return Standing(place, dict(self.condition), layout_of(session), session.state.tobytes())

    @property
    def _under_way(self) -> bool:
        session = self.session
        hands = [f"{probe.name}.hand.steered" for probe in session.model.probes]
        let_go = any(name in session.state and not session.state[name] for name in hands)
        return session.scripted and let_go and not session.done

    def hold(self) -> None:
        """Let the hand of a twin wait on its path."""
        self._steer((0.0, 0.0, 0.0))

    def go(self) -> None:
        """Let the hand of a twin go its way."""
        self._steer(None)

    def sensed(self) -> Sensed:
        """Return what the machine is told of the tick that is over."""
        return self.feeling.sensed(self.session)

    def felt(self, void: str) -> Presented:
        """Return the touch that has ended."""
        return self.feeling.presented(self.session, void)

    def run(self, until: Callable[[], bool]) -> None:
        """Run until something is so; asked after every tick."""
        self.session.run(until=until)

    def close(self) -> None:
        """End the session that runs."""
        if self._session is not None:
            self._session.close()

    def _steer(self, step: tuple[float, float, float] | None) -> None:
        session = self.session
        for probe in session.model.probes:
            if f"{probe.name}.hand.steered" in session.state:
                session.steer(probe.name, step)

    def _built(self, condition: Mapping[str, str]) -> Session:
        model = self._models.model(condition)
        real = [name for name, device in model.devices.items() if not device.twin]
        if real:
            raise SessionError(
                f"'{real[0]}' is real: a study's scene changes between trials under twins only so far; run it with "
                "twins, or drive the trials from your own program"
            )
        session = Session(model, seed=self._seed, catalog=self._catalog, clock=self._clock)
        session.records = False
        return session

    def _take(self, session: Session, condition: Mapping[str, str]) -> None:
        try:
            truth = felt_by(session.model)
        except TouchError:  # a scene without heat: the report's figures stand for what was felt
            truth = None
        self._feeling = Feeling(session.model, self._file.study.contact, truth)
        self._feeling.listen(session)
        before, self._session, self.condition = self._session, session, dict(condition)
        if self._record is not None:
            self._keep(before, session, self._record)

    def _keep(self, before: Session | None, session: Session, path: Path) -> None:
        """Let the recording go on, or begin one."""
        session.loss_hooks.append(lambda loss: self.losses.append(str(loss["cause"])))
        if (before is not None and before.hand_on(session)) or self.losses:
            return
        if before is not None:
            before.end_recording()
        self._recorded += 1
        session.record(path if self._recorded == 1 else path.with_name(f"{path.stem}-{self._recorded}.mcap"))


def layout_of(session: Session) -> str:
    """Return the SHA-256 of the fields of a session's State: their names, types and places."""
    return hashlib.sha256(repr(session.state.dtype).encode()).hexdigest()
