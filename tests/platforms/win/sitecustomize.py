"""Read by an interpreter when it starts: from here on it is as on another system."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
import without_linux

sys.path.pop()
without_linux.become("win")
