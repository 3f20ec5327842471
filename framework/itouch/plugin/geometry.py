"""Geometry for modalities that compute a contact themselves: the scene's shapes, and what can be asked of them.

It is a module of its own, which ``itouch.plugin`` does not import, because it loads the contact engine; only a modality
that renders contact needs that.  Functions here are compiled: call them from Python or from your own kernels.
"""

from __future__ import annotations

from itouch.contact.distance_queries import point_distance
from itouch.contact.geometry_tables import Geometry
from itouch.contact.layout import RESULT_SIZE as FOUND
from itouch.contact.step import step_within as proxy_step

__all__ = ["FOUND", "Geometry", "point_distance", "proxy_step"]
