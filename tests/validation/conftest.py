"""Small robots whose contacts are known in closed form, and tools to move them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Geometry, Joint, Link, Mimic
from rr1plan.transforms import pose

Shape = Any


def limits_of(n: int, **changes: float) -> rp.Limits:
    """Wide limits of n joints."""
    wide = {"lower": -10.0, "upper": 10.0, "velocity": 1e9, "acceleration": np.inf, "jerk": np.inf, "effort": np.inf}
    return rp.Limits(**{name: np.full(n, value) for name, value in (wide | changes).items()})


def make_slider(shape: Shape, **changes: float) -> rp.Robot:
    """A shape on one prismatic joint along x."""
    joint = Joint("slide", "prismatic", "base", "carriage", axis=np.array([1.0, 0.0, 0.0]), lower=-10.0, upper=10.0)
    return rp.Robot(
        name="slider",
        links=(Link("base"), Link("carriage", collisions=(Geometry("body", shape),))),
        joints=(joint,),
        joint_names=("slide",),
        limits=limits_of(1, **changes),
        configurations={"home": np.zeros(1)},
        held={},
        never_collide=frozenset(),
        tool="carriage",
    )


def make_gripper(shape: Shape) -> rp.Robot:
    """A turning arm of 0.5 m with two fingers: one held, the other follows it the other way."""
    ez, ey = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    tip = pose([0.5, 0.0, 0.0])
    return rp.Robot(
        name="gripper",
        links=(Link("base"), Link("arm"), *(Link(n, collisions=(Geometry(n, shape),)) for n in ("left", "right"))),
        joints=(
            Joint("turn", "continuous", "base", "arm", axis=ez),
            Joint("left_slide", "prismatic", "arm", "left", tip, ey, lower=-0.3, upper=0.3),
            Joint("right_slide", "prismatic", "arm", "right", tip, ey, mimic=Mimic("left_slide", -1.0, -0.01)),
        ),
        joint_names=("turn",),
        limits=limits_of(1, lower=-np.inf, upper=np.inf),
        configurations={"home": np.zeros(1)},
        held={"left_slide": 0.05},
        never_collide=frozenset({frozenset({"left", "right"})}),
        tool="arm",
    )


def make_chain(rng: np.random.Generator, n: int = 3) -> rp.Robot:
    """A chain of n joints of random kinds, axes and shapes."""
    links, joints = [Link("link0")], []
    for i in range(n):
        kind = ("revolute", "revolute", "prismatic")[int(rng.integers(3))]
        axis = rng.normal(size=3)
        origin = pose(rng.uniform(-0.3, 0.3, 3), rpy=rng.uniform(-3.0, 3.0, 3))
        joint = Joint(f"joint{i}", kind, f"link{i}", f"link{i + 1}", origin, axis / np.linalg.norm(axis), -10.0, 10.0)
        shape = random_shape(rng)
        placed = Geometry("shape", shape, pose(rng.uniform(-0.1, 0.1, 3), rpy=rng.uniform(-3.0, 3.0, 3)))
        links.append(Link(f"link{i + 1}", collisions=(placed,)))
        joints.append(joint)
    neighbours = frozenset(frozenset({f"link{i}", f"link{i + 1}"}) for i in range(n))
    return rp.Robot(
        name="chain",
        links=tuple(links),
        joints=tuple(joints),
        joint_names=tuple(f"joint{i}" for i in range(n)),
        limits=limits_of(n),
        configurations={"home": np.zeros(n)},
        held={},
        never_collide=neighbours,
        tool=f"link{n}",
    )


def random_shape(rng: np.random.Generator) -> Shape:
    """A box, sphere, cylinder or capsule between 1 cm and 20 cm."""
    a, b, c = rng.uniform(0.01, 0.2, 3)
    return (rp.Box((a, b, c)), rp.Sphere(a / 2), rp.Cylinder(a / 2, b), rp.Capsule(a / 2, b))[int(rng.integers(4))]


def pieces(names: Sequence[str], breaks: Sequence[float], *columns: Sequence[Sequence[float]]) -> rp.Trajectory:
    """A trajectory from local coefficients, per column and piece, lowest power first."""
    degree = max(len(c) for column in columns for c in column)
    out = np.zeros((len(breaks) - 1, degree, len(columns)))
    for j, column in enumerate(columns):
        for i, c in enumerate(column):
            out[i, : len(c), j] = c
    return rp.Trajectory(tuple(names), np.array(breaks), out)


def glide(names: Sequence[str], start: Any, goal: Any, seconds: float = 1.0) -> rp.Trajectory:
    """The quintic from rest to rest."""
    q0, q1 = np.atleast_1d(start).astype(float), np.atleast_1d(goal).astype(float)
    c = np.zeros((1, 6, len(q0)))
    c[0, 0] = q0
    for k, factor in ((3, 10.0), (4, -15.0), (5, 6.0)):
        c[0, k] = factor * (q1 - q0) / seconds**k
    return rp.Trajectory(tuple(names), np.array([0.0, seconds]), c)


@pytest.fixture
def slider() -> Callable[..., rp.Robot]:
    return make_slider


@pytest.fixture
def gripper() -> Callable[..., rp.Robot]:
    return make_gripper


@pytest.fixture
def chain() -> Callable[..., rp.Robot]:
    return make_chain


@pytest.fixture
def shape() -> Callable[..., Shape]:
    return random_shape


@pytest.fixture
def trajectory() -> Callable[..., rp.Trajectory]:
    return pieces


@pytest.fixture
def quintic() -> Callable[..., rp.Trajectory]:
    return glide
