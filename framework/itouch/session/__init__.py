"""Sessions: building, saving and restoring an engine."""

from itouch.session.engine import Session, build, choose_twins, load_scene, restore
from itouch.session.errors import SessionError
from itouch.session.open import is_session

__all__ = ["Session", "SessionError", "build", "choose_twins", "is_session", "load_scene", "restore"]
