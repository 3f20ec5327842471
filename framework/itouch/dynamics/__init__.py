"""Rigid bodies that are pushed and lifted, by MuJoCo (extra ``dynamics``): forces in, poses and twists out."""

from itouch.dynamics.bodies import Bodies, Body, BodyError, available, build_bodies

__all__ = ["Bodies", "Body", "BodyError", "available", "build_bodies"]
