"""Sessions: building, saving and restoring an engine."""

from itouch.session.engine import Session, build, choose_twins, load_scene, restore
from itouch.session.snapshot import SessionError

__all__ = ["Session", "SessionError", "build", "choose_twins", "load_scene", "restore"]
