"""Collision checkers that are kept with their scene, so that many queries in one scene pay for one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rr1plan.collision.checker import CollisionChecker
from rr1plan.collision.collision_geometry import geometry_distance
from rr1plan.scene import Scene

_POOL = "collision checkers"


@contextmanager
def checker_from_pool(
    scene: Scene, arms: Sequence[str] | None = None, margin: float = 0.0
) -> Iterator[CollisionChecker]:
    """A checker that no one else uses inside the block; its counters go on from earlier use.

    Checkers keep scratch memory, so each is used by one caller at a time: threads that plan at once in one scene
    get one each. They live as long as the scene, which is immutable, and are neither pickled nor copied with it.

    Args:
        scene: The scene.
        arms: The arms that move (default: all).
        margin: Distance to keep beyond the scene's padding [m].

    Raises:
        UnknownNameError: no such arm.
        InputError: a scene that cannot be checked.
    """
    names = scene.arm_names(arms)
    checker = acquire_checker(scene, names, margin)
    try:
        yield checker
    finally:
        release_checker(checker)


def acquire_checker(scene: Scene, arms: tuple[str, ...], margin: float) -> CollisionChecker:
    """A checker from the pool, to be released whatever happens; prefer `checker_from_pool`.

    Args:
        scene: The scene.
        arms: The arms that move, as `Scene.arm_names` gives them.
        margin: Distance to keep beyond the scene's padding [m].

    Raises:
        InputError: a scene that cannot be checked.
    """
    # Appending to a list and popping from it are atomic.
    try:
        idle: list[CollisionChecker] = scene.kept[_POOL, arms, geometry_distance(scene, margin)]
        checker = idle.pop()
    except (KeyError, IndexError):
        return CollisionChecker(scene, arms, margin=margin)
    checker.keep_margin(margin)
    return checker


def release_checker(checker: CollisionChecker) -> None:
    """Put a checker back into the pool of its scene."""
    checker.scene.kept.setdefault((_POOL, checker.arms, checker.distance), []).append(checker)
