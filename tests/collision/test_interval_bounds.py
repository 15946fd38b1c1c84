"""Bounds by the kernels on an interval of a parabola, on random robots, against dense samples of plain kinematics.

Distances are Coal's. Nothing may be proven at a padding that exceeds the distance of a sample, so each bound is tested
at the limit of being wrong.
"""

from __future__ import annotations

import coal
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from rr1plan.collision import CollisionChecker
from rr1plan.collision.convex.bounding_spheres import cover
from rr1plan.collision.convex.convex_bodies import coal_geometry
from rr1plan.collision.edge_kernel import FREE, EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.collision.tables.exact_tables import exact_scratch, exact_struct
from rr1plan.kernels.planner_kernels import constants, load_library, zeroed
from rr1plan.robot import Geometry, Joint, Link, Mimic, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

LANES = constants()["LANES"]
ALL = 2**LANES - 1
# A sample closer than the padding by this much is not a rounding error [m].
CLEARLY = 2e-6
ROUNDING = 1e-9


# ---- random robots -------------------------------------------------------------------------


def turned(rng, size):
    return pose(rng.uniform(-size, size, 3), quaternion=rng.normal(size=4))


def solid(rng):
    a, b, c = rng.uniform(0.01, 0.2, 3)
    hull = convex_hull(rng.normal(size=(int(rng.integers(5, 30)), 3)) * [a / 2, b / 2, c / 2])
    return (Box((a, b, c)), Sphere(a / 2), Cylinder(a / 2, b), Capsule(a / 2, b), hull)[int(rng.integers(5))]


def ball(rng):
    return Sphere(rng.uniform(0.01, 0.1))


def random_robot(rng, shape):
    """Joints that turn or slide about any axis, in a chain or a tree; at times the last follows the first."""
    n = int(rng.integers(2, 6))
    links, joints = [Link("link0")], []
    for i in range(n):
        parent = i if rng.uniform() < 0.7 else int(rng.integers(i + 1))
        kind = "prismatic" if rng.uniform() < 0.3 else "revolute"
        axis = rng.normal(size=3) if rng.uniform() < 0.7 else np.eye(3)[rng.integers(3)]
        follows = Mimic("joint0", rng.uniform(-2.0, 2.0), 0.1) if i == n - 1 and rng.uniform() < 0.3 else None
        links.append(Link(f"link{i + 1}", collisions=(Geometry("shape", shape(rng), turned(rng, 0.15)),)))
        ends = f"link{parent}", f"link{i + 1}", turned(rng, 0.3), axis / np.linalg.norm(axis)
        joints.append(Joint(f"joint{i}", kind, *ends, -10.0, 10.0, mimic=follows))
    names = tuple(joint.name for joint in joints if joint.mimic is None)
    wide = np.full(len(names), 10.0)
    limits = Limits(-wide, *(wide,) * 5)
    return Robot(
        *("random", tuple(links), tuple(joints), names, limits, {"home": 0.0 * wide}, {}),
        frozenset(frozenset({joint.parent, joint.child}) for joint in joints),
        f"link{n}",
    )


class World:
    """A random robot among obstacles, a random stretch of a parabola or a line, and where all is at samples of it."""

    def __init__(self, seed, shape, samples=33):
        rng = self.rng = np.random.default_rng(seed)
        normal = rng.normal(size=3)
        scene = Scene().with_arm("arm", random_robot(rng, shape))
        things = [Box(tuple(rng.uniform(0.01, 0.3, 3))), Sphere(0.1), Cylinder(0.05, 0.3), Capsule(0.02, 0.4)]
        things += [HalfSpace(tuple(normal / np.linalg.norm(normal)), -0.5)]
        things += [] if shape is ball else [convex_hull(rng.normal(size=(12, 3)) * 0.1)]
        for i, thing in enumerate(things):
            scene = scene.with_obstacle(f"thing{i}", thing, turned(rng, 0.6))
        self.checker = CollisionChecker(scene)
        tables = build_edge_tables(self.checker.geometry, self.checker.fixed, self.checker.solid_padding, 1e-6)
        # A copy, so that any padding can be set.
        self.tables = tables._replace(padding=tables.padding.copy())
        self.kernel = EdgeKernel(self.tables, self.checker.exact_kernel, self.checker.nq)
        self.pairs = self.checker.solid_pairs.tolist()
        self.told_to_coal = {}
        step = rng.normal(size=self.checker.nq) * 10.0 ** rng.uniform(-2.0, 0.3)
        kinds = [0.0 * step, -step, *(rng.normal(size=step.size) * size * np.abs(step).max() for size in (0.3, 3.0))]
        bend = kinds[rng.integers(len(kinds))]
        self.curve = np.array([rng.uniform(-2.0, 2.0, self.checker.nq), step, bend])
        self.middle = rng.uniform(0.2, 0.8)
        self.half = rng.uniform(0.02, min(self.middle, 1.0 - self.middle))
        self.times = self.middle + self.half * np.linspace(-1.0, 1.0, samples)
        self.places = [self.place(self.at(t)) for t in self.times]

    def at(self, t):
        """The configuration at a time of the parabola."""
        return self.curve[0] + t * self.curve[1] + t**2 * self.curve[2]

    def place(self, q):
        """World pose of every solid, by numpy."""
        scene, out = self.checker.scene, []
        poses = scene.link_poses({"arm": q})
        for one in self.checker.solids:
            if one.element in scene.obstacles:
                out.append(scene.obstacles[one.element].pose)
            else:
                (geometry,) = scene.arms["arm"].robot.link(one.element.split("/")[1]).collisions
                out.append(poses[one.element] @ geometry.pose)
        return out

    def distance(self, a, b, places):
        request = coal.DistanceRequest()
        request.gjk_tolerance, request.enable_signed_distance = 1e-10, True
        things = []
        for i in (a, b):
            if i not in self.told_to_coal:
                self.told_to_coal[i] = coal_geometry(self.checker.solids[i].shape)
            things += [self.told_to_coal[i], coal.Transform3s(places[i][:3, :3].copy(), places[i][:3, 3].copy())]
        return coal.distance(*things, request, coal.DistanceResult())

    def distances(self, pair):
        """Coal's distance of a pair of solids at all samples."""
        return np.array([self.distance(*self.pairs[pair], places) for places in self.places])

    def take_interval(self):
        """Place everything in the kernel's memory at the middle of the interval; place, travel and speed of spheres."""
        spheres, lanes = zeroed("SphereProbe", len(self.tables.arm.spheres)), np.ones(LANES)
        load_library().rr1_place_spheres(
            *self.kernel.context, self.curve, self.middle * lanes, self.half * lanes, spheres
        )
        rows = spheres.view(np.float64).reshape(len(spheres), 7, LANES)[:, :, 0]
        return rows[:, :3], rows[:, 3], rows[:, 4:]

    def bounds(self):
        """Bounds of joints' motions, (j, 5), and of groups' speeds and accelerations, on the last interval."""
        chains = self.tables.arm.groups[:, 5] - self.tables.arm.groups[:, 4]
        motions, shape = np.zeros((len(self.tables.arm.joints), 5)), (len(chains), int(chains.max()) + 1)
        speeds, accelerations = np.zeros(shape), np.zeros(shape)
        load_library().rr1_copy_bounds(*self.kernel.context, motions, speeds, accelerations)
        return motions, speeds, accelerations

    def group(self, body):
        """The group of a body."""
        return int(self.tables.arm.bodies[body, 3])


WORLDS = settings(deadline=None, max_examples=15)
SEEDS = st.integers(0, 2**32)


# ---- how spheres move ----------------------------------------------------------------------


def centers_of(world, body, places):
    """Centers of a body's spheres, the ball around all first, by numpy."""
    made, T = cover(world.checker.solids[body].shape), places[body]
    return np.vstack([made.ball[None, :3], made.centers]) @ T[:3, :3].T + T[:3, 3]


def moving(world):
    """Index in the kernel, index of the solid, first and last sphere of all that moves."""
    carried = [i for i, one in enumerate(world.checker.solids) if one.element not in world.checker.scene.obstacles]
    return [(k, i, *world.tables.arm.bodies[k, 1:3].tolist()) for k, i in enumerate(carried)]


@WORLDS
@given(SEEDS)
def test_no_joint_is_farther_or_faster_than_its_bound(seed):
    world = World(seed, ball)
    world.take_interval()
    columns, gains, motions = (
        world.tables.arm.joints[1:, 2],
        world.tables.arm.joint_values[1:, 12],
        world.bounds()[0][1:],
    )
    for t in np.linspace(0.0, 1.0, 33):
        rate = world.curve[1] + 2.0 * t * world.curve[2]
        assert (np.abs(gains * world.at(t)[columns]) <= motions[:, 4] + ROUNDING).all()
        assert (np.abs(gains * rate[columns]) <= motions[:, 3] + ROUNDING).all()


@WORLDS
@given(SEEDS)
def test_no_sphere_gets_farther_along_any_direction_than_its_bound(seed):
    world = World(seed, solid)
    centers, travels, velocities = world.take_interval()
    _, speeds, accelerations = world.bounds()
    h = world.half
    directions = world.rng.normal(size=(12, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for k, i, first, last in moving(world):
        g, its = world.group(k), slice(first, last)
        lost = 0.5 * h * h * accelerations[g, 0]
        along = np.abs(velocities[its] @ directions.T) * h + lost
        for places in world.places:
            moved = centers_of(world, i, places) - centers[its]
            assert (np.abs(moved @ directions.T) <= along + ROUNDING).all()
            size = np.linalg.norm(moved, axis=1)
            assert (size <= travels[its] + ROUNDING).all()
            assert (size <= h * speeds[g, 0] + ROUNDING).all()


@WORLDS
@given(SEEDS)
def test_no_two_spheres_come_nearer_than_their_bound(seed):
    world = World(seed, solid)
    centers, _, velocities = world.take_interval()
    _, speeds, accelerations = world.bounds()
    h = world.half
    known = {k: (i, first) for k, i, first, _ in moving(world)}
    for a, b, shared, *_ in world.tables.pairs.body_pairs.tolist():
        (one, at), (other, to) = known[a], known[b]
        apart, g, other_g = centers[at] - centers[to], world.group(a), world.group(b)
        gap = np.linalg.norm(apart)
        speed = abs(apart @ (velocities[at] - velocities[to])) / max(gap, 1e-12)
        lost = 0.5 * h * h * (accelerations[g, shared] + accelerations[other_g, shared])
        far = h * (speeds[g, shared] + speeds[other_g, shared])
        for places in world.places:
            there = np.linalg.norm(centers_of(world, one, places)[0] - centers_of(world, other, places)[0])
            assert there >= gap - min(speed * h + lost, far) - ROUNDING


# ---- what is proven of an interval ---------------------------------------------------------


def claims(world):
    """Each pair for the kernel: body, obstacle or other body, row of `body_pairs`, pair, lanes, spheres, stuck."""
    tables = world.tables
    for b, o in np.argwhere(tables.pairs.pair_of >= 0).tolist():
        yield [b, o, -1, int(tables.pairs.pair_of[b, o]), ALL, *[int(tables.arm.bodies[b, 1])] * 2, 0]
    for m, (a, b, _, pair, *_) in enumerate(tables.pairs.body_pairs.tolist()):
        yield [a, b, m, pair, ALL, int(tables.arm.bodies[a, 1]), int(tables.arm.bodies[b, 1]), 0]


def by_directions(world, claim, padding):
    """Whether a direction proves an interval at a padding."""
    found = np.zeros(3, np.uint64)
    world.tables.padding[claim[3]] = padding
    load_library().rr1_separate(*world.kernel.context, np.array([claim]), world.half, found)
    return not found[[0, 2]].any()


def by_spheres(world, claim, padding):
    """Whether spheres prove an interval at a padding."""
    found = np.zeros(2, np.uint64)
    world.tables.padding[claim[3]] = padding
    load_library().rr1_test_spheres(*world.kernel.context, np.array([claim]), world.half, found)
    return not found.any()


@WORLDS
@given(SEEDS, st.sampled_from([by_directions, by_spheres]), st.sampled_from([solid, ball]))
def test_no_interval_is_proven_at_a_padding_that_a_sample_undercuts(seed, prove, shape):
    world = World(seed, shape)
    world.take_interval()
    for claim in claims(world):
        least = float(world.distances(claim[3]).min())
        assert not prove(world, claim, max(least, 0.0) + CLEARLY)


@pytest.mark.parametrize(("prove", "shape"), [(by_directions, solid), (by_directions, ball), (by_spheres, ball)])
def test_a_short_interval_is_proven_up_to_little_less_than_its_least_distance(prove, shape):
    """So the bounds above are tight, and a slightly wrong bound is detected."""
    asked = proven = 0
    for seed in range(15):
        world = World(seed, shape)
        world.half = 1e-5
        world.take_interval()
        for claim in claims(world):
            places = world.place(world.at(world.middle))
            distance = world.distance(*world.pairs[claim[3]], places)
            if distance > 1e-3:
                asked += 1
                proven += prove(world, claim, 0.9 * distance - 1e-3 * np.abs(world.curve[1:]).sum())
    assert proven > 0.97 * asked > 100


# ---- the exact kernel ----------------------------------------------------------------------


@WORLDS
@given(SEEDS)
def test_no_distance_changes_more_than_the_travel_of_both_bodies(seed):
    world = World(seed, solid)
    tables, nq = world.checker.tables, world.checker.nq
    bodies, travel = tables.bodies, np.zeros((len(tables.bodies), len(tables.joints) + 1))
    q = world.at(world.middle)
    reach = np.abs([world.at(t) - q for t in world.times]).max(axis=0)
    load_library().rr1_bound_travel(exact_struct(tables, nq), exact_scratch(tables, nq), q, reach, travel)
    middle = world.place(q)
    for pair, (a, b, shared) in enumerate(tables.pairs.tolist()):
        now, found = world.distance(*world.pairs[pair], middle), world.distances(pair)
        moved = sum(travel[body, shared] for body in (a, b) if bodies[body, 5] > bodies[body, 4])
        # Coal's depths may jump; its distances may be too large by some 1e-5 m.
        assert now <= moved or (found >= now - moved - 2e-5).all()


# ---- whole edges ---------------------------------------------------------------------------


@settings(deadline=None, max_examples=12)
@given(SEEDS)
@example(4657)  # the separating direction is along the axis of a cylinder
def test_padding_turns_an_edge_from_free_to_refused_at_its_least_distance(seed):
    world = World(seed, solid, samples=2)
    scene, steps = world.checker.scene, 80
    places = [world.place(world.at(t)) for t in np.linspace(0.0, 1.0, steps)]
    found = np.array([[world.distance(a, b, at) for a, b in world.pairs] for at in places])
    least = float(found.min(initial=np.inf))
    assume(np.isfinite(least))
    if least <= 0.0:
        assert world.kernel.certify_parabola(world.curve, 1.0)[0] != FREE
        return
    beyond = CollisionChecker(scene.with_padding(least + CLEARLY))
    assert not beyond.polynomial_is_free(world.curve, 1.0)
    # From a sample to the middle between two, distances change by about half of this at most.
    step = float(np.abs(np.diff(found, axis=0)).max())
    below = CollisionChecker(scene.with_padding(max(0.0, least - step - CLEARLY)))
    assert below.polynomial_is_free(world.curve, 1.0) or least <= step + 3e-6
