"""A USB haptic arm as a device plugin."""
