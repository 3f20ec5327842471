"""What the driver does on the bus of `bus.py`: open, load, home, push, exchange, and be unplugged."""

import json
import sys

import usb.core

from itouch_usb_arm import Disconnected, Falcon, NotFound

firmware, exchanges = sys.argv[1], int(sys.argv[2])
found = {"backend": type(usb.core.find(idVendor=0x0403, idProduct=0xCB48).backend).__module__}
arm = Falcon(firmware)
arm.open()
arm.home(20.0)
arm.write((0.0, 0.0, 1.0))
for _ in range(exchanges):
    reading = arm.read()
found["z"] = reading.position[2]
found["rate"] = arm.timing.rate
try:
    while True:
        arm.read()
except Disconnected as error:
    found["error"] = str(error)
try:
    arm.open()
except NotFound as error:
    found["after"] = str(error)
print(json.dumps(found))
