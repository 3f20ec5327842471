"""The operator's finger as a twin, and what couples the twins of devices to it."""
