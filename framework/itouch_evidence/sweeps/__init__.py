"""Measurements of sweeps: sessions a second, what a run costs, and whether a row is lost when something dies."""
