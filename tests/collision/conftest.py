"""Small and unusual robots and scenes for the collision tests, built in code."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from rr1plan.robot import Geometry, Joint, Link, Mimic, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose


def _limits(n):
    return Limits(np.full(n, -3.2), np.full(n, 3.2), *(np.ones(n) for _ in range(4)))


def _pairs(*names):
    return frozenset(frozenset(p) for p in names)


def _wedge():
    points = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.12], [0.15, 0.08, 0.02]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Mesh(points, faces, convex=True)


def _planar():
    """Two capsules in a plane."""
    rod = Geometry("rod", Capsule(0.02, 0.4), pose([0.25, 0, 0], rpy=[0, np.pi / 2, 0]))
    links = (Link("base"), Link("upper", collisions=(rod,)), Link("lower", collisions=(rod,)))
    joints = (
        Joint("shoulder", "revolute", "base", "upper"),
        Joint("elbow", "revolute", "upper", "lower", pose([0.5, 0, 0])),
    )
    names = ("shoulder", "elbow")
    return Robot(
        "planar", links, joints, names, _limits(2), {"home": np.zeros(2)}, {}, _pairs(("upper", "lower")), "lower"
    )


def _odd():
    """Revolute, prismatic, continuous, mimic and locked joints, and every shape of a link."""
    links = (
        Link("base", collisions=(Geometry("b", Box((0.2, 0.2, 0.1)), pose([0, 0, 0.05])),)),
        Link("slide", collisions=(Geometry("s", Cylinder(0.06, 0.3), pose([0, 0, 0.25])),)),
        Link(
            "arm",
            collisions=(
                Geometry("a", Capsule(0.05, 0.3), pose([0.2, 0, 0], rpy=[0, np.pi / 2, 0])),
                Geometry("knob", Sphere(0.08), pose([0.1, 0.05, 0])),
            ),
        ),
        Link("wrist", collisions=(Geometry("w", _wedge(), pose([0.02, 0, 0], rpy=[0.3, 0.2, 0.1])),)),
        Link("left", collisions=(Geometry("l", Box((0.02, 0.02, 0.1)), pose([0, 0, 0.05])),)),
        Link("right", collisions=(Geometry("r", Box((0.02, 0.02, 0.1)), pose([0, 0, 0.05])),)),
        Link("flap", collisions=(Geometry("f", Box((0.1, 0.04, 0.01)), pose([0.05, 0, 0])),)),
    )
    y = np.array([0.0, 1.0, 0.0])
    tilted = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    joints = (
        Joint("lift", "prismatic", "base", "slide", pose([0, 0, 0.1]), lower=-1, upper=1),
        Joint("turn", "continuous", "slide", "arm", pose([0, 0, 0.45])),
        Joint("bend", "revolute", "arm", "wrist", pose([0.4, 0, 0], rpy=[0.1, 0.4, 0]), tilted),
        Joint("grip", "prismatic", "wrist", "left", pose([0.15, 0.03, 0]), y, lower=0, upper=0.05),
        Joint("grip2", "prismatic", "wrist", "right", pose([0.15, -0.03, 0]), y, mimic=Mimic("grip", -1.0)),
        Joint("fold", "revolute", "wrist", "flap", pose([0, 0.1, 0.1]), y, mimic=Mimic("bend", -0.5, 0.3)),
    )
    never = _pairs(
        *[("base", "slide"), ("slide", "arm"), ("arm", "wrist"), ("wrist", "left"), ("wrist", "right")],
        *[("wrist", "flap"), ("left", "right")],
    )
    names = ("lift", "turn", "bend")
    home = {"home": np.array([0.0, 0.3, 0.2])}
    return Robot("odd", links, joints, names, _limits(3), home, {"grip": 0.02}, never, "wrist")


def _six():
    """A six-joint arm of capsules, cylinders and boxes."""
    axes = {"z": [0.0, 0.0, 1.0], "y": [0.0, 1.0, 0.0], "x": [1.0, 0.0, 0.0]}
    plan = [("z", 0.15), ("y", 0.15), ("y", 0.3), ("z", 0.25), ("y", 0.1), ("x", 0.1)]
    links, joints = [Link("l0", collisions=(Geometry("g", Cylinder(0.08, 0.1), pose([0, 0, 0.05])),))], []
    shapes = [Capsule(0.05, 0.08), Capsule(0.05, 0.2), Cylinder(0.045, 0.24), Box((0.07, 0.08, 0.12))]
    shapes += [Sphere(0.05), Box((0.03, 0.1, 0.08))]
    heights = [0.06, 0.15, 0.12, 0.06, 0.04, 0.06]
    for i, ((axis, reach), shape, height) in enumerate(zip(plan, shapes, heights, strict=True)):
        links.append(Link(f"l{i + 1}", collisions=(Geometry("g", shape, pose([0, 0, height])),)))
        joints.append(Joint(f"j{i}", "revolute", f"l{i}", f"l{i + 1}", pose([0, 0, reach]), np.array(axes[axis])))
    never = _pairs(*[(f"l{i}", f"l{j}") for i in range(7) for j in range(i + 1, min(i + 3, 7))])
    names = tuple(j.name for j in joints)
    home = {"home": np.array([0.0, 0.4, 0.8, 0.0, 0.5, 0.0])}
    return Robot("six", tuple(links), tuple(joints), names, _limits(6), home, {}, never, "l6")


def _scara():
    """Two turning joints over a stroke that slides, then a turning wrist."""
    links = (
        Link("column", collisions=(Geometry("c", Cylinder(0.06, 0.4), pose([0, 0, 0.2])),)),
        Link("inner", collisions=(Geometry("i", Box((0.3, 0.08, 0.05)), pose([0.15, 0, 0])),)),
        Link("outer", collisions=(Geometry("o", Box((0.25, 0.07, 0.05)), pose([0.125, 0, 0.06])),)),
        Link("quill", collisions=(Geometry("q", Capsule(0.015, 0.3), pose([0, 0, 0])),)),
        Link("hand", collisions=(Geometry("h", Sphere(0.03), pose([0.02, 0, -0.18])),)),
    )
    joints = (
        Joint("first", "revolute", "column", "inner", pose([0, 0, 0.45])),
        Joint("second", "revolute", "inner", "outer", pose([0.3, 0, 0])),
        Joint("stroke", "prismatic", "outer", "quill", pose([0.25, 0, 0.06]), lower=-0.2, upper=0.1),
        Joint("roll", "revolute", "quill", "hand"),
    )
    limits = Limits(np.array([-2.5, -2.5, -0.2, -3.0]), np.array([2.5, 2.5, 0.1, 3.0]), *(np.ones(4) for _ in range(4)))
    never = _pairs(("column", "inner"), ("inner", "outer"), ("outer", "quill"), ("quill", "hand"), ("outer", "hand"))
    names = tuple(joint.name for joint in joints)
    return Robot("scara", links, joints, names, limits, {"home": np.zeros(4)}, {}, never, "hand")


@pytest.fixture(scope="session")
def planar():
    return _planar()


@pytest.fixture(scope="session")
def odd():
    return _odd()


@pytest.fixture(scope="session")
def six():
    return _six()


@pytest.fixture(scope="session")
def wedge():
    return _wedge()


@pytest.fixture(scope="session")
def cluttered(six):
    """The six-joint arm among obstacles of all kinds."""
    rng = np.random.default_rng(5)
    scene = Scene().with_arm("arm", six).with_obstacle("box", Box((0.3, 0.2, 0.5)), pose([0.6, 0, 0.2]))
    scene = scene.with_obstacle("ball", Sphere(0.12), [0.1, 0.55, 0.6])
    scene = scene.with_obstacle("post", Cylinder(0.05, 0.9), pose([-0.35, -0.35, 0.45], rpy=[0.1, 0.1, 0]))
    scene = scene.with_obstacle("bar", Capsule(0.03, 0.6), pose([0.0, -0.5, 0.7], rpy=[np.pi / 2, 0.5, 0]))
    return scene.with_obstacle("wedge", _wedge(), pose([-0.5, 0.3, 0.4], rpy=rng.normal(size=3)))


@pytest.fixture(scope="session")
def scara():
    return _scara()


@pytest.fixture(scope="session")
def foreign(foreign_robots):
    """Third-party robots with meshes."""
    files = {"panda": "panda_description/urdf/panda.urdf", "ur5": "ur_description/urdf/ur5_robot.urdf"}
    return {name: load_robot(foreign_robots / file) for name, file in files.items()}


# ---- every pair, by Coal -----------------------------------------------------------------------------


class EveryPair:
    """All pairs whose contact a scene does not allow, measured one by one with Coal at the poses of `Scene.link_poses`.

    No code of the checkers is used, and no pair is skipped. Meshes are assumed convex.

    Args:
        scene: The scene.
        arms: The arms that move (default: all).
    """

    def __init__(self, scene, arms=None):
        self.scene, self.arms = scene, scene.arm_names(arms)
        self.pairs = scene.checked_pairs
        made = {}
        self._parts = {}
        for name in scene.element_names:
            if name in scene.obstacles:
                link, at, geometries = None, scene.obstacles[name].pose, scene.obstacles[name].geometries
            elif name in scene.attachments:
                held = scene.attachments[name]
                link, at, geometries = f"{held.arm}/{held.link}", held.pose, held.geometries
            else:
                arm, own = name.split("/")
                link, at, geometries = name, np.eye(4), scene.arms[arm].robot.link(own).collisions
            parts = [
                (at @ g.pose @ T, solid)
                for g in geometries
                for T, solid in made.setdefault(id(g.shape), _coal_solids(g.shape))
            ]
            self._parts[name] = link, parts
        low, high = (np.clip(x, -3.0, 3.0) for x in (scene.limits(self.arms).lower, scene.limits(self.arms).upper))
        one, two, three = map(self._relative_poses, np.random.default_rng(0).uniform(low, high, (3, len(low))))
        #: Whether the elements of a pair move relative to each other.
        self.moves = (np.abs([two - one, three - one]) > 1e-9).any(axis=(0, 2, 3))
        owners = [(scene.owner(a), scene.owner(b)) for a, b in self.pairs]
        #: Whether a pair has an element of a moving arm.
        self.of_moving_arms = np.array([bool({*both} & {*self.arms}) for both in owners], bool)

    def padding(self, margin=0.0):
        """Distance to keep between each pair; the margin applies to pairs in relative motion."""
        return np.array([self.scene.padding_of(a, b) for a, b in self.pairs]) + margin * self.moves

    def distances(self, q):
        """Signed distance of each pair, negative if they overlap."""
        poses = self._poses(q)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = 1e-10
        there = {
            name: [(_transform(poses[name] @ T), solid) for T, solid in parts]
            for name, (_, parts) in self._parts.items()
        }
        found = np.full(len(self.pairs), np.inf)
        for i, (a, b) in enumerate(self.pairs):
            for A, one in there[a]:
                for B, two in there[b]:
                    result.clear()
                    found[i] = min(found[i], coal.distance(one, A, two, B, request, result))
        return found

    def _relative_poses(self, q):
        """Poses of the second elements of all pairs relative to the first ones, shape (n, 4, 4)."""
        poses = self._poses(q)
        placed = np.array([[poses[a], poses[b]] for a, b in self.pairs]).reshape(-1, 2, 4, 4)
        return np.linalg.solve(placed[:, 0], placed[:, 1])

    def _poses(self, q):
        poses = self.scene.link_poses(self.scene.split(np.asarray(q, float), self.arms))
        return {name: np.eye(4) if link is None else poses[link] for name, (link, _) in self._parts.items()}


def _transform(T):
    return coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy())


def _coal_solids(shape):
    """A shape as Coal solids with poses."""
    nowhere = np.eye(4)
    match shape:
        case Box(size):
            return [(nowhere, coal.Box(*size))]
        case Sphere(radius):
            return [(nowhere, coal.Sphere(radius))]
        case Cylinder(radius, length):
            return [(nowhere, coal.Cylinder(radius, length))]
        case Capsule(radius, length):
            return [(nowhere, coal.Capsule(radius, length))]
        case HalfSpace(normal, offset):
            return [(nowhere, coal.Halfspace(np.array(normal), offset))]
        case PointCloud(points, side):
            cells = {tuple(np.floor(point / side)) for point in points}
            return [(pose((np.array(cell) + 0.5) * side), coal.Box(side, side, side)) for cell in sorted(cells)]
    assert shape.convex
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in shape.vertices:
        points.append(point)
    for face in shape.faces:
        faces.append(coal.Triangle(*map(int, face)))
    return [(nowhere, coal.Convex(points, faces))]


@pytest.fixture(scope="session")
def every_pair():
    return EveryPair


# ---- scenes of many arms -----------------------------------------------------------------------------


def random_arms(rng, robots, spread):
    """Two to nine arms at random poses among obstacles of all kinds, with all kinds of rules; and the moving arms."""
    scene = Scene()
    for i in range(int(rng.integers(2, 10))):
        robot = robots[int(rng.integers(len(robots)))]
        turned = {"quaternion": rng.normal(size=4)} if rng.random() < 0.3 else {"rpy": [0, 0, rng.uniform(-3, 3)]}
        base = pose(rng.uniform(-spread, spread, 3) * [1.0, 1.0, 0.3], **turned)
        scene = scene.with_arm(f"arm{i}", robot, base, q=robot.home + rng.uniform(0, 0.2) * rng.normal(size=robot.nq))
    names = list(scene.arms)
    shapes = {
        "box": Box(tuple(rng.uniform(0.05, 0.4, 3))),
        "ground": HalfSpace((0.0, 0.1, 1.0), -0.3 * spread - 0.6),
        "cloud": PointCloud(rng.uniform(-0.1, 0.1, (6, 3)), 0.05),
        "mesh": convex_hull(rng.normal(size=(12, 3)) * 0.1),
    }
    for name, shape in shapes.items():
        if rng.random() < 0.8:
            at = pose() if name == "ground" else pose(rng.uniform(-spread, spread, 3), quaternion=rng.normal(size=4))
            scene = scene.with_obstacle(name, shape, at)
    for name in rng.permutation(names)[: int(rng.integers(0, 3))].tolist():
        scene = scene.with_obstacle(f"held by {name}", Box((0.06, 0.05, 0.04)), np.zeros(3))
        scene = scene.attach(f"held by {name}", name, pose=pose([0.0, 0.0, rng.uniform(0.0, 0.2)]))
    if rng.random() < 0.5:
        scene = scene.allow(names[0], names[1])
    if rng.random() < 0.5:
        scene = scene.with_padding(rng.uniform(0.0, 0.05))
    if rng.random() < 0.5:
        scene = scene.with_padding(rng.uniform(0.0, 0.4), *rng.permutation(names)[:2].tolist())
    moving = rng.permutation(names)[: int(rng.integers(1, len(names) + 1))].tolist()
    return scene, scene.arm_names(moving)


@pytest.fixture(scope="session")
def arms_at_random(odd, six, planar, scara, rr1):
    """Random scenes of many arms of these robots and others, each with its moving arms."""

    def make(seed, others=()):
        rng = np.random.default_rng(seed)
        spread = float(rng.choice([0.7, 1.5, 3.0]))
        return random_arms(rng, [*others] if others else [odd, six, planar, scara, rr1], spread)

    return make


def random_configurations(scene, arms, count, seed):
    """Configurations of some arms: some near those of the scene, others anywhere."""
    rng, limits, home = np.random.default_rng(seed), scene.limits(arms), scene.configuration(arms)
    near = home + 0.3 * rng.normal(size=(count, len(home)))
    far = rng.uniform(np.maximum(limits.lower, -3.0), np.minimum(limits.upper, 3.0), (count, len(home)))
    return np.where((rng.random(count) < 0.6)[:, None], near, far)


@pytest.fixture(scope="session")
def configurations():
    return random_configurations
