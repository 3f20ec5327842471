"""The tools with which people use the framework: command line, window, sound, pages, studies, sweeps and templates.

All of them import ``itouch``, which imports none of them: a touch does not need them.
"""
