"""Exchanges with a device that makes its caller wait: in a thread, or with the same delays on its twin."""

from itouch.exchange.delayed_twin import LateTwin
from itouch.exchange.emulator_thread import ServedEmulator
from itouch.exchange.every_nth_tick import EveryNth
from itouch.exchange.thread import ThreadedDevice
from itouch.exchange.truth import TruthReader, TruthWriter
from itouch.exchange.without_wire import Straight, StraightEmulator

__all__ = [
    "EveryNth",
    "LateTwin",
    "ServedEmulator",
    "Straight",
    "StraightEmulator",
    "ThreadedDevice",
    "TruthReader",
    "TruthWriter",
]
