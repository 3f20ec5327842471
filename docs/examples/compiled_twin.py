"""A rod on a spring, twice: its twin in plain Python, and compiled so that it joins the tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from itouch.plugin import Bound, Device, Field, Record, Twin, TwinInputs, pose, schema
from itouch.plugin.kernels import kernel


@dataclass(frozen=True, slots=True)
class RodParams:
    """What ``<rod:hardware>`` may hold."""

    stiffness: float = schema.quantity("N/m", low=1.0, high=1e4, default=400.0, doc="of the spring")
    mass: float = schema.quantity("kg", low=1e-3, high=10.0, default=0.05, doc="of the rod")


class PythonTwin(Twin):
    """The rod swings about its rest; in plain Python."""

    def fields(self) -> tuple[Field, ...]:
        """Return height and speed."""
        return (
            Field("height", unit="m", doc="true height of the rod"),
            Field("speed", unit="m/s", doc="true speed of the rod"),
        )

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Swing for a period under what presses on it."""
        force = touch.wrench[2].item() - self.params.stiffness * state["height"].item()
        speed = 0.999 * state["speed"].item() + period * force / self.params.mass
        state["speed"] = speed
        state["height"] = state["height"].item() + period * speed

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the height."""
        reading["pose"] = (0.0, 0.0, state["height"].item(), 1.0, 0.0, 0.0, 0.0)
        return True


@kernel
def swing(height: Any, speed: Any, wrench: Any, stiffness: float, mass: float, period: float) -> int:
    """Swing for a period; height [m] and speed [m/s] have shape (1,), what presses [N] shape (6,)."""
    force = wrench[2] - stiffness * height[0]
    speed[0] = 0.999 * speed[0] + period * force / mass
    height[0] += period * speed[0]
    return 0


class CompiledTwin(PythonTwin):
    """The same rod; its step joins those beside it."""

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        """Return the step on these views as one compiled call."""
        p = self.params
        return Bound(swing, state["height"], state["speed"], touch.wrench, p.stiffness, p.mass, period)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Swing for a period under what presses on it."""
        self.bound_step(state, command, touch, period)()


class Rod(Device):
    """A rod on a spring that is only looked at."""

    Params, Twin = RodParams, CompiledTwin
    reads = (pose(),)
    twin_only = True

    def open(self) -> None:
        """Do nothing: there is only the twin."""

    def close(self) -> None:
        """Do nothing."""

    def read(self, reading: Record) -> bool:
        """Have nothing new."""
        return False


def height_after(twin: Twin, ticks: int) -> float:
    """Return the height [m] of a rod that 1 N presses on from below, after so many ticks of 1 ms."""
    state, touch = Record.of(twin.fields()), TwinInputs()
    touch.wrench[2] = 1.0
    for _ in range(ticks):
        twin.step(state, Record.of(()), touch, 1e-3)
    return float(state["height"])


if __name__ == "__main__":
    heights = [height_after(cls(RodParams()), 1000) for cls in (PythonTwin, CompiledTwin)]
    print(f"{heights[0] * 1e3:.3f} mm, {'the same' if heights[0] == heights[1] else 'not the same'} compiled")
