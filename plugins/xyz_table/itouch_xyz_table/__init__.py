"""An XYZ table as a device plugin."""
