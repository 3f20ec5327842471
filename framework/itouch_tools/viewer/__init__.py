"""The picture of a session: reads published State, never changes it.

``scene_graph``, ``camera``, ``signals``, ``overlay`` and ``chart_layout`` determine what is shown and need no graphics;
``canvas`` and ``charts`` draw it with OpenGL 3.3; ``window`` shows it, ``offscreen`` and ``film`` write it to files.
"""
