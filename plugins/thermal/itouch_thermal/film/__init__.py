"""An instrumented sample: a flux film on top, a force sensor below, and a thermometer that looks at the finger."""

from itouch_thermal.film.touch_film import TouchFilm

__all__ = ["TouchFilm"]
