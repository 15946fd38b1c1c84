"""Motion checkers that are kept with their scene, so that many queries in one scene pay for one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rr1plan.collision.motion import MotionChecker
from rr1plan.scene import Scene


@contextmanager
def borrowed_checker(scene: Scene, arms: Sequence[str] | None = None) -> Iterator[MotionChecker]:
    """A motion checker that is nobody else's inside the block; its counters go on from earlier use.

    Checkers keep scratch memory, so each is lent to one caller at a time: threads that plan at once in one scene
    get one each. They live as long as the scene, which is immutable, and are neither pickled nor copied with it.

    Args:
        scene: The scene.
        arms: The arms that move (default: all).

    Raises:
        UnknownNameError: no such arm.
        InputError: a scene that cannot be checked.
    """
    # Appending to a list and popping from it are atomic.
    idle: list[MotionChecker] = scene.kept.setdefault(("motion checkers", scene.arm_names(arms)), [])
    try:
        checker = idle.pop()
    except IndexError:
        checker = MotionChecker(scene, arms)
    try:
        yield checker
    finally:
        idle.append(checker)
