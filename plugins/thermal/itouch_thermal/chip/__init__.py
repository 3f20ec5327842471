"""The reference display's chip in simulation: its firmware, compiled locally, with the twin's plate at its pins."""
