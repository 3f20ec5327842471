"""Processes of a session are killed, suspended or starved; the twins tell how soon all was safe."""
