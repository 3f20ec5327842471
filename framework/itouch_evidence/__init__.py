"""Evidence that the framework is right and fast enough: its measurements, and campaigns that break it on purpose.

It imports ``itouch`` and ``itouch_tools``, which do not import it: they find its commands through entry points.
"""
