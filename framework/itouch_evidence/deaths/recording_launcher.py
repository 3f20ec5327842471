"""A launcher that records, as a laboratory would.

``python -m itouch_evidence.deaths.recording_launcher SCENE NAME RECORDING PARENT``
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

from itouch.schema import ItouchError
from itouch.servo import launch
from itouch.servo.parent_process import gone
from itouch.session.outputs import Outputs


def main(argv: Sequence[str]) -> int:
    """Run a session to its end; SIGTERM asks it to end."""
    try:
        with launch(argv[0], name=argv[1], keep=Outputs(record=argv[2])) as handle:
            signal.signal(signal.SIGTERM, lambda number, frame: handle.request_stop())
            print("launched", flush=True)
            while not handle.wait(0.2):
                if gone(int(argv[3])):  # the campaign that would end it is gone
                    handle.request_stop()
    except ItouchError as error:
        print(error, flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
