"""Check the report of the four-material scene: what the README promises of the main job."""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main() -> int:
    """Check the report named on the command line."""
    report = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    contacts = {entry["material"]: entry for entry in report["contacts"]}
    fluxes = [contacts[name]["mean_flux_W_m2"] for name in ("aluminium", "pyrex", "wood", "polystyrene")]
    checks = {
        "four contacts": len(report["contacts"]) == 4,
        "order of fluxes": fluxes == sorted(fluxes, reverse=True),
        "plate gap below 0.5 mm": all(abs(entry["plate_gap_mm"]) < 0.5 for entry in report["contacts"]),
        "tracking below 1 mm": report["table"]["tracking_mm"]["p99"] < 1.0,
        "no faults": not report["faults"],
    }
    for name, holds in checks.items():
        print(f"{'ok  ' if holds else 'FAIL'} {name}")
    return 0 if all(checks.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
