"""Sessions: building, saving and restoring an engine."""

from itouch.session.building import build, choose_twins, load_scene, restore
from itouch.session.open import is_session
from itouch.session.session import Session
from itouch.session.session_error import SessionError

__all__ = ["Session", "SessionError", "build", "choose_twins", "is_session", "load_scene", "restore"]
