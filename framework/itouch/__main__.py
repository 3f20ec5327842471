"""``python -m itouch``: the same as ``itouch-py``."""

import sys
from importlib import import_module

if __name__ == "__main__":
    # imported by name at run time: the core imports nothing from the tools
    sys.exit(import_module("itouch_tools.cli").main())
