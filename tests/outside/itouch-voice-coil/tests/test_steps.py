"""Says which step is next: a step is done when its line STEP is gone from the source."""

import re
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "itouch_voice_coil"


def test_all_steps_are_done():
    steps = []
    for path in sorted(SOURCE.glob("*.py")):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            found = re.search(r"STEP (\d+): (.*)", line)
            if found:
                steps.append((int(found[1]), found[2].strip('")'), f"{path.name}:{number}"))
    if steps:
        step, what, where = min(steps)
        raise AssertionError(f"next is step {step}: {what} ({where}); README.md has an example")
