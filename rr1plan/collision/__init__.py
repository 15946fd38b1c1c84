"""Exact results for configurations (Coal), certified results for motions."""

from rr1plan.collision.checker import CollisionChecker, FirstContact
from rr1plan.collision.coal_pairs import Contact, Nearest
from rr1plan.collision.sphere_covers import ElementCover, cover_with_spheres
from rr1plan.collision.timed_checker import TimedChecker, TimedContact

__all__ = [
    "CollisionChecker",
    "Contact",
    "ElementCover",
    "FirstContact",
    "Nearest",
    "TimedChecker",
    "TimedContact",
    "cover_with_spheres",
]
