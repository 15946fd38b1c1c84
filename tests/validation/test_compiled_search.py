"""The compiled search of the referee against Coal, against the slow certificate, and against dense samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from slow_certificate.coal_distance import CoalDistance
from slow_certificate.solids import Solid, solid, support

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.robot import Geometry, Mimic
from rr1plan.scene import Obstacle
from rr1plan.transforms import pose
from rr1plan.validation.collision_proof import CollisionProof
from rr1plan.validation.referee_kernels import RefereeStruct, load_library
from rr1plan.validation.referee_models import RefereeModel, obstacle_model

Make = Callable[..., Any]
# Largest overestimate of Coal's distance of two convex shapes [m].
COAL = 2e-5
ROUNDING = 1e-9


# ---- two bodies ----------------------------------------------------------------------------


def one_of_each(rng: np.random.Generator) -> list[Any]:
    """A ball, a box, a cylinder, a capsule and a hull, between a needle and a plate."""
    a, b, c = 10.0 ** rng.uniform(-3.0, -0.3, 3)
    corners = rng.normal(size=(int(rng.integers(4, 40)), 3)) * 10.0 ** rng.uniform(-2.0, -0.5, 3)
    hull = rp.Mesh(corners, ConvexHull(corners).simplices, convex=True)
    return [rp.Sphere(a), rp.Box((a, b, c)), rp.Cylinder(b, c), rp.Capsule(c, a), hull]


class Pairs:
    """Bodies in the tables of the search at arbitrary poses, and Coal's results for them."""

    def __init__(self, model: RefereeModel) -> None:
        self.model = model
        self.solids = [solid(shape) for shape in model.shapes]
        self.meter = CoalDistance()
        self.state = RefereeStruct("GjkState")

    def bounds(self, a: int, Ta: Array, b: int, Tb: Array, base: float = 1e300) -> tuple[float, float]:
        """Upper and lower bound of the distance of two bodies, continuing from the previous search."""
        placed = np.zeros((len(self.solids), 15))
        for body, T in ((a, Ta), (b, Tb)):
            middle = T[:3, :3] @ self.solids[body].center + T[:3, 3]
            placed[body] = np.concatenate([T[:3, :3].ravel(), T[:3, 3], middle])
        off = float(self.model.bodies.part("sizes")[[a, b], 3].sum())
        bounds = np.zeros(2)
        load_library().rr1_probe_separation(
            self.model.bodies, placed, a, b, self.state, min(base + off, 1e300), 1e300, bounds
        )
        upper, lower = bounds.tolist()
        return upper - off, lower - off

    def measure(self, a: int, Ta: Array, b: int, Tb: Array) -> tuple[float, Array]:
        """Coal's distance, and its normal."""
        placed = [coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3])) for T in (Ta, Tb)]
        distance, normal = self.meter.convex(self.solids[a], placed[0], self.solids[b], placed[1])
        return distance, normal / np.linalg.norm(normal)

    def coal(self, a: int, Ta: Array, b: int, Tb: Array) -> tuple[float, float]:
        """Coal's distance, and the gap along Coal's normal: no distance is less."""
        x, y = self.solids[a], self.solids[b]
        distance, normal = self.measure(a, Ta, b, Tb)
        return distance, float(normal @ (Tb[:3, 3] - Ta[:3, 3])) - reach(x, Ta, normal) - reach(y, Tb, -normal)


def reach(body: Solid, T: Array, direction: Array) -> float:
    return float(support(body, (T[:3, :3].T @ direction)[None])[0])


def random_pose(rng: np.random.Generator, size: float) -> Array:
    return np.asarray(pose(size * rng.normal(size=3), rpy=rng.uniform(-3.1, 3.1, 3)))


@pytest.fixture
def bodies() -> Callable[[np.random.Generator], Pairs]:
    """Two of each kind of convex shape."""

    def make(rng: np.random.Generator) -> Pairs:
        shapes = one_of_each(rng) + one_of_each(rng)
        return Pairs(obstacle_model(Obstacle((Geometry("part", shape),)) for shape in shapes))

    return make


@pytest.mark.parametrize("seed", range(12))
def test_the_two_bounds_hold_coals_distance_between_them(
    seed: int, bodies: Callable[[np.random.Generator], Pairs]
) -> None:
    rng = np.random.default_rng(seed)
    pairs, size = bodies(rng), (0.1, 0.2, 0.4)[seed % 3]
    apart = 0
    for a in range(10):
        for b in range(10):
            if a == b:
                continue
            Ta, Tb = random_pose(rng, size), random_pose(rng, size)
            distance, gap = pairs.coal(a, Ta, b, Tb)
            pairs.state.set(count=0)
            for base in (0.0, 1e300):
                upper, lower = pairs.bounds(a, Ta, b, Tb, base)
                assert lower <= distance + ROUNDING
                assert upper >= max(gap, distance - COAL) - ROUNDING or distance < 0.0
                assert upper >= lower - ROUNDING
                if distance > 1e-6:
                    assert lower > 0.0, "a clear gap must be found"
                    assert upper - lower <= (0.25 * upper if base == 0.0 else 1e-6) + ROUNDING
            apart += distance > 0.0
    assert apart >= 30


def test_a_search_that_goes_on_from_the_last_one_is_as_good(
    bodies: Callable[[np.random.Generator], Pairs],
) -> None:
    """Points kept from earlier poses of the bodies may be poor; they must not invalidate the bounds."""
    rng = np.random.default_rng(100)
    pairs = bodies(rng)
    for _ in range(60):
        a, b = rng.choice(10, 2, replace=False).tolist()
        Ta, Tb = random_pose(rng, 0.3), random_pose(rng, 0.3)
        pairs.state.set(count=0)
        for _ in range(6):
            step = 10.0 ** rng.uniform(-6.0, 0.5)
            Tb = Tb @ pose(step * rng.normal(size=3), rpy=step * rng.normal(size=3))
            distance, gap = pairs.coal(a, Ta, b, Tb)
            upper, lower = pairs.bounds(a, Ta, b, Tb)
            assert lower <= distance + ROUNDING
            assert distance < 0.0 or upper >= gap - ROUNDING
            assert distance < 1e-6 or upper - lower <= 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_bodies_that_all_but_touch_are_told_from_touching_ones(seed: int) -> None:
    """Hulls with few and with many corners, also with flat sides, where simplices are thin and differences cancel."""
    rng = np.random.default_rng(seed)
    shapes: list[Any] = [hull(rng, count, flat) for count in (4, 6, 8, 30, 200) for flat in (False, True)]
    shapes += [rp.Box(tuple(10.0 ** rng.uniform(-2.0, 0.0, 3))) for _ in range(3)]
    pairs = Pairs(obstacle_model(Obstacle((Geometry("part", shape),)) for shape in shapes))
    compared = 0
    for _ in range(400):
        a, b = rng.choice(len(shapes), 2, replace=False).tolist()
        Ta, Tb = random_pose(rng, 0.2), random_pose(rng, 0.2).copy()
        if rng.random() < 0.4:  # sides and edges that are parallel
            Ta, Tb[:3, :3] = pose(np.round(Ta[:3, 3], 2)), pose(rpy=rng.integers(-2, 3, 3) * np.pi / 2)[:3, :3]
        distance, normal = pairs.measure(a, Ta, b, Tb)
        Tb[:3, 3] += (10.0 ** rng.uniform(-7.0, -2.0) - distance) * normal
        distance, gap = pairs.coal(a, Ta, b, Tb)
        if not gap > 0.0:
            continue  # Coal has no proof.
        pairs.state.set(count=0)
        for _ in range(3):
            upper, lower = pairs.bounds(a, Ta, b, Tb)
            assert gap - ROUNDING <= upper <= distance + ROUNDING
            assert lower >= upper - 2e-9
            step = 10.0 ** rng.uniform(-6.0, -1.0)
            pairs.bounds(a, Ta, b, Tb @ pose(0.1 * step * rng.normal(size=3), rpy=step * rng.normal(size=3)))
        compared += 1
    assert compared >= 300


def hull(rng: np.random.Generator, count: int, flat: bool) -> rp.Mesh:
    """Random corners, or a prism."""
    corners = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-2.0, -0.5, 3)
    if flat:
        turn = np.linspace(0.0, 2.0 * np.pi, max(3, count // 2), endpoint=False)
        ring, height = np.stack([np.cos(turn), np.sin(turn)], axis=1), 10.0 ** rng.uniform(-1.5, 0.5)
        corners = 0.1 * np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-height, height)])
    return rp.Mesh(corners, ConvexHull(corners).simplices, convex=True)


def test_bodies_one_inside_the_other_touch(bodies: Callable[[np.random.Generator], Pairs]) -> None:
    rng = np.random.default_rng(3)
    pairs = bodies(rng)
    for a in range(10):
        for b in range(10):
            if a == b:
                continue
            # The middles of both lie at the same place, up to a thousandth of the smaller one.
            Ta, Tb = random_pose(rng, 1.0), random_pose(rng, 1.0).copy()
            inside = 1e-3 * min(pairs.solids[a].half.min(), pairs.solids[b].half.min())
            middle_a = Ta[:3, :3] @ inner_point(pairs.solids[a]) + Ta[:3, 3]
            Tb[:3, 3] = middle_a - Tb[:3, :3] @ inner_point(pairs.solids[b]) + inside * rng.uniform(-0.5, 0.5, 3)
            pairs.state.set(count=0)
            assert pairs.bounds(a, Ta, b, Tb)[1] < 0.0


def inner_point(body: Solid) -> Array:
    return np.asarray(body.points.mean(axis=0) if len(body.points) else body.center)


# ---- whole motions -------------------------------------------------------------------------


def geared(robot: rp.Robot) -> rp.Robot:
    """The last joint mimics the first in the opposite direction, and faster."""
    joints = (*robot.joints[:-1], replace(robot.joints[-1], mimic=Mimic(robot.joint_names[0], -1.5, 0.1)))
    n = len(robot.joint_names) - 1
    limits = rp.Limits(*(getattr(robot.limits, f.name)[:n] for f in fields(rp.Limits)))
    names, home = robot.joint_names[:n], {"home": np.zeros(n)}
    return replace(robot, joints=joints, joint_names=names, limits=limits, configurations=home)


def sliding(rng: np.random.Generator, chain: Make) -> rp.Robot:
    """A random arm with at least one prismatic joint and one that turns."""
    while True:
        robot: rp.Robot = chain(rng, 4)
        if len({joint.kind for joint in robot.joints}) == 2:
            return robot


def around(scene: rp.Scene, rng: np.random.Generator, shape: Make, count: int, flat: bool = False) -> rp.Scene:
    """Random obstacles at 0.3 to 1.2 m from the origin."""
    for k in range(count):
        at = rng.normal(size=3) * np.array([1.0, 1.0, 0.0 if flat else 1.0])
        place = pose(at / np.linalg.norm(at) * rng.uniform(0.3, 1.2), rpy=rng.normal(size=3))
        scene = scene.with_obstacle(f"thing{k}", shape(rng), place)
    return scene


def scene_of(kind: str, rng: np.random.Generator, chain: Make, shape: Make) -> rp.Scene:
    if kind in rp.scene_names():
        return rp.load_scene(kind)
    if kind == "planar2r":
        return around(rp.Scene().with_arm("arm", rp.load_robot("planar2r")), rng, shape, 3, flat=True)
    robot = sliding(rng, chain)
    scene = around(rp.Scene().with_arm("arm", geared(robot) if kind == "geared" else robot), rng, shape, 3)
    if kind == "two arms":
        return scene.with_arm("other", chain(rng, 3), pose(rng.normal(size=3), rpy=rng.normal(size=3)))
    if kind == "held":
        tool = scene.link_poses()[f"arm/{scene.arms['arm'].robot.tool}"]
        held = scene.with_obstacle("stick", rp.Capsule(0.01, 0.3), tool @ random_pose(rng, 0.1)).attach("stick")
        return held.allow("stick", f"arm/{scene.arms['arm'].robot.tool}")
    floor = rp.HalfSpace(tuple((normal := rng.normal(size=3)) / np.linalg.norm(normal)), -0.6)
    return scene.with_obstacle("floor", floor) if kind == "half-space" else scene


def wander(scene: rp.Scene, rng: np.random.Generator, reach: float) -> rp.Trajectory:
    """Three cubics, one after the other."""
    home = scene.configuration()
    widths = 10.0 ** rng.uniform(-2.0, 0.5, 3)
    c = reach * rng.normal(size=(3, 4, len(home))) * np.array([1.0, 0.6, 0.4, 0.3])[None, :, None]
    c[0, 0] = home
    for i in (1, 2):
        c[i, 0] = c[i - 1].sum(axis=0)
    scale = widths[:, None] ** np.arange(4)
    return rp.Trajectory(scene.joint_names(), np.concatenate([[0.0], np.cumsum(widths)]), c / scale[:, :, None])


def hits(found: CollisionProof) -> list[tuple[str, str]]:
    return [contact.pair for contact in found.contacts]


KINDS = {
    "planar2r": 0.5,
    "planar2r_path": 0.3,
    "rr1_table": 1.0,
    "rr1_pair": 0.6,
    "sliding": 0.25,
    "geared": 0.25,
    "two arms": 0.25,
    "held": 0.25,
    "half-space": 0.25,
}
SEEDS = 12


@pytest.mark.parametrize("kind", KINDS)
def test_the_search_and_the_slow_certificate_say_the_same_and_samples_do_not_object(
    kind: str, chain: Make, shape: Make, proof_of: Make, all_pairs: Make
) -> None:
    verdicts = []
    count = SEEDS // 2 if kind.startswith("rr1") else SEEDS
    for seed in range(count):
        rng = np.random.default_rng(seed)
        scene = scene_of(kind, rng, chain, shape)
        move = wander(scene, rng, KINDS[kind] * (0.1, 0.5, 1.0)[seed % 3])
        fast, sure = proof_of(scene, move), all_pairs(scene, move)
        assert hits(fast) == sure.hits, seed
        assert hits(proof_of(scene, move, clearance=False)) == hits(fast), seed
        verdicts.append(bool(fast.contacts))
        if not verdicts[-1]:
            the_smallest_clearances_agree(scene, fast, sure)
        no_sample_objects(scene, move, fast)
    assert 0 < sum(verdicts) < count


def own_pairs(scene: rp.Scene) -> Array:
    """Whether one arm owns both elements of each checked pair."""
    return np.array([scene.owner(a) == scene.owner(b) for a, b in scene.checked_pairs])


def the_smallest_clearances_agree(scene: rp.Scene, fast: CollisionProof, sure: Any) -> None:
    """Pairs with the surroundings, and pairs within one arm."""
    own = own_pairs(scene)
    for group, members in enumerate((~own, own)):
        nearest = fast.nearest[group]
        if not members.any():
            assert nearest is None
            continue
        assert nearest is not None
        assert nearest.clearance == pytest.approx(sure.smallest[group], abs=2e-4 + COAL)
        assert nearest.pair in [pair for pair, member in zip(scene.checked_pairs, members, strict=True) if member]
        assert 0.0 < fast.proven[group] <= nearest.clearance
        assert fast.proven[group] >= nearest.clearance - 2e-4 - ROUNDING


def no_sample_objects(scene: rp.Scene, move: rp.Trajectory, found: CollisionProof) -> None:
    """No sample of a free pair is below its proven clearance, and no pair is nearer at the ends than reported."""
    checker = CollisionChecker(scene)
    assert checker.joint_names == move.joint_names
    # Pairs that are out of reach of each other are not among these.
    free = np.array([pair not in hits(found) for pair in checker.pairs])
    padding = np.array([scene.padding_of(*pair) for pair in checker.pairs])
    own = np.array([scene.owner(a) == scene.owner(b) for a, b in checker.pairs])
    proven = np.where(own, found.proven[1], found.proven[0])
    for time in np.linspace(move.breaks[0], move.breaks[-1], 60):
        q = move(time)
        assert (checker.distances(q) - padding >= proven - 1e-7)[free].all()
        assert found.contacts or checker.is_free(q)
    for end, time in zip(found.ends, move.breaks[[0, -1]], strict=True):
        seen = (checker.distances(move(time)) - padding)[~own]
        if end is None:
            assert not len(seen)
        elif end.clearance > 0.0:
            assert end.time == time
            assert end.clearance == pytest.approx(seen.min(), abs=COAL)


@pytest.mark.parametrize("kind", ["planar2r", "sliding", "two arms", "half-space"])
def test_the_first_contact_is_where_the_slow_certificate_finds_it(
    kind: str, chain: Make, shape: Make, proof_of: Make, all_pairs: Make
) -> None:
    """The search finds it by its own distances, and no sample is deeper than what Coal's say."""
    compared = 0
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        scene = scene_of(kind, rng, chain, shape)
        move = wander(scene, rng, 0.5)
        found, sure = proof_of(scene, move), all_pairs(scene, move)
        depths = sampled_depths(scene, move) if found.contacts else {}
        for contact in found.contacts:
            k = scene.checked_pairs.index(contact.pair)
            slack = max(2e-4, 0.05 * abs(contact.clearance))
            assert contact.first == pytest.approx(sure.found.first_contact[k], abs=2e-5)
            assert contact.clearance == pytest.approx(sure.found.clearance[k], abs=slack + COAL)
            assert contact.clearance <= depths.get(contact.pair, np.inf) + slack + COAL
            compared += 1
    assert compared >= 2


def sampled_depths(scene: rp.Scene, move: rp.Trajectory) -> dict[tuple[str, str], float]:
    """The smallest clearance of each pair at 60 times."""
    checker = CollisionChecker(scene)
    padding = np.array([scene.padding_of(*pair) for pair in checker.pairs])
    seen = [checker.distances(move(time)) - padding for time in np.linspace(move.breaks[0], move.breaks[-1], 60)]
    return dict(zip(checker.pairs, np.min(seen, axis=0).tolist(), strict=True))


@pytest.mark.parametrize("kind", ["sliding", "two arms", "half-space"])
def test_the_smallest_clearance_is_where_padding_turns_free_into_contact(
    kind: str, chain: Make, shape: Make, proof_of: Make
) -> None:
    turned = 0
    for seed in range(8):
        rng = np.random.default_rng(1000 + seed)
        scene = scene_of(kind, rng, chain, shape)
        move = wander(scene, rng, 0.1)
        found = proof_of(scene, move, 1e-5)
        if found.contacts:
            continue
        clearance = min(nearest.clearance for nearest in found.nearest if nearest is not None)
        assert not proof_of(scene.with_padding(min(found.proven) - 2e-6), move).contacts
        assert proof_of(scene.with_padding(clearance + 1e-6), move).contacts
        turned += 1
    assert turned >= 3


def test_an_arm_without_a_column_is_hit_where_it_rests(
    chain: Make, shape: Make, proof_of: Make, all_pairs: Make
) -> None:
    verdicts = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        scene = scene_of("two arms", rng, chain, shape)
        whole = wander(scene, rng, 0.25)
        n = len(scene.arms["arm"].robot.joint_names)
        move = rp.Trajectory(whole.joint_names[:n], whole.breaks, whole.coefficients[:, :, :n])
        still = whole.coefficients.copy()
        still[:, :, n:] = 0.0
        still[:, 0, n:] = scene.configuration()[n:]
        fast = hits(proof_of(scene, move))
        assert fast == all_pairs(scene, rp.Trajectory(whole.joint_names, whole.breaks, still)).hits
        verdicts.append(bool(fast))
    assert 0 < sum(verdicts) < SEEDS


# ---- thin things ---------------------------------------------------------------------------


@pytest.mark.parametrize("thin", [rp.Box((0.001, 1.0, 1.0)), rp.Capsule(0.0002, 1.0), rp.Cylinder(0.0002, 1.0)])
@pytest.mark.parametrize("body", [rp.Sphere(0.0005), rp.Box((0.001, 0.4, 0.001)), rp.Cylinder(0.0005, 0.01)])
def test_a_plate_or_a_needle_that_is_crossed_at_once_is_found(
    thin: Any, body: Any, slider: Make, quintic: Make, proof_of: Make
) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        at = rng.uniform(-3.0, 3.0)
        scene = rp.Scene().with_arm("arm", slider(body)).with_obstacle("thin", thin, [at, 0.0, 0.0])
        move = quintic(["arm/slide"], [-5.0], [5.0], 10.0 ** rng.uniform(-4.0, 0.0))
        found = proof_of(scene, move)
        (contact,) = found.contacts
        assert np.isfinite(contact.first)
        assert contact.clearance < -1e-4
        assert float(move(contact.time)[0]) == pytest.approx(at, abs=0.006)
        past = scene.without_obstacle("thin").with_obstacle("thin", thin, [at, 0.72, 0.0])
        assert not proof_of(past, move).contacts


def test_a_needle_crossed_by_the_turning_tip_of_an_arm_is_found(gripper: Make, quintic: Make, proof_of: Make) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0.3, 2.5)
        scene = rp.Scene().with_arm("arm", gripper(rp.Sphere(0.001)))
        # The left finger is at (0.5, 0.05) of the arm.
        turn = pose(rpy=[0.0, 0.0, angle])
        met = scene.with_obstacle("needle", rp.Capsule(0.0002, 0.4), turn @ pose([0.5, 0.05, 0.0]))
        missed = scene.with_obstacle("needle", rp.Capsule(0.0002, 0.4), turn @ pose([0.5, 0.0, 0.0]))
        move = quintic(["arm/turn"], [0.0], [3.0], 0.001)
        deepest = min(proof_of(met, move).contacts, key=lambda contact: contact.clearance)
        assert float(move(deepest.time)[0]) == pytest.approx(angle, abs=0.003)
        assert not proof_of(missed, move).contacts
