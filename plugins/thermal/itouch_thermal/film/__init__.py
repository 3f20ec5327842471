"""An instrumented sample: a flux film on it, a force sensor under it, and a thermometer that looks at the finger."""

from itouch_thermal.film.touch_film import TouchFilm

__all__ = ["TouchFilm"]
