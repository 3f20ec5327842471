"""The thermal display and the heat of a touched object."""
