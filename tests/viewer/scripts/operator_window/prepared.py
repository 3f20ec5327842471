"""Before each script: the operator's window, in the middle of a touch."""

from types import SimpleNamespace

from itouch_tools.viewer.operator_window import OperatorWindow
from itouch_tools.viewer.study_screens import LIGHT

face = SimpleNamespace(cue="contact", question="", choices=(), left=2.0, force=None, window=None, trial=3, trials=9,
                       void=1, message="")  # fmt: skip
window = OperatorWindow(look=LIGHT)
lines = [("arm: enabled", True), ("table: fault", False)]


def picture():
    window.show(face, lines)
    window.switch_to()
    return window._frame.read().copy()
