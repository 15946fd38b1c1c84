"""Concave meshes as obstacles: exact triangles, and an inside if a surface is closed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from concave_meshes import angle_block, half_shell, joined, mug, open_bowl, soup, terrain, torus

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.robot import Geometry, Joint, Link
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.testing.collision_checkers import ElementChecker
from rr1plan.transforms import pose


def cube(half, center=(0.0, 0.0, 0.0)):
    return convex_hull(np.array(list(itertools.product((-half, half), repeat=3))) + np.array(center))


def inside_out(mesh):
    return rp.Mesh(mesh.vertices, mesh.faces[:, ::-1])


def plain(mesh):
    """The same triangles, not known to be convex."""
    return rp.Mesh(mesh.vertices, mesh.faces)


def gantry(shape, turned=False):
    """A shape that three joints move along the axes; with a fourth it also turns."""
    kinds = ["prismatic"] * 3 + ["revolute"] * turned
    links, joints = [Link("l0")], []
    for i, kind in enumerate(kinds):
        last = i == len(kinds) - 1
        links.append(Link(f"l{i + 1}", collisions=(Geometry("body", shape),) if last else ()))
        axis = np.array([0.48, 0.6, 0.64]) if kind == "revolute" else np.eye(3)[i]
        joints.append(Joint(f"j{i}", kind, f"l{i}", f"l{i + 1}", axis=axis, lower=-9.0, upper=9.0))
    n = len(kinds)
    limits = rp.Limits(np.full(n, -9.0), np.full(n, 9.0), *(np.ones(n) for _ in range(4)))
    names = tuple(joint.name for joint in joints)
    return rp.Robot("gantry", tuple(links), tuple(joints), names, limits, {"home": np.zeros(n)}, {}, frozenset(), "l1")


def scene_with(shape, mesh, place=None, turned=False):
    scene = rp.Scene().with_arm("arm", gantry(shape, turned))
    return scene.with_obstacle("mesh", mesh, pose() if place is None else place)


def to_triangles(points, triangles):
    """Distance of points (n, 3) to the nearest of triangles (m, 3, 3), one by one, by barycentric coordinates."""
    best = np.full(len(points), np.inf)
    for a, b, c in triangles:
        for p, q in ((a, b), (b, c), (c, a)):
            along = np.clip((points - p) @ (q - p) / max((q - p) @ (q - p), 1e-300), 0.0, 1.0)
            best = np.minimum(best, np.linalg.norm(points - p - along[:, None] * (q - p), axis=1))
        u, v = b - a, c - a
        n = np.cross(u, v)
        if n @ n == 0.0:
            continue
        w = points - a
        s, t = np.cross(w, v) @ n / (n @ n), np.cross(u, w) @ n / (n @ n)
        over = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0)
        best = np.where(over, np.minimum(best, np.abs(w @ n) / np.linalg.norm(n)), best)
    return best


MESHES = {
    "mug": mug(24, 6),
    "torus": torus(),
    "terrain": terrain(14),
    "half shell": half_shell(sides=18, levels=6),
    "open bowl": open_bowl(sides=12, levels=5),
    "soup": soup(),
    "angle": angle_block(),
}


# ---- distances -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MESHES)
def test_a_ball_is_as_far_as_the_nearest_of_all_triangles(name):
    """The surface has no margin: kernel and Coal have the distance of the triangles themselves."""
    mesh, radius = MESHES[name], 0.004
    place = pose([0.3, -0.2, 0.5], rpy=[0.3, -0.8, 2.0])
    checker = CollisionChecker(scene_with(rp.Sphere(radius), mesh, place))
    rng = np.random.default_rng(0)
    points = rng.uniform(mesh.vertices.min(axis=0) - 0.03, mesh.vertices.max(axis=0) + 0.03, (120, 3))
    want = to_triangles(points, mesh.vertices[mesh.faces]) - radius
    for point, distance in zip(points @ place[:3, :3].T + place[:3, 3], want, strict=True):
        found = checker.distances(point)[0]
        assert checker.is_free_slowly(point) == (found > 0.0)
        if found > 0.0:
            assert found == pytest.approx(distance, abs=1e-9)
            assert checker.clearance(point) == pytest.approx(distance, abs=1e-9)
        else:
            assert checker.clearance(point) <= 1e-9


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("shape", [rp.Box((0.03, 0.02, 0.05)), rp.Capsule(0.008, 0.06), rp.Cylinder(0.015, 0.03)])
def test_python_fcl_and_coal_find_the_same_bodies_free(name, shape):
    mesh = MESHES[name]
    scene = scene_with(shape, mesh, turned=True)
    checker = CollisionChecker(scene)
    rng = np.random.default_rng(1)
    low, high = mesh.vertices.min(axis=0) - 0.03, mesh.vertices.max(axis=0) + 0.03
    points = np.column_stack([rng.uniform(low, high, (150, 3)), rng.uniform(-3.0, 3.0, 150)])
    answers = []
    for q, contacts in zip(points, ElementChecker(scene, scene.joint_names()).contacts(points), strict=True):
        free, clearance = checker.is_free(q), checker.clearance(q)
        assert free == checker.is_free_slowly(q)
        assert free == (clearance > 0.0)
        # This close, both results are valid.
        if abs(clearance) > 1e-6:
            assert set().union(*contacts.values()) == (set() if free else {"FCL", "Coal"})
        answers.append(free)
    assert sum(answers) > 0


def test_padding_counts_from_the_triangles():
    scene = scene_with(rp.Sphere(0.01), terrain(10, height=0.0))
    for padding in (0.0, 0.02):
        checker = CollisionChecker(scene.with_padding(padding))
        for gap, free in ((-1e-4, False), (1e-4, True)):
            q = np.array([0.02, -0.07, 0.01 + padding + gap])
            assert checker.is_free(q) == checker.is_free_slowly(q) == free
            assert checker.edge_is_free(q, q + np.array([0.3, 0.1, 0.0])) == free


def test_an_arm_that_rests_in_a_mesh_blocks_all_motion(planar):
    """One that stands still beside it does not; it is inside, or crosses the surface."""
    scene = rp.Scene().with_arm("l", planar).with_arm("r", planar, [3.0, 0.0, 0.0])
    for mesh, place, free in (
        (terrain(6, height=0.0), [3.3, 0.0, -0.021], True),
        (terrain(6, height=0.0), [3.3, 0.0, -0.019], False),
        (torus(2.0, 1.2, 24, 12), [1.3, 0.0, 0.0], False),
    ):
        checker = CollisionChecker(scene.with_obstacle("mesh", mesh, place), ["l"])
        assert checker.static_is_free == free
        assert checker.edge_is_free([2.0, 0.0], [2.1, 0.0]) == free


# ---- inside ----------------------------------------------------------------------------------------


def holds(mesh, point):
    """Whether a tiny ball at a point is in contact; kernel, Coal and the referee say the same."""
    scene = scene_with(rp.Sphere(1e-4), mesh)
    checker, q = CollisionChecker(scene), np.array(point, dtype=float)
    free = checker.is_free_slowly(q)
    assert (checker.clearance(q) > 0.0) == free
    assert (checker.distances(q)[0] > 0.0) == free
    assert checker.is_free(q) == free
    assert checker.edge_is_free(q, q + 1e-5) == free
    assert checker.edge_is_free_slowly(q, q + 1e-5) == free
    move = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0]), np.array([[q, np.full(3, 1e-5)]]))
    assert all(violation.kind != "collision" for violation in rp.validate(move, scene).violations) == free
    return not free


def test_what_is_wholly_inside_a_closed_mesh_collides():
    ring = torus(0.2, 0.06)
    assert holds(ring, [0.2, 0.01, 0.0])
    assert not holds(ring, [0.01, 0.0, 0.0])
    assert not holds(ring, [0.2, 0.0, 0.07])
    assert holds(inside_out(ring), [0.2, 0.01, 0.0])
    block = angle_block()
    assert holds(block, [0.05, 0.2, 0.1])
    assert not holds(block, [0.2, 0.2, 0.1])


def test_the_cavity_of_a_closed_mesh_is_free():
    shell = joined(cube(0.5), inside_out(cube(0.4)))
    assert holds(shell, [0.45, 0.0, 0.1])
    assert not holds(shell, [0.1, 0.2, -0.1])


def test_what_two_closed_parts_have_in_common_is_inside():
    both = joined(cube(0.5), cube(0.5, (0.6, 0.1, 0.2)))
    assert holds(both, [0.3, 0.0, 0.1])
    assert holds(both, [0.9, 0.0, 0.1])
    assert not holds(both, [0.3, -0.45, 0.6])


def test_faces_that_disagree_about_the_outside_enclose_as_much():
    ring = torus()
    mixed = ring.faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    assert holds(rp.Mesh(ring.vertices, mixed), [0.2, 0.01, 0.0])
    assert not holds(rp.Mesh(ring.vertices, mixed), [0.01, 0.0, 0.0])


def test_triangles_whose_corners_are_not_shared_enclose_as_much():
    ring = torus()
    apart = rp.Mesh(ring.vertices[ring.faces].reshape(-1, 3), np.arange(3 * len(ring.faces)).reshape(-1, 3))
    assert holds(apart, [0.2, 0.01, 0.0])
    assert not holds(apart, [0.01, 0.0, 0.0])


def test_an_open_surface_has_no_inside_and_takes_none_from_a_closed_one():
    ring = torus()
    holed = rp.Mesh(ring.vertices, ring.faces[1:])
    assert not holds(holed, [0.2, 0.01, 0.0])
    assert not holds(open_bowl(), [0.0, 0.0, -0.1])
    beside = joined(ring, open_bowl(0.05))
    assert holds(beside, [0.2, 0.01, 0.0])
    assert not holds(beside, [0.0, 0.0, -0.02])


def test_boxes_that_share_an_edge_are_both_solid():
    both = joined(cube(0.5), cube(0.5, (1.0, 1.0, 0.0)))
    assert holds(both, [0.1, 0.2, 0.3])
    assert holds(both, [1.1, 1.2, 0.3])
    assert not holds(both, [1.1, 0.2, 0.3])


def test_points_on_a_line_with_corners_and_edges_are_told_apart_too():
    """Rays along the axes from there pass through corners, along edges and within faces."""
    block = angle_block(0.3, 0.1)
    for x, y, z in itertools.product((-0.1, 0.05, 0.1, 0.2), (-0.1, 0.05, 0.1, 0.2), (-0.1, 0.05, 0.075, 0.2)):
        within = 0.0 <= z <= 0.15 and ((0.0 <= x <= 0.3 and 0.0 <= y <= 0.1) or (0.0 <= x <= 0.1 and 0.0 <= y <= 0.3))
        assert holds(block, (x, y, z)) == within


def test_a_mesh_that_is_its_own_hull_is_solid_whoever_made_it():
    assert holds(plain(cube(0.5)), [0.2, 0.1, 0.0])
    assert not holds(plain(cube(0.5)), [0.6, 0.1, 0.0])
    lidless = plain(cube(0.5))
    lidless = rp.Mesh(lidless.vertices, lidless.faces[(lidless.vertices[lidless.faces][..., 2] < 0.4).any(axis=1)])
    assert not holds(lidless, [0.2, 0.1, 0.0])


# ---- edges -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MESHES)
def test_edges_that_are_certified_are_free_at_every_sample_and_others_are_not(name, six):
    mesh = MESHES[name]
    larger = rp.Mesh(mesh.vertices * (0.5 / np.ptp(mesh.vertices, axis=0).max()), mesh.faces)
    scene = rp.Scene().with_arm("arm", six).with_obstacle("mesh", larger, pose([0.3, 0.2, 0.35], rpy=[0.4, 0.2, 1.0]))
    checker = CollisionChecker(scene)
    rng = np.random.default_rng(5)
    found = {True: 0, False: 0}
    for q in rng.uniform(-2.2, 2.2, (400, 6)):
        if not checker.is_free(q):
            continue
        step = rng.normal(size=6)
        step *= rng.uniform(0.02, 1.0) / np.linalg.norm(step)
        free = checker.edge_is_free(q, q + step)
        found[free] += 1
        assert free == checker.edge_is_free_slowly(q, q + step)
        if free:
            assert all(checker.is_free_slowly(q + t * step) for t in rng.uniform(0.0, 1.0, 12))
        else:
            contact = checker.first_contact(q, q + step)
            assert not checker.is_free_slowly(contact.q) or checker.clearance(contact.q) < 2e-6
    assert min(found.values()) > 5


@pytest.mark.parametrize("distance", [0.05, 1.0, 8.0])
def test_nothing_slips_through_a_surface_without_thickness(distance):
    """Both ends are free, the surface is between them, and only its edges can be passed."""
    checker = CollisionChecker(scene_with(rp.Sphere(0.001), terrain(20)))
    rng = np.random.default_rng(6)
    for x, y in rng.uniform(-0.48, 0.48, (60, 2)):
        q0 = np.array([x, y, 0.1 + distance])
        q1 = np.array([*rng.uniform(-0.48, 0.48, 2), -0.1 - distance])
        assert checker.is_free(q0)
        assert checker.is_free(q1)
        assert not checker.edge_is_free(q0, q1)
        assert not checker.edge_is_free_slowly(q0, q1)
        assert checker.edge_is_free(q0, q0 + np.array([1.5, 0.0, 0.0]))


def test_a_way_through_the_hole_of_a_ring_is_free():
    checker = CollisionChecker(scene_with(rp.Capsule(0.01, 0.2), torus(0.05, 0.02, 48, 24)))
    assert checker.edge_is_free([0.0, 0.0, -0.5], [0.0, 0.0, 0.5])
    assert checker.edge_is_free([0.015, 0.0, -0.5], [0.0, 0.015, 0.5])
    assert not checker.edge_is_free([0.025, 0.0, -0.5], [0.025, 0.0, 0.5])


@pytest.mark.parametrize(("gap", "free"), [(1e-5, True), (3e-6, True), (-1e-6, False)])
def test_sliding_along_a_flat_surface_of_many_triangles(gap, free):
    checker = CollisionChecker(scene_with(rp.Box((0.05, 0.04, 0.02)), terrain(40, height=0.0)))
    q = np.array([-0.3, -0.2, 0.01 + gap])
    assert checker.edge_is_free(q, q + np.array([0.6, 0.4, 0.0])) == free
    assert checker.edge_is_free_slowly(q, q + np.array([0.6, 0.4, 0.0])) == free


def test_triangles_without_an_area_are_points_and_lines():
    line = rp.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.2, 0.3, 0.0]]), [[0, 1, 2], [3, 3, 3]])
    checker = CollisionChecker(scene_with(rp.Sphere(0.05), line))
    for q, want in (([0.4, 0.03, 0.09], 0.0949), ([0.2, 0.3, 0.1], 0.1), ([1.3, 0.0, 0.4], 0.5)):
        assert checker.clearance(q) == pytest.approx(want - 0.05, abs=1e-4)
        assert checker.distances(q)[0] == pytest.approx(want - 0.05, abs=1e-4)
    assert not checker.edge_is_free([0.4, -0.5, 0.03], [0.4, 0.5, 0.03])
    assert not checker.edge_is_free([0.2, 0.3, 0.5], [0.2, 0.3, -0.5])
    assert checker.edge_is_free([0.2, 0.5, 0.06], [0.4, -0.5, 0.06])


@pytest.mark.parametrize("count", [1, 7, 8, 9, 64, 65, 513])
def test_surfaces_of_any_number_of_triangles(count):
    """Trees with a single leaf, with full nodes, and with one triangle more."""
    ground = terrain(17, height=0.05)
    mesh = rp.Mesh(ground.vertices, ground.faces[:count])
    checker = CollisionChecker(scene_with(rp.Sphere(0.01), mesh))
    points = np.random.default_rng(count).uniform((-0.5, -0.5, -0.1), (0.5, 0.5, 0.1), (60, 3))
    want = to_triangles(points, mesh.vertices[mesh.faces]) - 0.01
    for point, distance in zip(points, want, strict=True):
        found = checker.clearance(point)
        assert found == pytest.approx(distance, abs=1e-9) if distance > 0.0 else found <= 1e-9


# ---- whole scenes ----------------------------------------------------------------------------------


def test_meshes_in_one_scene_and_parts_of_one_obstacle_are_told_apart():
    ring, ground = torus(), terrain(10)
    scene = rp.Scene().with_arm("arm", gantry(rp.Sphere(0.01)))
    scene = scene.with_obstacle("ring", ring, [0.0, 0.0, 1.0]).with_obstacle("ground", ground, [0.0, 0.0, -1.0])
    two = (Geometry("low", ring, pose([0, 0, 2.0])), Geometry("post", rp.Box((0.1, 0.1, 0.1)), pose([2, 0, 2.0])))
    scene = scene.with_obstacle("both", (*two, Geometry("high", ground, pose([0, 0, 4.0]))))
    checker = CollisionChecker(scene)
    for at, names in (
        ([0.2, 0.0, 1.0], {"ring"}), ([0.0, 0.0, 1.0], set()), ([0.2, 0.0, 2.0], {"both"}), ([2.0, 0.0, 2.0], {"both"}),
    ):  # fmt: skip
        assert {contact.b for contact in checker.contacts(at)} == names
        assert checker.is_free(at) == (not names)
    for height, name in ((-1.0, "ground"), (4.0, "both")):
        ends = np.array([[0.1, 0.05, height - 0.3], [0.1, 0.05, height + 0.3]])
        assert checker.first_contact(*ends).pair == ("arm/l3", name)


def test_a_moved_mesh_is_checked_where_it_is():
    scene = scene_with(rp.Sphere(0.01), torus())
    assert not CollisionChecker(scene).is_free([0.2, 0.0, 0.0])
    moved = scene.without_obstacle("mesh").with_obstacle("mesh", torus(), pose([0.0, 0.0, 0.5], rpy=[np.pi / 2, 0, 0]))
    checker = CollisionChecker(moved)
    assert checker.is_free([0.0, 0.2, 0.0])
    assert not checker.is_free([0.0, 0.0, 0.7])


def test_a_mug_is_planned_into_and_the_motion_is_proven():
    cup = mug(24, 6)
    scene = scene_with(rp.Capsule(0.006, 0.03), cup)
    outside, within = [0.07, -0.05, 0.06], [0.005, 0.0, 0.04]
    assert not CollisionChecker(scene).edge_is_free(outside, within)
    found = rp.plan_motion(rp.Problem(scene, outside, within), rng=0)
    assert found.valid
    checker = CollisionChecker(scene)
    _, q = found.trajectory.sample(0.002)
    assert all(checker.is_free_slowly(one) for one in q)


def test_a_flat_mesh_is_an_obstacle_too():
    flat = rp.Mesh(np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]), np.array([(0, 1, 2), (1, 3, 2)]))
    checker = CollisionChecker(scene_with(rp.Sphere(0.1), flat))
    assert not checker.edge_is_free([0.5, 0.5, 0.5], [0.5, 0.5, -0.5])
    assert checker.edge_is_free([1.2, 0.5, 0.5], [1.2, 0.5, -0.5])


def test_what_a_link_that_stands_still_sees_of_a_mesh_is_coals_too(planar):
    """Clouds and half-spaces on a base, beside a mesh: a cell of a cloud may be wholly inside it."""
    ring = torus()
    for shape, touches in (
        (rp.PointCloud([[0.2, 0.0, 0.0], [2.0, 2.0, 2.0]], 0.01), True),
        (rp.PointCloud([[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]], 0.01), False),
        (rp.HalfSpace((0.0, 0.0, 1.0), -0.05), True),
        (rp.HalfSpace((0.0, 0.0, 1.0), -0.07), False),
    ):
        foot = Link("foot", collisions=(Geometry("g", shape),))
        robot = gantry(rp.Sphere(0.01))
        joints = (Joint("stand", "fixed", "l0", "foot"), *robot.joints)
        never = frozenset({frozenset({"foot", "l3"}), frozenset({"foot", "l0"})})
        robot = rp.Robot(
            "footed", (robot.links[0], foot, *robot.links[1:]), joints, robot.joint_names, robot.limits,
            {"home": np.zeros(3)}, {}, never, "l1",
        )  # fmt: skip
        scene = rp.Scene().with_arm("arm", robot).with_obstacle("ring", ring)
        assert CollisionChecker(scene).static_is_free != touches


def test_the_clearance_to_a_cloud_is_that_to_its_nearest_cell():
    cloud = rp.PointCloud(np.array([[0.5, 0.0, 0.0], [0.2, 0.0, 0.0], [0.35, 0.0, 0.0]]), 0.02)
    checker = CollisionChecker(scene_with(rp.Sphere(0.05), cloud))
    for x in (0.0, 0.9, -0.4):
        q = np.array([x, 0.0, 0.01])
        assert checker.clearance(q) == pytest.approx(checker.distances(q)[0], abs=1e-9)
