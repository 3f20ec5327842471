"""The operator's finger as a twin, and its coupling to the twins of devices."""
