"""Exact answers about configurations (Coal), certified answers about motions."""

from rr1plan.collision.exact import CollisionChecker, Contact, Nearest

__all__ = ["CollisionChecker", "Contact", "Nearest"]
