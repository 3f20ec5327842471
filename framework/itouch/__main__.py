"""``python -m itouch``: the same as ``itouch-py``."""

import sys

from itouch.cli import main

if __name__ == "__main__":
    sys.exit(main())
