"""Sessions: building, saving and restoring an engine."""

from itouch.session.building import build, choose_twins, load_scene, restore
from itouch.session.engine import Session
from itouch.session.errors import SessionError
from itouch.session.open import is_session

__all__ = ["Session", "SessionError", "build", "choose_twins", "is_session", "load_scene", "restore"]
