"""A framework for touch rendering with kinesthetic and thermal feedback."""
