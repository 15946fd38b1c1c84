"""Exact answers about configurations (Coal), certified answers about motions."""

from rr1plan.collision.checker import CollisionChecker, FirstContact
from rr1plan.collision.results import Contact, Nearest
from rr1plan.collision.sphere_covers import ElementCover, cover_with_spheres

__all__ = [
    "CollisionChecker",
    "Contact",
    "ElementCover",
    "FirstContact",
    "Nearest",
    "cover_with_spheres",
]
