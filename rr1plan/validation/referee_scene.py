"""A scene for the referee, independent of which arms move: models of its robots, names, and rules about contacts."""

from __future__ import annotations

from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.object_cache import kept_in
from rr1plan.scene import Scene
from rr1plan.validation.contact_paddings import Elements, block_paddings, rules_by_owners
from rr1plan.validation.referee_models import HeldThing, RefereeModel, obstacle_model, robot_model


class RefereeScene:
    """A scene for the referee, independent of which arms move.

    Attributes:
        scene: The scene.
        names, obstacles: Names of the arms and of the obstacles. Owners are numbered in this order.
        models: Models of the robots; the last one is that of all obstacles.
        model_of: The model of each arm.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.names, self.obstacles = list(scene.arms), list(scene.obstacles)
        self._held: dict[str, list[str]] = {}
        for name, thing in scene.attachments.items():
            self._held.setdefault(thing.arm, []).append(name)
        self.models: list[RefereeModel] = []
        known: dict[tuple[int, tuple[HeldThing, ...]], int] = {}
        self.model_of: list[int] = []
        for name, arm in scene.arms.items():
            held: tuple[HeldThing, ...] = ()
            if name in self._held:
                held = tuple(HeldThing.of(scene.attachments[thing]) for thing in self._held[name])
            key = id(arm.robot), held
            number = known.get(key)
            if number is None:
                number = known[key] = len(self.models)
                self.models.append(robot_model(arm.robot, held))
            self.model_of.append(number)
        self.models.append(obstacle_model(scene.obstacles.values()))
        if any(model.planes for model in self.models[:-1]):
            self._check_half_spaces()

    # ---- names --------------------------------------------------------------------------------

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Numbers of the owners by their names."""
        return {name: i for i, name in enumerate([*self.names, *self.obstacles])}

    @cached_property
    def _attachment_order(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.scene.attachments)}

    @cached_property
    def _link_starts(self) -> list[int]:
        """Number of elements before the links of each arm, before the obstacles and before the attached objects."""
        return [0, *accumulate(len(self.models[i].links) for i in self.model_of)]

    def elements(self, owner: int) -> Elements:
        """The elements of an owner: an arm by its number; higher numbers are obstacles."""
        arms = len(self.names)
        if owner >= arms:
            name = self.obstacles[owner - arms]
            return Elements(name, {name: 0})
        name, links = self.names[owner], self.model(owner).links
        names = [*(f"{name}/{link}" for link in links), *self._held.get(name, [])]
        return Elements(name, {element: i for i, element in enumerate(names)})

    def element(self, owner: int, number: int) -> tuple[int, str, str]:
        """Index among all elements of the scene, name and owner's name of an element of an owner."""
        arms = len(self.names)
        if owner >= arms:
            name = self.obstacles[owner - arms]
            return self._link_starts[arms] + owner - arms, name, name
        arm, links = self.names[owner], self.model(owner).links
        if number < len(links):
            return self._link_starts[owner] + number, f"{arm}/{links[number]}", arm
        thing = self._held[arm][number - len(links)]
        return self._link_starts[arms] + len(self.obstacles) + self._attachment_order[thing], thing, arm

    def model(self, arm: int) -> RefereeModel:
        """The model of an arm, by its number."""
        return self.models[self.model_of[arm]]

    # ---- rules --------------------------------------------------------------------------------

    @cached_property
    def rules(self) -> dict[tuple[int, int], Array]:
        """Distances to keep between the elements of two owners with rules [m], by the owners' numbers."""
        found: dict[tuple[int, int], Array] = {}
        if not (self.scene.allowed or self.scene.pair_padding):
            return found
        for owners, both in rules_by_owners(self.scene).items():
            first, *rest = sorted(self.numbers[name] for name in owners)
            one, two = first, rest[0] if rest else first
            if one >= len(self.names):
                continue  # Obstacles among themselves.
            found[one, two] = self._paddings(one, two, both)
        return found

    def _paddings(self, one: int, two: int, rules: list[frozenset[str]]) -> Array:
        first, second = self.elements(one), self.elements(two)
        model = self.model(one)
        checked = np.ones((len(first.index), len(second.index)), dtype=np.uint8)
        if one == two and model.own_checked is not None:
            checked = model.own_checked
        elif two >= len(self.names):
            base = f"{first.owner}/{self.scene.arms[first.owner].robot.base}"
            checked[first.named(base)] = 0
        return block_paddings(self.scene, first, second, checked, rules)

    def paddings_between(self, one: int, two: int) -> Array:
        """Distances to keep between the elements of two owners [m], `ALLOWED` where they may touch; one <= two."""
        found = self.rules.get((one, two))
        return self._paddings(one, two, []) if found is None else found

    def _check_half_spaces(self) -> None:
        """Reject pairs of half-spaces that must not touch: their distance cannot be proven."""
        arms = len(self.names)
        owners = [i for i in range(arms) if self.model(i).planes]
        for i in owners:
            others = [*(j for j in owners if j >= i), *(arms + k for k in self.models[-1].planes)]
            for j in others:
                first = self.model(i).planes
                second = self.model(j).planes if j < arms else (0,)
                checked = self.paddings_between(i, j)[np.ix_(first, second)] >= 0.0
                if checked.any():
                    a, b = np.argwhere(checked)[0].tolist()
                    names = list(self.elements(i).index)[first[a]], list(self.elements(j).index)[second[b]]
                    raise InputError(f"{names[0]!r} and {names[1]!r} are both half-spaces, which cannot be kept apart")

    @cached_property
    def model_rows(self) -> NDArray[np.uint8]:
        """The models for the kernels, a row of bytes each."""
        rows = bytearray().join([bytes(model.struct.value) for model in self.models])
        return np.frombuffer(rows, np.uint8).reshape(len(self.models), -1)


def referee_scene(scene: Scene) -> RefereeScene:
    """The scene for the referee, which the scene keeps.

    Raises:
        InputError: two half-spaces that must not touch, or a joint that follows no joint with a value.
    """
    return kept_in(scene.kept, "referee", lambda: RefereeScene(scene))
