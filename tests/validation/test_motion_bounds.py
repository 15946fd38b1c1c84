"""Bounds of the deviation of bodies from their steady motion, against dense samples of plain kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from slow_certificate.solids import solid, support

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.robot import Geometry, Joint, Link, Mimic
from rr1plan.transforms import inverse, pose
from rr1plan.validation.compiled_search import ProofOptions, Search
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import moving_scene
from rr1plan.validation.referee_kernels import SOURCES, load_library

Make = Callable[..., Any]
ROUNDING = 1e-9
SAMPLES = 17
ORIGIN = SOURCES.classes["PlacedBody"].origin.offset // 8  # column of the placed bodies


class Stretch:
    """A polynomial motion of one arm within `half` of a time, in the tables of the search."""

    def __init__(self, robot: rp.Robot, coefficients: Array, at: float, half: float) -> None:
        self.coefficients, self.at, self.half = coefficients, at, half
        self._begin(robot, np.array([0.0, 1.0]), coefficients[None])
        self.native.rr1_probe_interval(self.search, 0, at, half)

    def _begin(self, robot: rp.Robot, breaks: Array, coefficients: Array) -> None:
        self.robot, self.scene = robot, rp.Scene().with_arm("arm", robot)
        names = self.scene.joint_names()
        moving = moving_scene(self.scene, names)
        self.model = moving.tables.model(0)
        search = Search(moving, TimedColumns(names, breaks, coefficients), ProofOptions(1e-3, 1))
        self.kept, self.search, self.native = search, search.struct, load_library()
        self.placed = search.table("placed", len(self.model.shapes))

    @property
    def movers(self) -> list[int]:
        """The bodies that a joint carries."""
        return [b for b in range(len(self.model.shapes)) if self.chain(b)]

    def chain(self, b: int) -> list[str]:
        """The joints that carry a body and move, from the base on."""
        joints = {joint.child: joint for joint in self.robot.joints}
        link, _ = self._geometries()[b]
        found: list[str] = []
        while link in joints:
            joint = joints[link]
            found, link = [joint.name, *found], joint.parent
        return found

    def bound(self, b: int, shared: int) -> float:
        """Bound of the search for the deviation from steady motion."""
        return float(self.native.rr1_probe_unsteadiness(self.search, b, shared))

    def reach(self, b: int, shared: int, time: float, d: Array) -> float:
        """Displacement of a body along d at its steady velocity, by the search."""
        numbers = [joint.name for joint in self.robot.joints]
        chain = [numbers.index(name) for name in self.chain(b)]
        before = chain[shared - 1] if shared else -1
        moved = self.native.rr1_probe_steady_reach(self.search, b, chain[-1], before, time, d)
        return float(d @ self.placed[b, ORIGIN : ORIGIN + 3]) + float(moved)

    def true_reach(self, b: int, shared: int, time: float, d: Array) -> float:
        """Its displacement by NumPy, in the frame that the first `shared` joints carry."""
        T = self._pose(b, time)
        if shared:
            frame = self._frame(b, shared)
            T = self._link(frame, 0.0) @ inverse(self._link(frame, time)) @ T
        body = solid(self.model.shapes[b])
        return float(d @ T[:3, 3]) + float(support(body, (T[:3, :3].T @ d)[None])[0])

    def _frame(self, b: int, shared: int) -> str:
        """The link that the last of the first `shared` joints moves."""
        return self.robot.joint(self.chain(b)[shared - 1]).child

    def _pose(self, b: int, time: float) -> Array:
        link, geometry = self._geometries()[b]
        return np.asarray(self._link(link, time) @ geometry.pose)

    def _geometries(self) -> list[tuple[str, Geometry]]:
        return [(link.name, g) for link in self.scene.arms["arm"].robot.links for g in link.collisions]

    def _link(self, name: str, time: float) -> Array:
        return np.asarray(self.scene.link_poses({"arm": self._positions(time)})[f"arm/{name}"])

    def _positions(self, time: float) -> Array:
        return np.asarray(np.power(self.at + time, np.arange(len(self.coefficients))) @ self.coefficients)


class Run(Stretch):
    """A motion of several pieces of one arm, in the tables of the search."""

    def __init__(self, robot: rp.Robot, breaks: Array, coefficients: Array) -> None:
        self.move, self.half = (breaks, coefficients), 0.5 * (breaks[-1] - breaks[0])
        self._begin(robot, breaks, coefficients)
        self.native.rr1_probe_pieces(self.search, 0, len(coefficients))

    def _positions(self, time: float) -> Array:
        breaks, coefficients = self.move
        at = breaks[0] + self.half + time
        piece = int(np.clip(np.searchsorted(breaks, at, side="right") - 1, 0, len(coefficients) - 1))
        return np.asarray(np.power(at - breaks[piece], np.arange(coefficients.shape[1])) @ coefficients[piece])


def error(stretch: Stretch, b: int, shared: int, directions: Array) -> float:
    """Largest deviation of a body along a direction from its steady motion [m]."""
    times = np.linspace(-stretch.half, stretch.half, SAMPLES)
    return max(
        abs(stretch.true_reach(b, shared, t, d) - stretch.reach(b, shared, t, d)) for t in times for d in directions
    )


def units(rng: np.random.Generator, count: int) -> Array:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


@pytest.mark.parametrize("seed", range(30))
def test_no_body_strays_farther_from_its_steady_motion_than_the_bound(seed: int, chain: Make) -> None:
    rng = np.random.default_rng(seed)
    robot = chain(rng, int(rng.integers(1, 5)))
    if seed % 3 == 0 and robot.nq > 1:
        last = replace(robot.joints[-1], mimic=Mimic(robot.joint_names[0], -1.5, 0.1))
        n = robot.nq - 1
        limits = rp.Limits(*(np.full(n, v) for v in (-10.0, 10.0, 1.0, 1.0, 1.0, 1.0)))
        changes = {"joint_names": robot.joint_names[:n], "limits": limits, "configurations": {"home": np.zeros(n)}}
        robot = replace(robot, joints=(*robot.joints[:-1], last), **changes)
    coefficients = rng.normal(size=(int(rng.integers(2, 6)), robot.nq))
    stretch = Stretch(robot, coefficients, rng.uniform(-0.5, 0.5), 10.0 ** rng.uniform(-2.0, 0.0))
    for b in stretch.movers:
        for shared in range(len(stretch.chain(b))):
            assert error(stretch, b, shared, units(rng, 6)) <= stretch.bound(b, shared) + ROUNDING


@pytest.mark.parametrize("jump", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(15))
def test_nor_over_several_pieces_even_where_they_do_not_meet(seed: int, jump: float, chain: Make) -> None:
    rng = np.random.default_rng(seed)
    robot = chain(rng, int(rng.integers(1, 4)))
    breaks = np.cumsum(rng.uniform(0.02, 0.3, int(rng.integers(3, 7))))
    coefficients = rng.normal(size=(len(breaks) - 1, int(rng.integers(1, 6)), robot.nq))
    for i, width in enumerate(np.diff(breaks)[:-1]):
        end = np.power(width, np.arange(coefficients.shape[1])) @ coefficients[i]
        coefficients[i + 1, 0] = end + jump * rng.normal(size=robot.nq)
    run = Run(robot, breaks, coefficients)
    for b in run.movers:
        for shared in range(len(run.chain(b))):
            assert error(run, b, shared, units(rng, 4)) <= run.bound(b, shared) + ROUNDING


# ---- where the bound is all but reached ----------------------------------------------------


def arm_of(*joints: tuple[str, Array, Array]) -> rp.Robot:
    """A chain of joints (kind, origin, axis) with a point at the origin of the last link."""
    n = len(joints)
    links = [Link(f"link{i}") for i in range(n)] + [Link(f"link{n}", collisions=(Geometry("p", rp.Sphere(1e-9)),))]
    made = [
        Joint(f"joint{i}", kind, f"link{i}", f"link{i + 1}", pose(origin), axis, -10.0, 10.0)
        for i, (kind, origin, axis) in enumerate(joints)
    ]
    wide = np.full(n, 10.0)
    return rp.Robot(
        name="point",
        links=tuple(links),
        joints=tuple(made),
        joint_names=tuple(joint.name for joint in made),
        limits=rp.Limits(-wide, wide, wide, wide, wide, wide),
        configurations={"home": np.zeros(n)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool=f"link{n}",
    )


X, Y, Z = np.eye(3)
# What each needs of the bound: joints, speeds, and the direction in which all that strays adds up.
TIGHT = {
    "one turn": ([("revolute", 0.0 * X, Z), ("revolute", X, Z)], [1.0, 0.0], X),
    "two turns about one axis": (
        [("revolute", 0.0 * X, Z), ("revolute", 0.0 * X, Z), ("revolute", X, Z)],
        [1.0, 1.0, 0.0],
        X,
    ),
    "two turns of a stretched arm": (
        [("revolute", 0.0 * X, Z), ("revolute", X, Z), ("revolute", X, Z)],
        [0.7, 1.0, 0.0],
        X,
    ),
    "three turns of a stretched arm": (
        [("revolute", 0.0 * X, Z), ("revolute", X, Z), ("revolute", X, Z), ("revolute", X, Z)],
        [0.5, 1.0, 0.8, 0.0],
        X,
    ),
    "a slide that is turned": ([("revolute", 0.0 * X, Z), ("prismatic", 0.0 * X, X)], [1.0, 2.0], Y),
    "a slide that two joints turn": (
        [("revolute", 0.0 * X, Z), ("revolute", 0.0 * X, Z), ("prismatic", 0.0 * X, X)],
        [1.0, 0.5, 2.0],
        Y,
    ),
}


@pytest.mark.parametrize("name", TIGHT)
def test_no_term_of_the_bound_can_be_spared(name: str) -> None:
    """A point that strays as far as the bound allows, to second order: with any part less, it would stray farther."""
    joints, speeds, d = TIGHT[name]
    stretch = Stretch(arm_of(*joints), np.array([np.zeros(len(speeds)), speeds]), 0.0, 1e-3)
    (b,) = stretch.movers
    strays, bound = error(stretch, b, 0, d[None]), stretch.bound(b, 0)
    assert strays <= bound + ROUNDING
    assert strays > 0.995 * bound - ROUNDING


def test_what_the_joints_do_beside_a_steady_speed_counts(slider: Make) -> None:
    stretch = Stretch(slider(rp.Sphere(0.1)), np.array([[0.2], [1.0], [3.0], [-2.0]]), 0.0, 0.1)
    (b,) = stretch.movers
    # The third power pulls the same way as the second before the middle: 3 * 0.1^2 + 2 * 0.1^3.
    assert error(stretch, b, 0, X[None]) == pytest.approx(stretch.bound(b, 0), abs=1e-12) == pytest.approx(0.032)


def test_joints_that_two_bodies_share_move_neither_against_the_other() -> None:
    joints = [("revolute", 0.0 * X, Z), ("revolute", X, Z), ("revolute", X, Z)]
    stretch = Stretch(arm_of(*joints), np.array([np.zeros(3), [1.0, 0.0, 0.0]]), 0.0, 0.3)
    (b,) = stretch.movers
    assert stretch.bound(b, 0) > 0.05
    assert stretch.bound(b, 1) == 0.0
    assert error(stretch, b, 1, np.eye(3)) <= ROUNDING
