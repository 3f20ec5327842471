"""The reference display's chip in a simulator: its program, compiled here, with a twin's plate at its pins."""
