"""Measuring real touches: sample an instrumented sample, correct for its sensors, average, and write a curve."""
