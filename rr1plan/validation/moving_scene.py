"""A scene in which some arms move, as plain arrays for the compiled search."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rr1plan.errors import InputError
from rr1plan.scene import Scene
from rr1plan.validation.contact_paddings import ALLOWED
from rr1plan.validation.limits import columns_of
from rr1plan.validation.referee_scene import RefereeScene, referee_scene

# Columns of `ArmTables.counts`.
_COLUMNS, _LINKS, _JOINTS, _BODIES, _ELEMENTS = range(5)


class MovingScene:
    """A scene with the arms first that some columns move, then the others, then the obstacles.

    Args:
        tables: The scene.
        joint_names: The columns, all joints of their arms.

    Attributes:
        tables: The scene.
        columns: Names, units and limits of the columns.
        columns_of_arm: Columns of each arm that moves, by its name.
        arms: Numbers in `tables` of the arms in that order, shape (n,).
        moving: How many of them move.
        first_element: Number of the first element of each arm in that order and of the obstacles, shape (n + 1,).
        owner_bodies: Bodies of each arm and of each obstacle, shape (owners,).
        link_count, body_count, element_count: How many there are.
        postures: Columns of the arms that stand still [rad or m], one after the other.
        fields: Fields of `RefereeSearch` that are the same for all motions of these columns.

    Raises:
        InputError: a half-space on a link that moves.
    """

    def __init__(self, tables: RefereeScene, joint_names: tuple[str, ...]) -> None:
        self.tables, scene = tables, tables.scene
        self.columns = columns_of(scene.arms, joint_names)
        places = {name: i for i, name in enumerate(joint_names)}
        moving = list(dict.fromkeys(name.split("/", 1)[0] for name in joint_names))
        self.columns_of_arm = {
            name: [places[f"{name}/{joint}"] for joint in scene.arms[name].robot.joint_names] for name in moving
        }
        still = [name for name in tables.names if name not in self.columns_of_arm]
        self.arms = np.array([tables.numbers[name] for name in (*moving, *still)], dtype=np.int64)
        self.moving = len(moving)
        self.postures = np.concatenate([np.zeros(0), *(scene.arms[name].q for name in still)])
        self._check_moving_planes()
        self.fields = self._instances() | self._rule_rows()

    def _check_moving_planes(self) -> None:
        tables = self.tables
        alone = len(tables.names) + len(tables.obstacles) == 1
        for arm in self.arms[: self.moving].tolist():
            model = tables.model(arm)
            for i in np.flatnonzero(model.has_plane & model.carried).tolist():
                if alone and not model.own_checked[i].any():
                    continue  # There is nothing to keep it apart from.
                _, name, _ = tables.element(arm, i)
                raise InputError(f"{name!r} moves and has a half-space for a shape; expected a bounded shape")

    def _instances(self) -> dict[str, Any]:
        """The arms as instances of models, and how many of all there are."""
        tables, scene = self.tables, self.tables.scene
        models = np.append(tables.model_of[self.arms], len(tables.models) - 1)
        counts = np.array([model.counts for model in tables.models])[models]
        first = np.concatenate([np.zeros((1, 5), np.int64), np.cumsum(counts, axis=0)])
        total = first[-1].tolist()
        self.link_count, self.body_count, self.element_count = (total[i] for i in (_LINKS, _BODIES, _ELEMENTS))
        self.first_element = first[:-1, _ELEMENTS]
        self.owner_bodies = np.concatenate([counts[:-1, _BODIES], np.diff(tables.models[-1].element_bodies)])
        columns = [column for columns in self.columns_of_arm.values() for column in columns]
        bases = np.array([*(scene.arms[tables.names[i]].base for i in self.arms.tolist()), np.eye(4)])
        self._equal_arms = self._group_equal_arms()
        return {
            "models": tables.model_rows,
            "arms": np.column_stack([models, first[:-1]]),
            "arm_columns": np.array([*columns, *range(len(columns), total[_COLUMNS])], dtype=np.int64),
            "bases": np.concatenate([bases[:, :3, :3].reshape(-1, 9), bases[:, :3, 3]], axis=1),
            "own_arms": np.array(list(self._equal_arms), dtype=np.int64),
            "own_arm_count": len(self._equal_arms),
            "moving_count": self.moving,
            "standing_count": len(self.arms) - self.moving,
            "owner_count": len(self.owner_bodies),
            "element_count": self.element_count,
            "joint_count": total[_JOINTS],
            "padding": scene.padding,
            "most_padding": self.most_padding,
            "sweep_stride": 1 + max(model.depth for model in tables.models),
        }

    def _group_equal_arms(self) -> dict[int, list[int]]:
        """Arms that stand still and differ in model, posture or rules about own pairs; of each, those equal to it."""
        tables = self.tables
        rules = {one: paddings.tobytes() for (one, two), paddings in tables.rules.items() if one == two}
        found: dict[tuple[int, bytes, bytes], list[int]] = {}
        for place, arm in enumerate(self.arms[self.moving :].tolist(), start=self.moving):
            posture = tables.scene.arms[tables.names[arm]].q.tobytes()
            found.setdefault((int(tables.model_of[arm]), posture, rules.get(arm, b"")), []).append(place)
        return {first: others for first, *others in found.values()}

    def _rule_rows(self) -> dict[str, Any]:
        """The rules by the places of their owners."""
        arms, count = len(self.arms), len(self.owner_bodies)
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

    @property
    def most_padding(self) -> float:
        """The largest distance to keep between two elements [m]."""
        return max((self.tables.scene.padding, *self.tables.scene.pair_padding.values()))

    def _locate(self, element: int) -> tuple[int, int]:
        """Place of the arm of an element, or of the obstacles, and the number of the element there."""
        place = int(np.searchsorted(self.first_element, element, side="right")) - 1
        return place, element - int(self.first_element[place])

    def owner(self, element: int) -> tuple[int, int]:
        """Number in `tables` of the owner of an element, and which of the owner's elements it is."""
        (place, local), arms = self._locate(element), len(self.arms)
        return (int(self.arms[place]), local) if place < arms else (arms + local, 0)

    def element(self, element: int) -> tuple[int, str, str]:
        """Place among all elements of the scene, name and owner's name of an element."""
        return self.tables.element(*self.owner(element))

    def padding_between(self, a: int, b: int) -> float:
        """Distance to keep between two elements [m]; `ALLOWED` where they may touch."""
        (one, i), (two, j) = sorted((self.owner(a), self.owner(b)))
        if one >= len(self.arms):
            return ALLOWED  # Two obstacles.
        return float(self.tables.paddings_between(one, two)[i, j])

    def concave_elements(self) -> list[int]:
        """Elements of which a shape is not convex."""
        models = self.tables.models
        if not any(model.has_concave.any() for model in models):
            return []
        rows = [models[i].has_concave for i in (*self.tables.model_of[self.arms].tolist(), -1)]
        found: list[int] = np.flatnonzero(np.concatenate(rows)).tolist()
        return found

    def decides_own_pairs(self, element: int) -> bool:
        """Whether an arm moves, or is the first of those that stand still in the same posture."""
        place, _ = self._locate(element)
        return place < self.moving or place in self._equal_arms

    def equal_pairs(self, pair: tuple[int, int]) -> Iterator[tuple[int, int]]:
        """A pair of elements, and if it is an arm's own the same one of all arms that stand still in its posture."""
        yield pair
        (place, a), (other, b) = (self._locate(element) for element in pair)
        if place == other:
            for equal in self._equal_arms.get(place, ()):
                first = int(self.first_element[equal])
                yield first + a, first + b


def moving_scene(scene: Scene, joint_names: tuple[str, ...]) -> MovingScene:
    """The scene with these columns; that of the last columns is kept with the scene.

    Args:
        scene: The scene.
        joint_names: The columns, all joints of their arms.

    Raises:
        InputError: shapes that cannot be compared, or a joint that follows none that has a value.
    """
    kept: tuple[tuple[str, ...], MovingScene] | None = scene.kept.get("moving")
    if kept is None or kept[0] != joint_names:
        kept = scene.kept["moving"] = joint_names, MovingScene(referee_scene(scene), joint_names)
    return kept[1]
