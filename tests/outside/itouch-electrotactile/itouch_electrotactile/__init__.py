"""An electrode on the fingertip, and the monitor that bounds the charge which it gives."""

from itouch_electrotactile.charge import Charge
from itouch_electrotactile.device import Electrotactile

__all__ = ["Charge", "Electrotactile"]
