"""Small robots with contacts in closed form, and tools to move them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import fcl
import numpy as np
import pytest
from slow_certificate.certificate import Certificate
from slow_certificate.certificate_bodies import Bodies
from slow_certificate.scene_motion import SceneMotion

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.robot import Geometry, Joint, Link, Mimic
from rr1plan.testing.collision_checkers import fcl_geometry
from rr1plan.transforms import pose
from rr1plan.validation.collision_proof import CollisionProof, prove
from rr1plan.validation.compiled_search import ProofOptions
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import moving_scene

Shape = Any


def limits_of(n: int, **changes: float) -> rp.Limits:
    """Wide limits for n joints."""
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
        locked_joints={},
        disabled_collisions=frozenset(),
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
        locked_joints={"left_slide": 0.05},
        disabled_collisions=frozenset({frozenset({"left", "right"})}),
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
    neighbors = frozenset(frozenset({f"link{i}", f"link{i + 1}"}) for i in range(n))
    return rp.Robot(
        name="chain",
        links=tuple(links),
        joints=tuple(joints),
        joint_names=tuple(f"joint{i}" for i in range(n)),
        limits=limits_of(n),
        configurations={"home": np.zeros(n)},
        locked_joints={},
        disabled_collisions=neighbors,
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
    """A quintic polynomial from rest to rest."""
    q0, q1 = np.atleast_1d(start).astype(float), np.atleast_1d(goal).astype(float)
    c = np.zeros((1, 6, len(q0)))
    c[0, 0] = q0
    for k, factor in ((3, 10.0), (4, -15.0), (5, 6.0)):
        c[0, k] = factor * (q1 - q0) / seconds**k
    return rp.Trajectory(tuple(names), np.array([0.0, seconds]), c)


# ---- other opinions ------------------------------------------------------------------------

Pair = tuple[str, str]


class AllPairs:
    """Every pair of elements of a scene by Coal, one after the other, with no broad phase.

    Attributes:
        found: Results of all checked pairs of the scene.
        hits: Pairs that touch or are undecided.
        smallest: Smallest clearance with the surroundings and of one arm's own [m]; inf if there is no pair.
    """

    def __init__(self, scene: rp.Scene, move: rp.Trajectory) -> None:
        pairs = scene.checked_pairs
        motion = SceneMotion(scene.arms, move.joint_names, move.breaks, move.coefficients)
        self.found = found = Certificate(motion, Bodies(scene, motion, pairs), 2e-4, 400_000).run()
        hit = np.isfinite(found.first_contact) | found.undecided
        self.hits = [pair for pair, met in zip(pairs, hit, strict=True) if met]
        own = np.array([scene.owner(a) == scene.owner(b) for a, b in pairs], dtype=bool)
        self.smallest = [float(found.clearance[group].min(initial=np.inf)) for group in (~own, own)]


def search(scene: rp.Scene, move: rp.Trajectory, tolerance: float = 2e-4, clearance: bool = True) -> CollisionProof:
    """What the referee finds."""
    motion = TimedColumns(move.joint_names, move.breaks, move.coefficients)
    return prove(moving_scene(scene, move.joint_names), motion, ProofOptions(tolerance, 400_000, clearance))


class FclWorld:
    """All shapes of a scene in python-fcl, moved by the robot's own plain kinematics."""

    def __init__(self, scene: rp.Scene) -> None:
        self.scene = scene
        self.parts: dict[str, list[tuple[str, Array, Any]]] = {}
        for name in scene.element_names:
            if name in scene.obstacles:
                item = scene.obstacles[name]
                parts = [("", item.pose @ g.pose, g) for g in item.geometries]
            elif name in scene.attachments:
                held = scene.attachments[name]
                parts = [(f"{held.arm}/{held.link}", held.pose @ g.pose, g) for g in held.geometries]
            else:
                arm, link = name.split("/")
                parts = [(name, g.pose, g) for g in scene.arms[arm].robot.link(link).collisions]
            self.parts[name] = [(link, T, fcl.CollisionObject(fcl_geometry(g.shape))) for link, T, g in parts]

    def place(self, joint_names: tuple[str, ...], q: Array) -> None:
        value = dict(zip(joint_names, q, strict=True))
        configurations = {
            a: np.array([value.get(f"{a}/{j}", r) for j, r in zip(arm.robot.joint_names, arm.q, strict=True)])
            for a, arm in self.scene.arms.items()
        }
        poses = self.scene.link_poses(configurations) | {"": np.eye(4)}
        for parts in self.parts.values():
            for link, local, thing in parts:
                T = poses[link] @ local
                thing.setTransform(fcl.Transform(np.array(T[:3, :3]), np.array(T[:3, 3])))

    def touching(self) -> bool:
        return any(self.pair_touches(a, b) for a, b in self.scene.checked_pairs)

    def pair_touches(self, a: str, b: str) -> bool:
        return any(
            fcl.collide(x, y, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
            for _, _, x in self.parts[a]
            for _, _, y in self.parts[b]
        )

    def distance(self, own: bool) -> float:
        """Clearance to the surroundings, or between links of one arm; inf if there are no such pairs."""
        owner = self.scene.owner
        names = [(a, b) for a, b in self.scene.checked_pairs if (owner(a) == owner(b)) == own]
        pairs = [(x, y) for a, b in names for _, _, x in self.parts[a] for _, _, y in self.parts[b]]
        # For one order of the two, the distance may be a quarter of a millimeter too large.
        both = [pair for x, y in pairs for pair in ((x, y), (y, x))]
        return min((fcl.distance(x, y, fcl.DistanceRequest(), fcl.DistanceResult()) for x, y in both), default=np.inf)


@pytest.fixture
def all_pairs() -> Callable[..., AllPairs]:
    return AllPairs


@pytest.fixture
def fcl_world() -> Callable[..., FclWorld]:
    return FclWorld


@pytest.fixture
def proof_of() -> Callable[..., CollisionProof]:
    return search


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
