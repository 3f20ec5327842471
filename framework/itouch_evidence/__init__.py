"""What shows that the framework is right and quick enough: its measurements, and campaigns that break it on purpose.

It imports ``itouch`` and ``itouch_tools``, which import nothing of it: they find its commands by their entry points.
"""
