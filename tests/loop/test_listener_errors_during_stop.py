"""Whoever listens to a session may fail, and a person may press Ctrl-C twice: what is being made safe is made safe."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from exchange_phases import wired, wired_phases

from itouch.faults import Kind
from itouch.loop import DeviceFaultError
from itouch_evidence.faults.behind_wires import Pair


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Pair, tuple[bytes, bytes]]]:
    """Return a host of hardware behind exchanges, and the States in which a finger is about to be pressed."""
    pair = wired()
    yield pair, wired_phases(tmp_path_factory)["contact"]
    pair.host.taps[1:] = []
    pair.close()


class Fails:
    """Raises in each tick of a stop, or in each tick from now on."""

    def __init__(self, pair: Pair, error: BaseException, *, always: bool = False) -> None:
        self._stopping, self._error, self._always = pair.host.state["stopping"], error, always
        self.times = 0

    def __call__(self, tick: int) -> None:
        if self._always or self._stopping.item():
            self.times += 1
            raise self._error


def contact(pressed: tuple[Pair, tuple[bytes, bytes]]) -> Pair:
    pair, states = pressed
    pair.host.taps[1:] = []
    pair.adopt(states)
    pair.enable()
    pair.host.run(1.0)
    assert pair.world.state["finger.plate_force"].item() > 0.5
    return pair


def let_go(pair: Pair) -> bool:
    """Tell whether nothing presses any more, and nothing is driven."""
    off = all(pair.host.state[name].item() == 0.0 for name in ("peltier.sent.current",))
    return off and pair.world.state["finger.plate_force"].item() == 0.0 and pair.truly_safe(pair.host.seconds - 0.5)


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt(), SystemExit(2)], ids=repr)
def test_a_stop_is_carried_out_though_a_listener_fails_in_each_of_its_ticks(
    pressed: tuple[Pair, tuple[bytes, bytes]], error: BaseException
) -> None:
    """It was over in its first tick: the table stood under the finger, and the plate was driven on."""
    pair = contact(pressed)
    heard: list[int] = []
    fails = Fails(pair, error)
    pair.host.taps += [fails, heard.append]
    pair.world.inject("arm", Kind.NAN.label, at=pair.world.seconds + 0.02)
    with pytest.raises(DeviceFaultError if isinstance(error, Exception) else type(error)) as caught:
        pair.host.run(1.0)
    assert let_go(pair)
    assert fails.times > 50
    assert len(heard) > fails.times  # who listens after one that fails is told of each tick, too
    (fault,) = [entry for entry in pair.host.report()["faults"] if entry["trip"] is not None]
    assert fault["safe"]["devices"]["table"].startswith("retracted ")
    notes = getattr(caught.value, "__notes__", [])
    assert notes == (["while all was made safe: OSError: no space left"] if isinstance(error, Exception) else [])


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=repr)
def test_closing_lets_go_of_the_finger_though_a_listener_fails_from_now_on(
    pressed: tuple[Pair, tuple[bytes, bytes]], error: BaseException
) -> None:
    pair = contact(pressed)
    pair.host.taps.append(Fails(pair, error, always=True))
    with pytest.raises(type(error)), pair.host:
        pair.host.run(1.0)
    assert let_go(pair)


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=repr)
def test_a_stop_is_carried_out_though_who_is_told_of_the_fault_first_fails(
    pressed: tuple[Pair, tuple[bytes, bytes]], error: BaseException
) -> None:
    pair, heard = contact(pressed), list[DeviceFaultError]()

    def fails(fault: DeviceFaultError) -> None:
        raise error

    pair.host.on.fault[:] = [fails, heard.append]
    pair.world.inject("arm", Kind.NAN.label, at=pair.world.seconds + 0.02)
    with pytest.raises(DeviceFaultError if isinstance(error, Exception) else type(error)) as caught:
        pair.host.run(1.0)
    pair.host.on.fault[:] = []
    assert let_go(pair)
    assert len(heard) == 1
    notes = getattr(caught.value, "__notes__", [])
    assert notes == (["while it was reported: OSError: no space left"] if isinstance(error, Exception) else [])


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=repr)
def test_a_listener_that_fails_in_a_tick_of_somebodys_own_loop_lets_go_of_the_finger(
    pressed: tuple[Pair, tuple[bytes, bytes]], error: BaseException
) -> None:
    """Only ``run`` made hardware safe: whoever called ``tick`` and never came back left the plate driven till `close`."""
    pair = contact(pressed)
    fails = Fails(pair, error, always=True)
    pair.host.taps.append(fails)
    with pytest.raises(type(error)):
        pair.host.tick()
    assert let_go(pair)
    assert fails.times > 50
