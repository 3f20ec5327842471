"""What people use the framework with: the command line, the window, sound, pages, studies, sweeps and beginnings.

All of it imports ``itouch``, which imports nothing of it: a touch needs none of this.
"""
