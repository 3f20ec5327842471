"""Psychophysical studies: their design, trials, data and statistics."""
