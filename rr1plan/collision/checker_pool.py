"""Collision checkers that their scene keeps, so that many queries in one scene build only one.

A scene without an idle checker takes one of a scene with the same arms and the same kinds of obstacles at other poses,
if there is one: among recently released checkers, the one unused for longest.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock

from rr1plan.collision.checker import CollisionChecker
from rr1plan.collision.collision_geometry import collision_geometry, geometry_distance
from rr1plan.scene import Scene
from rr1plan.thread_locks import per_process

# Recently released checkers and the lists that hold them; their scenes may no longer exist. Of those with the same
# pairs, the last `_LEFT_ALONE` are not taken, for callers that alternate between that many scenes.
_last_released: dict[CollisionChecker, list[CollisionChecker]] = {}
_lock = per_process(sys.modules[__name__], "_lock", Lock)
_MOST, _LEFT_ALONE = 8, 3


@contextmanager
def checker_from_pool(
    scene: Scene, arms: Sequence[str] | None = None, margin: float = 0.0
) -> Iterator[CollisionChecker]:
    """A checker for exclusive use inside the block; its counters continue from earlier use.

    Checkers have scratch memory, so each is used by one caller at a time: threads that plan simultaneously in one scene
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
    """A checker from the pool, which the caller has to release in any case; prefer `checker_from_pool`.

    Args:
        scene: The scene.
        arms: The arms that move, as returned by `Scene.arm_names`.
        margin: Distance to keep beyond the scene's padding [m].

    Raises:
        InputError: a scene that cannot be checked.
    """
    # Appending to a list and popping from it are atomic.
    try:
        checker = _idle(scene, arms, geometry_distance(scene, margin)).pop()
    except IndexError:
        checker = _of_another_scene(scene, arms, margin) or CollisionChecker(scene, arms, margin=margin)
    checker.keep_margin(margin)
    return checker


def release_checker(checker: CollisionChecker) -> None:
    """Put a checker back into the pool of its scene."""
    idle = _idle(checker.scene, checker.arms, checker.omission_distance)
    idle.append(checker)
    if checker.is_warm:
        with _lock:
            _last_released.pop(checker, None)
            _last_released[checker] = idle
            if len(_last_released) > _MOST:
                del _last_released[next(iter(_last_released))]


def _idle(scene: Scene, arms: tuple[str, ...], distance: float) -> list[CollisionChecker]:
    """The idle checkers of a scene."""
    idle: list[CollisionChecker] = scene.kept.setdefault(("collision checkers", arms, distance), [])
    return idle


def _of_another_scene(scene: Scene, arms: tuple[str, ...], margin: float) -> CollisionChecker | None:
    """An idle checker of another scene, switched to this one, which is faster than a new one; None if there is none."""
    geometry = collision_geometry(scene, arms, geometry_distance(scene, margin))
    with _lock:
        alike = [(one, idle) for one, idle in _last_released.items() if one.pair_tables is geometry.pairs]
    for checker, idle in alike[:-_LEFT_ALONE]:
        try:
            idle.remove(checker)
        except ValueError:  # in use
            continue
        if checker.change_to(geometry, scene):
            return checker
        idle.append(checker)
    return None
