"""``python -m itouch_tools.cli``: the same as ``itouch-py``."""

import sys

from itouch_tools.cli import main

if __name__ == "__main__":
    sys.exit(main())
