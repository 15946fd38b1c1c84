"""A scene as plain arrays for the compiled search: models of robots, their instances, and rules about contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.scene import Scene
from rr1plan.validation.arm_tables import ArmTables, HeldThing, Table, arm_tables, obstacle_tables
from rr1plan.validation.contact_paddings import ALLOWED, Elements, block_paddings, rules_by_owners
from rr1plan.validation.limits import Columns, columns_of
from rr1plan.validation.native import SOURCES

# Columns of `ArmTables.counts`.
_COLUMNS, _LINKS, _JOINTS, _BODIES, _ELEMENTS = range(5)


@dataclass(frozen=True, eq=False)
class Arrangement:
    """The order in which the search sees the arms of a scene: those that move come first.

    Args:
        columns: Names, units and limits of the columns of the motion.
        arms: Numbers of the arms in that order, shape (n,).
        moving: How many of them move.
        columns_of_arm: Columns of each arm that moves, by its name.
        fields: Fields of `RefereeSearch` that are the same for all motions of these columns.
        twins: Arms that stand still and have the same own pairs in the same posture: by the first of them, the others;
            by places in that order.
        first_element: Number of the first element of each arm in that order and of the obstacles, shape (n + 1,).
        owner_bodies: Bodies of each owner in that order: the arms and then the obstacles, shape (owners,).
        link_count, body_count, element_count: How many there are.
        most_padding: The largest distance to keep between two elements [m].
        postures: Columns of the arms that do not move [rad or m], one after the other.
    """

    columns: Columns
    arms: Table
    moving: int
    columns_of_arm: Mapping[str, list[int]]
    fields: dict[str, Any]
    twins: Mapping[int, list[int]]
    first_element: Table
    owner_bodies: Table
    link_count: int
    body_count: int
    element_count: int
    most_padding: float
    postures: Array


class RefereeScene:
    """A scene for the referee, whichever arms move in it.

    Attributes:
        scene: The scene.
        models: The models, the last one of all obstacles.
        model_of: The model of each arm, shape (arms,).
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.names, self._obstacles = list(scene.arms), list(scene.obstacles)
        self._held: dict[str, list[str]] = {}
        for name, thing in scene.attachments.items():
            self._held.setdefault(thing.arm, []).append(name)
        self.models: list[ArmTables] = []
        known: dict[tuple[int, tuple[HeldThing, ...]], int] = {}
        numbers = []
        for name, arm in scene.arms.items():
            held = tuple(HeldThing.of(scene.attachments[thing]) for thing in self._held.get(name, ()))
            key = id(arm.robot), held
            if key not in known:
                known[key] = len(self.models)
                self.models.append(arm_tables(arm.robot, held))
            numbers.append(known[key])
        self.model_of = np.array(numbers, dtype=np.int64)
        self.models.append(obstacle_tables(scene.obstacles.values()))
        self._arranged: tuple[tuple[str, ...], Arrangement] | None = None
        self._check_half_spaces()

    # ---- names --------------------------------------------------------------------------------

    @cached_property
    def _owner_numbers(self) -> dict[str, int]:
        return {name: i for i, name in enumerate([*self.names, *self.scene.obstacles])}

    @cached_property
    def _attachment_order(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.scene.attachments)}

    @cached_property
    def _link_starts(self) -> Table:
        """Elements before the links of each arm, before the obstacles and before the attached objects."""
        links = np.array([len(model.links) for model in self.models], dtype=np.int64)[self.model_of]
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(links)])

    def elements(self, owner: int) -> Elements:
        """The elements of an owner: an arm by its number, or after those an obstacle."""
        arms = len(self.names)
        obstacles = self._link_starts[arms]
        if owner >= arms:
            name = self._obstacles[owner - arms]
            return Elements(name, {name: 0}, np.array([obstacles + owner - arms]))
        name, links = self.names[owner], self.models[self.model_of[owner]].links
        held, attached = self._held.get(name, []), obstacles + len(self._obstacles)
        names = [*(f"{name}/{link}" for link in links), *held]
        order = [*(self._link_starts[owner] + i for i in range(len(links)))]
        order += [attached + self._attachment_order[thing] for thing in held]
        return Elements(name, {element: i for i, element in enumerate(names)}, np.array(order, dtype=np.int64))

    def element(self, arrangement: Arrangement, number: int) -> tuple[int, str, str]:
        """Place among all elements of the scene, name and owner of an element of the search."""
        owner, local = self._locate(arrangement, number)
        arms = len(self.names)
        if owner >= arms:
            name = self._obstacles[owner - arms]
            return int(self._link_starts[arms]) + owner - arms, name, name
        arm, links = self.names[owner], self.models[self.model_of[owner]].links
        if local < len(links):
            return int(self._link_starts[owner]) + local, f"{arm}/{links[local]}", arm
        thing = self._held[arm][local - len(links)]
        return int(self._link_starts[arms]) + len(self._obstacles) + self._attachment_order[thing], thing, arm

    def _locate(self, arrangement: Arrangement, number: int) -> tuple[int, int]:
        """Owner of an element of the search, and which of the owner's elements it is."""
        place = int(np.searchsorted(arrangement.first_element, number, side="right")) - 1
        local, arms = number - int(arrangement.first_element[place]), len(self.names)
        return (int(arrangement.arms[place]), local) if place < arms else (arms + local, 0)

    def own_pairs_count(self, arrangement: Arrangement, element: int) -> bool:
        """Whether own pairs of an element's arm are to be decided, and not those of one in the same posture."""
        place = int(np.searchsorted(arrangement.first_element, element, side="right")) - 1
        return place < arrangement.moving or place in arrangement.twins

    def twins_of(self, arrangement: Arrangement, elements: tuple[int, int]) -> Iterator[tuple[int, int]]:
        """The same pair of elements of the other arms that stand still in the same posture as theirs."""
        places = [int(np.searchsorted(arrangement.first_element, e, side="right")) - 1 for e in elements]
        if places[0] != places[1]:
            return
        start = int(arrangement.first_element[places[0]])
        for twin in arrangement.twins.get(places[0], ()):
            first = int(arrangement.first_element[twin])
            yield first + elements[0] - start, first + elements[1] - start

    def owner_of(self, arrangement: Arrangement, number: int) -> int:
        """Number of the owner of an element of the search."""
        return self._locate(arrangement, number)[0]

    def padding_between(self, arrangement: Arrangement, a: int, b: int) -> float:
        """Distance to keep between two elements of the search [m]; `ALLOWED` where they may touch."""
        (one, i), (two, j) = sorted(self._locate(arrangement, number) for number in (a, b))
        return ALLOWED if one >= len(self.names) else float(self._paddings_between(one, two)[i, j])

    def concave_elements(self, arrangement: Arrangement) -> list[int]:
        """Numbers of the elements of which a shape is not convex."""
        if not any(model.has_concave.any() for model in self.models):
            return []
        rows = [self.models[i].has_concave for i in (*self.model_of[arrangement.arms].tolist(), -1)]
        found: list[int] = np.flatnonzero(np.concatenate(rows)).tolist()
        return found

    # ---- rules --------------------------------------------------------------------------------

    @cached_property
    def rules(self) -> dict[tuple[int, int], Array]:
        """The distances to keep between the elements of two owners [m] that rules are about, by their numbers."""
        found = {}
        for owners, both in rules_by_owners(self.scene).items():
            first, *rest = sorted(self._owner_numbers[name] for name in owners)
            one, two = first, rest[0] if rest else first
            if one >= len(self.names):
                continue  # Obstacles among themselves.
            found[one, two] = self._paddings(one, two, both)
        return found

    def _paddings(self, one: int, two: int, rules: list[frozenset[str]]) -> Array:
        first, second = self.elements(one), self.elements(two)
        model = self.models[self.model_of[one]]
        checked = np.ones((len(first.order), len(second.order)), dtype=np.uint8)
        if one == two:
            checked = model.own_checked
        elif two >= len(self.names):
            base = f"{first.owner}/{self.scene.arms[first.owner].robot.base}"
            checked[first.named(base)] = 0
        return block_paddings(self.scene, first, second, checked, rules)

    def _paddings_between(self, one: int, two: int) -> Array:
        found = self.rules.get((one, two))
        return self._paddings(one, two, []) if found is None else found

    def _check_half_spaces(self) -> None:
        """No two half-spaces are to be kept apart."""
        arms = len(self.names)
        owners = [i for i in range(arms) if self.models[self.model_of[i]].has_plane.any()]
        for i in owners:
            others = [*(j for j in owners if j >= i), *(arms + np.flatnonzero(self.models[-1].has_plane)).tolist()]
            for j in others:
                first, second = self._planes(i), self._planes(j)
                apart = self._paddings_between(i, j)[np.ix_(first, second)] >= 0.0
                if apart.any():
                    a, b = np.argwhere(apart)[0].tolist()
                    names = list(self.elements(i).index)[first[a]], list(self.elements(j).index)[second[b]]
                    raise InputError(f"{names[0]!r} and {names[1]!r} are both half-spaces, which cannot be kept apart")

    def _planes(self, owner: int) -> list[int]:
        """Elements of an owner that have a half-space for a shape."""
        if owner >= len(self.names):
            return [0]
        found: list[int] = np.flatnonzero(self.models[self.model_of[owner]].has_plane).tolist()
        return found

    # ---- the search ---------------------------------------------------------------------------

    def arranged(self, joint_names: tuple[str, ...]) -> Arrangement:
        """The scene with the arms first that these columns move.

        Args:
            joint_names: The columns, all joints of their arms.

        Raises:
            InputError: a half-space on a link that moves.
        """
        if self._arranged is None or self._arranged[0] != joint_names:
            self._arranged = joint_names, self._arrange(joint_names)
        return self._arranged[1]

    def _arrange(self, joint_names: tuple[str, ...]) -> Arrangement:
        scene = self.scene
        places = {name: i for i, name in enumerate(joint_names)}
        moving = list(dict.fromkeys(name.split("/", 1)[0] for name in joint_names))
        columns_of_arm = {
            name: [places[f"{name}/{joint}"] for joint in scene.arms[name].robot.joint_names] for name in moving
        }
        still = [name for name in self.names if name not in columns_of_arm]
        order = np.array([self._owner_numbers[name] for name in (*moving, *still)], dtype=np.int64)
        models = np.append(self.model_of[order], len(self.models) - 1)
        counts = np.array([model.counts for model in self.models])[models]
        first = np.concatenate([np.zeros((1, 5), np.int64), np.cumsum(counts, axis=0)])
        total = first[-1]
        arms = np.column_stack([models, first[:-1]])
        columns = [column for name in moving for column in columns_of_arm[name]]
        standing = len(joint_names) + np.arange(total[_COLUMNS] - len(columns))
        bases = np.array([scene.arms[name].base[:3] for name in (*moving, *still)]).reshape(-1, 3, 4)
        world = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
        bases = np.concatenate([bases[:, :, :3].reshape(-1, 9), bases[:, :, 3]], axis=1)
        obstacle_bodies = np.diff(self.models[-1].element_bodies)
        self._check_moving_planes(moving, order)
        twins = self._twins(order, len(moving))
        fields: dict[str, Any] = {
            "models": self._model_rows,
            "arms": np.ascontiguousarray(arms),
            "arm_columns": np.concatenate([np.array(columns, dtype=np.int64), standing]),
            "bases": np.concatenate([bases, world[None]]),
            "own_arms": np.array(list(twins), dtype=np.int64),
            "own_arm_count": len(twins),
            "moving_count": len(moving),
            "standing_count": len(still),
            "owner_count": len(order) + len(obstacle_bodies),
            "element_count": int(total[_ELEMENTS]),
            "joint_count": int(total[_JOINTS]),
            "padding": scene.padding,
            "most_padding": max((scene.padding, *scene.pair_padding.values())),
            "sweep_stride": 1 + max(model.depth for model in self.models),
        }
        fields |= self._rule_rows(order)
        postures = [scene.arms[name].q for name in still]
        return Arrangement(
            columns_of(scene.arms, joint_names),
            order,
            len(moving),
            columns_of_arm,
            fields,
            twins,
            first[:-1, _ELEMENTS],
            np.concatenate([counts[:-1, _BODIES], obstacle_bodies]),
            int(total[_LINKS]),
            int(total[_BODIES]),
            int(total[_ELEMENTS]),
            fields["most_padding"],
            np.concatenate([np.zeros(0), *postures]),
        )

    @cached_property
    def _model_rows(self) -> NDArray[np.uint8]:
        rows = [np.frombuffer(bytes(model.struct.value), np.uint8) for model in self.models]
        return np.array(rows).reshape(-1, SOURCES.item_size("RefereeModel"))

    def _check_moving_planes(self, moving: list[str], order: Table) -> None:
        for name, model in zip(moving, (self.models[self.model_of[i]] for i in order.tolist()), strict=False):
            bad = np.flatnonzero(model.has_plane & model.carried).tolist()
            alone = len(self.names) + len(self.scene.obstacles) == 1
            for i in bad:
                if alone and not model.own_checked[i].any():
                    continue  # There is nothing to keep it apart from.
                element = list(self.elements(self._owner_numbers[name]).index)[i]
                raise InputError(f"{element!r} moves and has a half-space for a shape; expected a bounded shape")

    def _twins(self, order: Table, moving: int) -> dict[int, list[int]]:
        """Arms that stand still, by what their own pairs depend on: model, posture and rules."""
        rules = {one: paddings.tobytes() for (one, two), paddings in self.rules.items() if one == two}
        found: dict[tuple[int, bytes, bytes], list[int]] = {}
        for place, arm in enumerate(order[moving:].tolist(), start=moving):
            key = int(self.model_of[arm]), self.scene.arms[self.names[arm]].q.tobytes(), rules.get(arm, b"")
            found.setdefault(key, []).append(place)
        return {first: others for first, *others in found.values()}

    def _rule_rows(self, order: Table) -> dict[str, Any]:
        """The rules in the order of the arms."""
        arms, count = len(order), len(order) + len(self.scene.obstacles)
        place = np.concatenate([np.argsort(order), np.arange(arms, count)]).tolist()
        starts: dict[tuple[tuple[int, ...], bytes], int] = {}
        rows, tables, size = [], [np.zeros(0)], 0
        for owners, table in self.rules.items():
            one, two = (place[owner] for owner in owners)
            paddings = np.ascontiguousarray(table if one <= two else table.T)
            content = paddings.shape, paddings.tobytes()
            if content not in starts:
                starts[content] = size
                tables.append(paddings.ravel())
                size += paddings.size
            rows.append((min(one, two) * count + max(one, two), starts[content]))
        return {
            "rules": np.array(sorted(rows), dtype=np.int64).reshape(-1, 2),
            "rule_count": len(rows),
            "paddings": np.concatenate(tables),
        }


def referee_scene(scene: Scene) -> RefereeScene:
    """The scene for the referee, kept with it.

    Raises:
        InputError: two half-spaces to keep apart, or a joint that follows none that has a value.
    """
    kept: RefereeScene | None = scene.kept.get("referee")
    if kept is None:
        kept = scene.kept["referee"] = RefereeScene(scene)
    return kept
