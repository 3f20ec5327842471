"""Exchanges with a device that makes its caller wait: in a thread, or with the same delays on its twin."""

from itouch.exchange.delayed_twin import LateTwin
from itouch.exchange.exchanged import Exchanged, failed_in, still_inside
from itouch.exchange.in_step import DirectEmulator, DirectHost, EveryNth
from itouch.exchange.shared_state import TruthReader, TruthWriter
from itouch.exchange.thread import ServedEmulator, ThreadedDevice

__all__ = [
    "EveryNth",
    "Exchanged",
    "LateTwin",
    "ServedEmulator",
    "DirectHost",
    "DirectEmulator",
    "ThreadedDevice",
    "TruthReader",
    "TruthWriter",
    "failed_in",
    "still_inside",
]
