"""Exact answers about configurations (Coal), certified answers about motions."""

from rr1plan.collision.answers import Contact, Nearest
from rr1plan.collision.covers import ElementCover, cover_with_spheres
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.motion import FirstContact, MotionChecker

__all__ = [
    "CollisionChecker",
    "Contact",
    "ElementCover",
    "FirstContact",
    "MotionChecker",
    "Nearest",
    "cover_with_spheres",
]
