"""Haply Inverse3 through the Inverse Service: the device plugin, its driver, and a virtual service to test with."""

from itouch_arms.haply.haply_device import Haply, HaplyParams
from itouch_arms.haply.inverse3 import Inverse3

__all__ = ["Haply", "HaplyParams", "Inverse3"]
