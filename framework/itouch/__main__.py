"""``python -m itouch``: the same as ``itouch-py``."""

import sys
from importlib import import_module

if __name__ == "__main__":
    # looked up by its name: the core imports nothing of the tools
    sys.exit(import_module("itouch_tools.cli").main())
