"""Concave meshes in the referee: its search against Coal's distances, and the inside of closed meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from concave_meshes import angle_block, half_shell, joined, open_bowl, soup, terrain, torus

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.robot import Geometry
from rr1plan.transforms import pose
from rr1plan.validation.mesh_surfaces import PartTree, cell_parts, surface_parts
from rr1plan.validation.referee_kernels import CLOSED, FIRST

Make = Callable[..., Any]
# Largest overestimate of a distance by Coal [m].
COAL = 2e-5

MESHES = {
    "torus": torus(sides=16, around=8),
    "terrain": terrain(10, 0.8),
    "half shell": half_shell(sides=16, levels=5),
    "open bowl": open_bowl(sides=12, levels=5),
    "soup": soup(12),
    "angle": angle_block(),
    "many": terrain(40, 0.8),
}


def wander(scene: rp.Scene, rng: np.random.Generator, reach: float) -> rp.Trajectory:
    """Two cubics, one after the other."""
    c = reach * rng.normal(size=(2, 4, len(scene.joint_names())))
    c[0, 0] = scene.configuration()
    c[1, 0] = c[0].sum(axis=0)
    return rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0, 2.0]), c)


@pytest.mark.parametrize("name", MESHES)
def test_the_search_finds_what_coals_distances_do(name: str, chain: Make, proof_of: Make, all_pairs: Make) -> None:
    verdicts = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        at = rng.normal(size=3)
        place = pose(at / np.linalg.norm(at) * rng.uniform(0.3, 0.7), rpy=rng.normal(size=3))
        scene = rp.Scene().with_arm("arm", chain(rng, 4)).with_obstacle("mesh", MESHES[name], place)
        move = wander(scene, rng, (0.02, 0.1, 0.3)[seed % 3])
        fast, sure = proof_of(scene, move), all_pairs(scene, move)
        assert [contact.pair for contact in fast.contacts] == sure.hits, seed
        assert [contact.pair for contact in proof_of(scene, move, clearance=False).contacts] == sure.hits, seed
        verdicts.append(bool(sure.hits))
        if not verdicts[-1]:
            assert fast.nearest[0].clearance == pytest.approx(sure.smallest[0], abs=2e-4 + COAL)
            assert fast.proven[0] <= sure.smallest[0] + COAL
            assert fast.proven[0] >= fast.nearest[0].clearance - 2e-4 - COAL
    assert 0 < sum(verdicts) < 10


CLOUD = rp.PointCloud(np.random.default_rng(0).uniform(-0.2, 0.2, (60, 3)), 0.03)


@pytest.mark.parametrize("other", [rp.Box((0.1, 0.2, 0.3)), angle_block(), CLOUD], ids=["box", "mesh", "cloud"])
@pytest.mark.parametrize("held", ["torus", "half shell", "soup", "angle"])
def test_meshes_that_move_are_decided_as_by_coals_distances(
    held: str, other: Any, chain: Make, proof_of: Make, all_pairs: Make
) -> None:
    for seed in range(2):
        rng = np.random.default_rng(seed)
        scene = rp.Scene().with_arm("arm", chain(rng, 3))
        tool = scene.link_poses()["arm/link3"]
        scene = scene.with_obstacle("held", MESHES[held], tool @ pose([0.2, 0.0, 0.0])).attach("held", "arm")
        at = tool[:3, 3] + rng.uniform(0.4, 0.8) * np.array([0.6, 0.0, 0.8])
        scene = scene.with_obstacle("other", other, pose(at, rpy=rng.normal(size=3)))
        move = wander(scene, rng, (0.02, 0.1)[seed])
        fast, sure = proof_of(scene, move), all_pairs(scene, move)
        assert [contact.pair for contact in fast.contacts] == sure.hits, seed
        for contact in fast.contacts:
            first = sure.found.first_contact[scene.checked_pairs.index(contact.pair)]
            assert contact.first == pytest.approx(first, abs=2e-5)
            assert contact.clearance <= 1e-6
        if not fast.contacts:
            for group in range(2):
                nearest = fast.nearest[group]
                assert (nearest is None) == np.isinf(sure.smallest[group])
                assert nearest is None or nearest.clearance == pytest.approx(sure.smallest[group], abs=2e-4 + COAL)
                assert nearest is None or fast.proven[group] <= sure.smallest[group] + COAL


@pytest.mark.parametrize("pin", [rp.Capsule(0.01, 0.5), torus(0.02, 0.01)], ids=["convex", "mesh"])
def test_a_held_ring_may_move_around_a_pin_but_not_through_it(pin: Any, slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.01)))
    scene = scene.with_obstacle("ring", torus(0.1, 0.02)).attach("ring", "arm", "carriage", touch=["carriage"])
    scene = scene.with_obstacle("pin", pin, [1.0, 0.0, 0.0])
    for start, goal, free in ((0.0, 0.8, True), (0.98, 1.03, True), (0.0, 0.98, False), (0.98, 1.2, False)):
        report = rp.validate(quintic(scene.joint_names(), [start], [goal]), scene)
        touching = {violation.subject for violation in report.violations} - {("arm/carriage", "pin")}
        assert touching == (set() if free else {("pin", "ring")})


@pytest.mark.parametrize("flipped", [False, True])
def test_what_begins_inside_a_closed_mesh_is_found_though_it_crosses_no_triangle(
    flipped: bool, slider: Make, quintic: Make
) -> None:
    ring = torus(0.2, 0.06)
    faces = ring.faces.copy()
    if flipped:
        faces[::2] = faces[::2, ::-1]
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.01)))
    inside = scene.with_obstacle("ring", rp.Mesh(ring.vertices, faces), [0.2, 0.0, 0.0])
    move = quintic(inside.joint_names(), [0.0], [0.01])
    (violation,) = rp.validate(move, inside).violations
    assert violation.kind == "collision"
    assert violation.subject == ("arm/carriage", "ring")
    # Minus the distance from the surface, and the ball's radius.
    assert violation.value == pytest.approx(-0.05, abs=5e-3)
    assert rp.validate(quintic(inside.joint_names(), [0.3], [0.31]), inside).violations == ()
    holed = scene.with_obstacle("ring", rp.Mesh(ring.vertices, faces[1:]), [0.2, 0.0, 0.0])
    assert rp.validate(move, holed).violations == ()


def test_a_body_that_enters_a_closed_mesh_and_leaves_it_is_found(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(rp.Box((0.01, 0.02, 0.03)))).with_obstacle("ring", torus(), [1.0, 0, 0])
    report = rp.validate(quintic(scene.joint_names(), [0.0], [2.0], 0.01), scene)
    assert [violation.kind for violation in report.violations] == ["collision"]


@pytest.mark.parametrize("speed", [0.1, 100.0])
def test_no_triangle_is_too_thin_or_too_fast(speed: float, slider: Make, quintic: Make) -> None:
    upright = pose([1.0, 0.05, -0.03], rpy=[0.0, np.pi / 2, 0.0])
    scene = (
        rp.Scene().with_arm("arm", slider(rp.Sphere(0.001))).with_obstacle("sheet", terrain(30, height=0.0), upright)
    )
    seconds = 2.0 / speed
    report = rp.validate(quintic(scene.joint_names(), [0.0], [2.0], seconds), scene)
    assert [violation.kind for violation in report.violations] == ["collision"]
    assert rp.validate(quintic(scene.joint_names(), [0.0], [0.998], seconds), scene).violations == ()


def test_the_smallest_clearance_from_many_triangles_is_found_and_proven(slider: Make, quintic: Make) -> None:
    ground = terrain(40, 2.0, 0.05)
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.02))).with_obstacle("ground", ground, [0.0, 0.0, -0.1])
    report = rp.validate(quintic(scene.joint_names(), [-0.8], [0.8]), scene)
    a, b, c = (ground.vertices[ground.faces[:, k]] - [0.0, 0.0, 0.1] for k in range(3))
    near = np.abs(np.stack([a, b, c])[..., 1]).min(axis=0) < 0.15

    def distance(x: float) -> float:
        return float(to_plane(np.array([x, 0.0, 0.0]), a[near], b[near], c[near]))

    # A sample whose distance exceeds the smallest one by half a step has no smaller one around it.
    coarse = np.linspace(-0.8, 0.8, 401)
    distances, half = np.array([distance(x) for x in coarse]), 0.002
    around = coarse[distances <= distances.min() + half]
    want = min(distance(x) for at in around for x in np.linspace(at - half, at + half, 11)) - 0.02
    assert report.margins["clearance"].value == pytest.approx(want, abs=2e-5)
    assert report.margins["clearance_proven"].value <= want + 1e-9


def to_plane(p: Array, a: Array, b: Array, c: Array) -> float:
    """Distance of a point to the nearest of triangles, sampled finely."""
    s, t = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 9))
    s, t = s[s + t <= 1.0 + 1e-9], t[s + t <= 1.0 + 1e-9]
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1)[:, None]
    height = np.einsum("ij,ij->i", p - a, n)
    foot = p - height[:, None] * n
    u, v, w = b - a, c - a, foot - a
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("ij,ij->i", w, u), np.einsum("ij,ij->i", w, v)
    det = uu * vv - uv * uv
    over = ((wu * vv - wv * uv) / det >= 0) & ((wv * uu - wu * uv) / det >= 0)
    over &= (wu * vv - wv * uv) / det + (wv * uu - wu * uv) / det <= 1.0
    points = a[:, None] + s[:, None] * u[:, None] + t[:, None] * v[:, None]
    return min(np.abs(height[over]).min(initial=np.inf), np.linalg.norm(points - p, axis=2).min())


# ---- surfaces by themselves ----------------------------------------------------------------


def check_tree(tree: PartTree, low: Array, high: Array) -> None:
    """Every part is in one leaf, and in all boxes above it."""
    assert sorted(tree.order.tolist()) == list(range(len(low)))
    leaves = []
    for i, ((following, first, last), box) in enumerate(zip(tree.nodes, tree.boxes, strict=True)):
        assert i < following <= len(tree.nodes)
        below = tree.nodes[i:following]
        parts = tree.order[below[below[:, 1] < below[:, 2], 1].min() : below[:, 2].max()]
        assert (low[parts] >= box[:3] - box[3:]).all()
        assert (high[parts] <= box[:3] + box[3:]).all()
        leaves += range(first, last)
    assert leaves == list(range(len(low)))


@pytest.mark.parametrize("name", MESHES)
def test_every_triangle_is_in_one_leaf_and_in_all_boxes_above(name: str) -> None:
    mesh = MESHES[name]
    columns, tree = surface_parts(mesh)
    corners = mesh.vertices[mesh.faces]
    assert (columns[:3].T.reshape(-1, 3, 3) == corners[tree.order]).all()
    check_tree(tree, corners.min(axis=1), corners.max(axis=1))


@pytest.mark.parametrize("count", [1, 2, 9, 3000])
def test_every_cell_is_in_one_leaf_and_in_all_boxes_above(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 3))
    columns, tree = cell_parts(rp.PointCloud(points, 0.1))
    centers = np.empty(columns[:3].T.shape)
    centers[tree.order] = columns[:3].T
    assert (np.unique(np.floor(points / 0.1), axis=0) == np.floor(centers / 0.1)).all()
    check_tree(tree, centers - 0.05, centers + 0.05)


def test_parts_that_are_closed_are_known_and_one_triangle_of_each_part() -> None:
    for mesh, closed, parts in (
        (torus(), 1.0, 1),
        (terrain(4), 0.0, 1),
        (open_bowl(), 0.0, 1),
        (joined(torus(), terrain(4)), None, 2),
    ):
        bits = surface_parts(mesh).columns[3, ::3].astype(int)
        assert closed is None or ((bits & CLOSED) > 0).mean() == closed
        assert closed is not None or 0.0 < ((bits & CLOSED) > 0).mean() < 1.0
        assert np.count_nonzero(bits & FIRST) == parts


def test_a_mesh_of_several_shapes_is_judged_part_by_part(slider: Make, quintic: Make) -> None:
    shapes = [Geometry(f"g{i}", torus(0.05, 0.01), pose([0.3 * i, 0.0, 0.0])) for i in range(3)]
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.005))).with_obstacle("rings", shapes, [1.0, 0.0, 0.03])
    assert rp.validate(quintic(scene.joint_names(), [0.0], [2.0]), scene).violations == ()
    lower = rp.Scene().with_arm("arm", slider(rp.Sphere(0.005))).with_obstacle("rings", shapes, [1.0, 0.0, 0.0])
    assert [violation.kind for violation in rp.validate(quintic(lower.joint_names(), [0.0], [2.0]), lower).violations]


def test_an_arm_that_stands_still_in_a_closed_mesh_or_below_its_corner_is_found(
    slider: Make, gripper: Make, quintic: Make
) -> None:
    """A ball inside; and a half-space on a base, above which the corners of a mesh have to be."""
    ring = torus(0.3, 0.1)
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.01)))
    move = quintic(scene.joint_names(), [5.0], [5.1])
    for shape, at, hit in (
        (rp.Sphere(0.01), [0.3, 0.0, 0.0], True),
        (rp.Sphere(0.01), [0.0, 0.0, 0.0], False),
        (rp.HalfSpace((0.0, 0.0, 1.0), -0.09), [0.0, 0.0, 0.0], True),
        (rp.HalfSpace((0.0, 0.0, 1.0), -0.11), [0.0, 0.0, 0.0], False),
    ):
        still = slider(shape)
        both = scene.with_arm("other", still, at).with_obstacle("ring", ring).allow("arm", "other")
        subjects = [violation.subject for violation in rp.validate(move, both).violations]
        assert subjects == ([("other/carriage", "ring")] if hit else [])
