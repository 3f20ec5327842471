"""Which extras are installed: whether what ``pip install 'itouch-py[NAME]'`` brings is there, and which version."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version

from itouch_tools.cli.doctor.diagnosis import Diagnosis

#: Extras for people who work on itouch-py itself.
_OWN = frozenset({"test", "lint", "docs", "mutation", "bids"})
_NEEDS = re.compile(r"^([A-Za-z0-9._-]+).*;.*extra\s*==\s*['\"]([A-Za-z0-9._-]+)['\"]")


def extras() -> Diagnosis:
    """Which extras are installed, with their packages, and which are not."""
    there, missing = [], []
    for name, packages in sorted(named(requires("itouch-py") or ()).items()):
        found = {package: _version(package) for package in packages}
        if all(found.values()):
            there.append(f"{name} ({', '.join(f'{package} {found[package]}' for package in packages)})")
        else:
            missing.append(name)
    said = ", ".join(there) or "none"
    if missing:
        return Diagnosis("extras", "note", f"{said}; not: {', '.join(missing)}",
                       f"pip install 'itouch-py[{missing[0]}]' brings one")  # fmt: skip
    return Diagnosis("extras", "ok", said)


def named(requirements: Iterable[str]) -> dict[str, list[str]]:
    """Return the packages that each extra asks for, given a distribution's requirements; without developers' extras."""
    found: dict[str, list[str]] = {}
    for line in requirements:
        match = _NEEDS.match(line)
        if match and match[2] not in _OWN and match[1].lower() != "itouch-py":
            found.setdefault(match[2], []).append(match[1])
    return found


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
