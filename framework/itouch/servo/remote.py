"""Twins in processes of their own (stub)."""

from __future__ import annotations

from itouch.session import Session


class Remotes:
    """Stub."""

    def __init__(self, session: Session, name: str) -> None:
        self.addresses: dict[str, str] = {}

    def connect(self) -> None:
        """."""

    def close(self) -> None:
        """."""
