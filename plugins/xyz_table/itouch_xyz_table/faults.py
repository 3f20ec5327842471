"""Names of a moteus servo's modes and faults (the codes of its register 0x00f)."""

from __future__ import annotations

FAULT, POSITION, TIMEOUT = 1, 10, 11
MODES = {
    0: "stopped", 1: "fault", 5: "pwm", 6: "voltage", 7: "voltage foc", 8: "voltage dq", 9: "current", 10: "position",
    11: "timeout", 12: "zero velocity", 13: "stay within", 14: "measuring inductance", 15: "brake",
}  # fmt: skip
FAULTS = {
    1: "dma stream transfer error", 2: "dma stream fifo error", 3: "uart overrun", 4: "uart framing error",
    5: "uart noise", 6: "uart buffer overrun", 7: "uart parity error", 32: "calibration fault",
    33: "motor driver fault", 34: "over voltage", 35: "encoder fault", 36: "motor not configured",
    37: "pwm cycle overrun", 38: "over temperature", 39: "started outside its position limits", 40: "under voltage",
    41: "configuration changed while it ran", 42: "no valid commutation encoder", 43: "no valid output position",
    44: "motor driver could not be enabled", 45: "stop position is deprecated", 46: "timing violation",
    47: "feed-forward of acceleration is not configured", 48: "limits are not valid",
}  # fmt: skip
#: Codes that say which limit is in force; the servo goes on.
LIMITS = {
    96: "velocity", 97: "power", 98: "voltage", 99: "current", 100: "board temperature", 101: "motor temperature",
    102: "commanded torque", 103: "position",
}  # fmt: skip


def mode_name(mode: int) -> str:
    """Return the name of a mode."""
    return MODES.get(mode, f"mode {mode}")


def fault_name(code: int) -> str:
    """Return the meaning of a fault code."""
    return FAULTS.get(code) or (f"limited by {LIMITS[code]}" if code in LIMITS else f"fault {code}")
