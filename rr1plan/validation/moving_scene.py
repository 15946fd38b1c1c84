"""A scene in which some arms move, as plain arrays for the compiled search."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate

import numpy as np

from rr1plan.errors import InputError
from rr1plan.path import arms_of
from rr1plan.scene import Scene
from rr1plan.scene.scene_content import largest_padding
from rr1plan.validation.limit_checks import columns_of
from rr1plan.validation.referee_scene import RefereeScene, referee_scene


class MovingScene:
    """A scene with the arms that have columns first, then the other arms, then the obstacles.

    Args:
        tables: The scene.
        joint_names: The columns, all joints of their arms.

    Attributes:
        tables: The scene.
        columns: Names and limits of the columns.
        columns_of_arm: Columns of each arm that moves, by its name.
        arms: Numbers of the arms in `tables`, in that order.
        moving: How many of them move.
        fields: Fields of `RefereeSearch` that are the same for all motions of these columns.

    Raises:
        InputError: a half-space on a link that moves.
    """

    def __init__(self, tables: RefereeScene, joint_names: tuple[str, ...]) -> None:
        self.tables, scene = tables, tables.scene
        moving = arms_of(joint_names)
        places = {name: i for i, name in enumerate(joint_names)}
        self.columns_of_arm = {
            name: [places[f"{name}/{joint}"] for joint in scene.arms[name].robot.joint_names] for name in moving
        }
        self.columns = columns_of(scene.arms, self.columns_of_arm, joint_names)
        still = [name for name in tables.names if name not in self.columns_of_arm]
        self.arms = [tables.numbers[name] for name in (*moving, *still)]
        self.moving = len(moving)
        self._elements: dict[int, tuple[int, str, str]] = {}
        if any(model.moving_planes for model in tables.models):
            self._check_moving_planes()
        self.fields = self._instances(still) | self._rule_rows()

    def _check_moving_planes(self) -> None:
        tables = self.tables
        alone = len(tables.names) + len(tables.obstacles) == 1
        for arm in self.arms[: self.moving]:
            model = tables.model(arm)
            for i in model.moving_planes:
                if alone and model.own_checked is not None and not model.own_checked[i].any():
                    continue  # There is nothing to keep it apart from.
                _, name, _ = tables.element(arm, i)
                raise InputError(f"{name!r} moves and has a half-space for a shape; expected a bounded shape")

    def _instances(self, still: list[str]) -> dict[str, object]:
        """The arms as instances of models."""
        tables, arms = self.tables, self.tables.scene.arms
        models = [*(tables.model_of[i] for i in self.arms), len(tables.models) - 1]
        columns = [column for columns in self.columns_of_arm.values() for column in columns]
        self._equal_arms = self._group_equal_arms()
        return {
            "models": tables.model_rows,
            "arm_models": np.array(models, dtype=np.int64),
            "columns_of_q": np.array(columns, dtype=np.int64),
            "configurations": np.concatenate([np.zeros(0), *(arms[name].q for name in still)]),
            "base_poses": np.concatenate([np.zeros((0, 4)), *(arms[tables.names[i]].base for i in self.arms)]),
            "own_arms": np.array(list(self._equal_arms), dtype=np.int64),
            "own_arm_count": len(self._equal_arms),
            "moving_count": self.moving,
            "stationary_count": len(still),
            "padding": tables.scene.padding,
            "most_padding": largest_padding(self.tables.scene),
            "sweep_stride": 1 + max(model.depth for model in tables.models),
        }

    def _group_equal_arms(self) -> dict[int, list[int]]:
        """Groups of stationary arms with equal models, configurations and own rules, by the first arm of each."""
        tables = self.tables
        if self.moving == len(self.arms):
            return {}
        rules = {one: paddings.tobytes() for (one, two), paddings in tables.rules.items() if one == two}
        found: dict[tuple[int, bytes, bytes], list[int]] = {}
        for place, arm in enumerate(self.arms[self.moving :], start=self.moving):
            configuration = tables.scene.arms[tables.names[arm]].q.tobytes()
            found.setdefault((tables.model_of[arm], configuration, rules.get(arm, b"")), []).append(place)
        return {first: others for first, *others in found.values()}

    def _rule_rows(self) -> dict[str, object]:
        """The rules, by the positions of their owners in this order."""
        if not self.tables.rules:
            return {"rule_count": 0}
        arms = len(self.arms)
        count = arms + len(self.tables.obstacles)
        place = np.concatenate([np.argsort(self.arms), np.arange(arms, count)]).tolist()
        starts: dict[tuple[tuple[int, ...], bytes], int] = {}
        rows, parts, size = [], [np.zeros(0)], 0
        for owners, table in self.tables.rules.items():
            one, two = (place[owner] for owner in owners)
            paddings = np.ascontiguousarray(table if one <= two else table.T)
            content = paddings.shape, paddings.tobytes()
            if content not in starts:
                starts[content] = size
                parts.append(paddings.ravel())
                size += paddings.size
            rows.append((min(one, two) * count + max(one, two), starts[content]))
        return {
            "rules": np.array(sorted(rows), dtype=np.int64).reshape(-1, 2),
            "rule_count": len(rows),
            "paddings": np.concatenate(parts),
        }

    # ---- elements -----------------------------------------------------------------------------

    @cached_property
    def first_element(self) -> list[int]:
        """Number of the first element of each arm in this order, of the obstacles, and one past the last."""
        tables = self.tables
        counts = [*(tables.model(i).element_count for i in self.arms), len(tables.obstacles)]
        return [0, *accumulate(counts)]

    def _locate(self, element: int) -> tuple[int, int]:
        """Position of an element's arm, or of the obstacles, and the element's number there."""
        place = min(bisect_right(self.first_element, element) - 1, len(self.arms))
        return place, element - self.first_element[place]

    def element(self, element: int) -> tuple[int, str, str]:
        """Index among all elements of the scene, name and owner's name of an element."""
        known = self._elements.get(element)
        if known is None:
            (place, local), arms = self._locate(element), len(self.arms)
            owner = (self.arms[place], local) if place < arms else (arms + local, 0)
            known = self._elements[element] = self.tables.element(*owner)
        return known

    def equal_pairs(self, pair: tuple[int, int]) -> Iterator[tuple[int, int]]:
        """A pair of elements and, if it belongs to one arm, the same pair of all stationary arms equal to it."""
        yield pair
        (place, a), (other, b) = (self._locate(element) for element in pair)
        if place == other:
            for equal in self._equal_arms.get(place, ()):
                first = self.first_element[equal]
                yield first + a, first + b


def moving_scene(scene: Scene, joint_names: tuple[str, ...]) -> MovingScene:
    """The scene with these columns; the scene keeps that of the latest columns.

    Args:
        scene: The scene.
        joint_names: The columns, all joints of their arms.

    Raises:
        InputError: shapes that cannot be compared, or a joint that follows no joint with a value.
    """
    kept: tuple[tuple[str, ...], MovingScene] | None = scene.kept.get("moving")
    if kept is None or kept[0] != joint_names:
        kept = scene.kept["moving"] = joint_names, MovingScene(referee_scene(scene), joint_names)
    return kept[1]
