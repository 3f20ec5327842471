"""Exchanging with a device that makes its caller wait: in a thread, or with the same delays on its twin."""

from itouch.exchange.late import LateTwin
from itouch.exchange.nth import EveryNth
from itouch.exchange.served import ServedEmulator
from itouch.exchange.straight import Straight, StraightEmulator
from itouch.exchange.thread import ThreadedDevice

__all__ = ["EveryNth", "LateTwin", "ServedEmulator", "Straight", "StraightEmulator", "ThreadedDevice"]
