"""Campaigns that kill, suspend or starve processes of a session; the twins tell how soon everything was safe."""
