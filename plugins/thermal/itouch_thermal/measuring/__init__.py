"""Measuring real touches: sampling an instrumented sample, taking the sensors out, averaging, writing a curve."""
