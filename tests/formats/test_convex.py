"""Hulls and convex pieces contain their shape; the cache never changes a result."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import coal
import numpy as np
import pytest
from concave_meshes import revolved, terrain, torus
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.errors import BackendError, CancelledError, InputError, UnknownNameError
from rr1plan.files.disk_cache import cache_folder, cache_key, load_cached, store_cached
from rr1plan.shapes import Mesh, coacd_process, convex_decomposition, convex_hulls
from rr1plan.shapes.convex_decomposition import Convexity, convex_pieces, convex_shapes
from rr1plan.shapes.convex_hulls import convex_hull, distance_outside, is_convex, is_own_hull


def outside(piece: Mesh, points: np.ndarray) -> np.ndarray:
    """How far points are outside a convex mesh, from its triangles' planes alone, (n,)."""
    a, b, c = (piece.vertices[piece.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    keep = areas > 1e-12
    normals, a = normals[keep] / areas[keep, None], a[keep]
    return np.asarray((points @ normals.T - np.einsum("ij,ij->i", normals, a)).max(axis=1))


def on_surface(mesh: Mesh, count: int, rng: np.random.Generator) -> np.ndarray:
    triangles = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    weights = rng.dirichlet((1, 1, 1), count)
    return np.einsum("nk,nkd->nd", weights, triangles[rng.choice(len(areas), count, p=areas / areas.sum())])


def test_a_mesh_of_too_many_triangles_is_not_cut_into_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convex_decomposition, "MAX_TRIANGLES", 1)
    tetrahedron = Mesh(np.vstack([np.eye(3), np.zeros(3)]), np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    with pytest.raises(InputError, match="4 triangles"):
        convex_pieces(tetrahedron)
    assert len(convex_pieces(convex_hull(tetrahedron.vertices))) == 1


def test_points_are_outside_by_as_much_in_parts_as_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    hull, points = convex_hull(rng.normal(size=(30, 3))), rng.normal(size=(100, 3))
    at_once = distance_outside(hull.vertices, points)
    monkeypatch.setattr(convex_hulls, "_MOST_PRODUCTS", 500)
    assert np.allclose(distance_outside(hull.vertices, points), at_once, atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10_000), count=st.integers(5, 60), size=st.sampled_from([1e-3, 1.0, 50.0]))
def test_a_hull_holds_its_points_is_closed_and_faces_outwards(seed: int, count: int, size: float) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3)) * size
    hull = convex_hull(points)
    assert hull.convex
    assert outside(hull, points).max() < 1e-9 * size
    assert {tuple(v) for v in hull.vertices.tolist()} <= {tuple(v) for v in points.tolist()}
    edges = np.concatenate([hull.faces[:, [0, 1]], hull.faces[:, [1, 2]], hull.faces[:, [2, 0]]])
    assert {tuple(e) for e in edges.tolist()} == {(b, a) for a, b in edges.tolist()}


def test_a_convex_mesh_stays_as_it_is(block: Mesh) -> None:
    for how in ("hull", "pieces"):
        (shape,) = convex_shapes([block], how)
        assert {tuple(v) for v in shape.vertices.tolist()} == {tuple(v) for v in block.vertices.tolist()}


def test_convex_and_other_meshes_are_told_apart(block: Mesh, gate: Mesh) -> None:
    assert is_convex(block)
    assert not is_convex(gate)


@pytest.mark.parametrize("products", [1, 20_000_000], ids=["by corner", "all planes"])
def test_a_mesh_is_its_own_hull_only_where_nothing_is_missing(products: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convex_hulls, "_MOST_PRODUCTS", products)
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    ball = revolved(np.stack([np.cos(angles).round(15), np.sin(angles)], axis=1), 16, closed_profile=False)
    assert is_own_hull(ball)
    assert is_own_hull(Mesh(ball.vertices, ball.faces[:, ::-1]))
    assert is_own_hull(Mesh(ball.vertices.astype(np.float32), ball.faces))
    assert not is_own_hull(Mesh(ball.vertices, ball.faces[1:]))
    assert not is_own_hull(Mesh(ball.vertices, np.concatenate([ball.faces, ball.faces[:1]])))
    dented = ball.vertices.copy()
    dented[40] *= 1.0 - 1e-5
    assert not is_own_hull(Mesh(dented, ball.faces))
    middle = np.concatenate([ball.vertices, 0.999999 * ball.vertices[ball.faces[5]].mean(axis=0, keepdims=True)])
    a, b, c = ball.faces[5]
    pressed = [(a, b, len(ball.vertices)), (b, c, len(ball.vertices)), (c, a, len(ball.vertices))]
    assert not is_own_hull(Mesh(middle, np.concatenate([np.delete(ball.faces, 5, axis=0), pressed])))
    assert not is_own_hull(torus())
    assert not is_own_hull(terrain(3, height=0.0))


def test_the_hull_of_parts_holds_them_all(block: Mesh, gate: Mesh) -> None:
    (shape,) = convex_shapes([block, gate])
    assert outside(shape, np.concatenate([block.vertices, gate.vertices])).max() < 1e-9


def test_pieces_contain_the_surface_and_leave_the_gate_open(gate: Mesh) -> None:
    pieces = convex_pieces(gate)
    assert len(pieces) > 1
    assert all(piece.convex for piece in pieces)
    points = on_surface(gate, 4000, np.random.default_rng(0))
    depth = np.min([outside(piece, points) for piece in pieces], axis=0)
    assert depth.max() < 1e-9
    doorway = np.array([[2.0, 0.4, 1.0], [2.0, 0.4, 0.2], [1.5, 0.4, 1.5]])
    assert np.min([outside(piece, doorway) for piece in pieces], axis=0).min() > 0.2


def test_a_ball_touches_the_pieces_wherever_it_touches_the_mesh(gate: Mesh) -> None:
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(gate.faces), len(gate.vertices))
    model.addVertices(np.array(gate.vertices))
    model.addTriangles(np.array(gate.faces, dtype=np.int64))
    model.endModel()
    ball = coal.Sphere(0.1)
    pieces = convex_pieces(gate)
    rng = np.random.default_rng(1)
    hits = 0
    for center in rng.uniform((-0.2, -0.2, -0.2), (4.2, 1.0, 3.2), (400, 3)):
        at = coal.Transform3s(np.eye(3), center)
        if coal.collide(model, coal.Transform3s.Identity(), ball, at, coal.CollisionRequest(), coal.CollisionResult()):
            hits += 1
            assert min(outside(piece, center[None])[0] for piece in pieces) <= 0.1 + 1e-9
    assert hits > 50


@pytest.mark.parametrize("how", ["hull", "pieces"])
def test_a_flat_mesh_is_refused(how: Convexity) -> None:
    flat = Mesh(np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]), np.array([(0, 1, 2), (1, 3, 2)]))
    with pytest.raises(InputError, match="flat"):
        convex_shapes([flat], how)


def test_an_unknown_way_is_refused(block: Mesh) -> None:
    with pytest.raises(UnknownNameError, match="pieces"):
        convex_shapes([block], "piece")


@pytest.mark.parametrize(
    ("child", "said"), [("raise RuntimeError('inner')", "inner"), ("import os; os._exit(3)", "exit code 3")]
)
def test_a_failing_decomposition_is_our_error(
    gate: Mesh, child: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(coacd_process, "_CHILD", child)
    with pytest.raises(BackendError, match=f"decompose a mesh of 28 triangles: .*{said}"):
        convex_pieces(gate)


def test_a_large_mesh_reaches_a_process_that_reads_it_late(monkeypatch: pytest.MonkeyPatch) -> None:
    late = (
        "import io, sys, time, numpy; time.sleep(0.3);"
        "mesh = numpy.load(io.BytesIO(sys.stdin.buffer.read()));"
        "numpy.savez(sys.stdout.buffer, piece=mesh['vertices'])"
    )
    monkeypatch.setattr(coacd_process, "_CHILD", late)
    vertices, faces = np.random.default_rng(0).normal(size=(20_000, 3)), np.zeros((40_000, 3), dtype=np.int32)
    (piece,) = coacd_process.coacd_pieces(vertices, faces, {}, 20.0, lambda: None)
    assert np.array_equal(piece, vertices)


@pytest.fixture
def endless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A decomposition that does not end, and the file with the number of its process."""
    file = tmp_path / "child"
    work = f"import os, time; open({str(file)!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    monkeypatch.setattr(coacd_process, "_CHILD", work)
    return file


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_decomposition_that_takes_too_long_is_ended_and_says_what_to_try(gate: Mesh, endless: Path) -> None:
    with pytest.raises(InputError, match=r"mesh of 28 triangles was not cut.* in 0\.5 s; try a decimated mesh.*hull"):
        convex_pieces(gate, seconds=0.5)
    assert not is_running(int(endless.read_text()))


def test_a_decomposition_is_cancelled_by_its_progress(gate: Mesh, endless: Path) -> None:
    shares = []

    def progress(said: rp.Progress) -> bool:
        shares.append(said.fraction)
        return not endless.exists() or not endless.read_text()

    with pytest.raises(CancelledError, match="28 triangles"):
        convex_pieces(gate, seconds=50.0, progress=progress)
    assert 0.0 < shares[-1] < 1.0
    assert not is_running(int(endless.read_text()))


def test_planning_with_a_concave_mesh_in_the_hand_reports_progress_and_is_cancelled(gate: Mesh, endless: Path) -> None:
    scene = rp.load_scene("rr1_table").with_obstacle("gate", gate, [3.0, 0.0, 0.0]).attach("gate")
    problem = rp.Problem(scene, "home", "zero")
    heard: list[str] = []

    def progress(progress: rp.Progress) -> bool:
        heard.append(progress.stage)
        return progress.fraction == 0.0

    motion = rp.plan_motion(problem, progress=progress)
    assert motion.status is rp.PlanStatus.CANCELLED
    assert "while a mesh of 28 triangles" in motion.result.reason
    assert heard == ["set up", "set up"]
    with pytest.raises(CancelledError):
        rp.warm_up(problem, progress=lambda _: False)


def test_planning_among_concave_meshes_decomposes_nothing(gate: Mesh, endless: Path) -> None:
    scene = rp.load_scene("rr1_table").with_obstacle("gate", gate, [3.0, 0.0, 0.0])
    assert rp.plan_motion(rp.Problem(scene, "home", "zero"), rng=0).valid
    assert not endless.exists()


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), "many"])
def test_a_time_that_is_none_is_refused(gate: Mesh, seconds: float) -> None:
    with pytest.raises(InputError, match="seconds"):
        convex_pieces(gate, seconds=seconds)


# ---- parts that need no decomposition ----------------------------------------------------


@pytest.fixture
def no_decomposition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda *_: pytest.fail("decomposed"))


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    corners, where = np.unique(vertices, axis=0, return_inverse=True)
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return Mesh(corners, where.reshape(-1)[faces])


def box_mesh(lower: tuple[float, ...], upper: tuple[float, ...]) -> Mesh:
    hull = convex_hull(np.array(list(itertools.product(*zip(lower, upper, strict=True)))))
    return Mesh(hull.vertices, hull.faces)


def turned_inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


@pytest.mark.usefixtures("no_decomposition")
@pytest.mark.parametrize("outward", [True, False])
def test_a_table_of_boxes_that_touch_is_those_boxes(outward: bool) -> None:
    top = box_mesh((-0.6, -0.4, 0.7), (0.6, 0.4, 0.73))
    legs = [box_mesh((x, y, 0.0), (x + 0.05, y + 0.05, 0.7)) for x in (-0.6, 0.55) for y in (-0.4, 0.35)]
    table = joined(top, *legs)
    pieces = convex_pieces(table if outward else turned_inside_out(table))
    assert sorted(piece.vertices.min(axis=0).tolist() for piece in pieces) == sorted(
        mesh.vertices.min(axis=0).tolist() for mesh in (top, *legs)
    )
    assert all(len(piece.vertices) == 8 for piece in pieces)


@pytest.mark.usefixtures("no_decomposition")
@pytest.mark.parametrize("seed", range(5))
def test_loose_triangles_become_thin_plates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = Mesh(rng.uniform(-1, 1, (60, 3)), np.arange(60).reshape(-1, 3))
    pieces = convex_pieces(mesh)
    assert len(pieces) == 20
    surface = on_surface(mesh, 500, rng)
    assert np.min([outside(piece, surface) for piece in pieces], axis=0).max() < 0.0
    for piece, corners in zip(pieces, mesh.vertices[mesh.faces], strict=True):
        assert np.linalg.norm(piece.vertices[:, None] - corners, axis=2).min(axis=1).max() < 2e-3


@pytest.mark.usefixtures("no_decomposition")
def test_a_box_without_a_lid_stays_open_and_one_with_a_crack_is_its_hull(block: Mesh) -> None:
    lid = (block.vertices[block.faces][:, :, 2] == 3.0).all(axis=1)
    pieces = convex_pieces(Mesh(block.vertices, block.faces[~lid]))
    assert (
        np.min([outside(piece, np.array([[0.5, 1.0, 1.5], [0.5, 1.0, 3.0]])) for piece in pieces], axis=0).min() > 0.4
    )
    surface = on_surface(Mesh(block.vertices, block.faces[~lid]), 1000, np.random.default_rng(0))
    assert np.min([outside(piece, surface) for piece in pieces], axis=0).max() < 0.0
    raised = block.vertices + np.array([0.0, 0.0, 1e-6])
    cracked = Mesh(
        np.concatenate([block.vertices, raised]), np.where(lid[:, None], block.faces + len(raised), block.faces)
    )
    assert len(convex_pieces(cracked)) == 1


def test_a_room_keeps_its_inside_free(monkeypatch: pytest.MonkeyPatch) -> None:
    outer, inner = box_mesh((-2, -2, -2), (2, 2, 2)), box_mesh((-1.8, -1.8, -1.8), (1.8, 1.8, 1.8))
    walls = [sign * np.roll((1.9, 0.0, 0.0), axis) for axis in range(3) for sign in (1, -1)]
    slabs = [np.where(at == 0.0, outer.vertices, at + 0.05 * outer.vertices) for at in walls]
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda vertices, faces, *_: slabs[: len(faces) // 4])
    pieces = convex_pieces(joined(outer, turned_inside_out(inner)))
    inside = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 3))
    assert np.min([outside(piece, inside) for piece in pieces], axis=0).min() > 0.0
    assert len(pieces) == 6


def test_how_far_pieces_stick_out_is_logged(
    gate: Mesh, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda vertices, *_: [vertices])
    convex_pieces(gate)
    convex_pieces(gate)
    # The doorway is two wide and two high: its middle is one away from the nearest post.
    said = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(said) == 2
    for words in said:
        assert "28 triangles and 4 m became 1 convex piece, sticking out of it by up to" in words
        assert float(words.rsplit(" ", 2)[1]) == pytest.approx(1000, rel=0.05)


# ---- the cache ---------------------------------------------------------------------------


def same(one: list[Mesh], other: list[Mesh]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a.vertices, b.vertices) and np.array_equal(a.faces, b.faces)
        for a, b in zip(one, other, strict=True)
    )


def test_pieces_are_made_once_and_read_back_equal(gate: Mesh, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = convex_pieces(gate)
    (file,) = own_cache.iterdir()
    assert file.suffix == ".npz"
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda *_: pytest.fail("made twice"))
    assert same(convex_pieces(gate), first)


def test_another_mesh_has_another_entry(gate: Mesh, own_cache: Path) -> None:
    convex_pieces(gate)
    convex_pieces(Mesh(gate.vertices * 1.001, gate.faces))
    assert len(list(own_cache.glob("*.npz"))) == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "pickled", "wrong arrays", "a folder"])
def test_a_damaged_entry_is_made_anew(
    gate: Mesh, own_cache: Path, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pieces = [convex_hull(gate.vertices)]
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda vertices, *_: [vertices])
    first = convex_pieces(gate)
    assert same(first, pieces)
    (file,) = own_cache.glob("*.npz")
    data = file.read_bytes()
    if damage == "cut":
        file.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        middle = len(data) // 3
        file.write_bytes(data[:middle] + bytes(255 - b for b in data[middle : middle + 40]) + data[middle + 40 :])
    elif damage == "empty":
        file.write_bytes(b"")
    elif damage == "pickled":
        np.savez(file, vertices0=np.array([{"a": 1}], dtype=object))
    elif damage == "wrong arrays":
        np.savez(file, vertices0=np.zeros((4, 3)), faces1=np.zeros((1, 3)))
    else:
        file.unlink()
        file.mkdir()
    assert same(convex_pieces(gate), first)


def test_a_cache_that_cannot_be_written_costs_nothing_but_time(
    gate: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_text("not a folder")
    monkeypatch.setenv("RR1PLAN_CACHE", str(in_the_way))
    monkeypatch.setattr(convex_decomposition, "coacd_pieces", lambda vertices, *_: [vertices])
    assert len(convex_pieces(gate)) == 1
    assert in_the_way.read_text() == "not a folder"


def test_a_failed_write_leaves_nothing_behind(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", fail)
    store_cached("key", {"a": np.zeros(3)})
    assert list(own_cache.iterdir()) == []
    assert load_cached("key") is None


def test_the_folder_is_the_environments_or_the_platforms(
    tmp_path: Path, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cache_folder() == own_cache
    monkeypatch.delenv("RR1PLAN_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "rr1plan"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # ignored, as the specification demands
    assert cache_folder() == Path.home() / ".cache" / "rr1plan"
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_folder().parts[-3:] == ("Library", "Caches", "rr1plan")
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert cache_folder() == tmp_path / "rr1plan" / "cache"


def test_the_key_knows_content_kind_and_shape() -> None:
    a = np.arange(6.0)
    keys = {
        cache_key("x", a),
        cache_key("y", a),
        cache_key("x", a + 1),
        cache_key("x", a.reshape(2, 3)),
        cache_key("x"),
    }
    assert len(keys) == 5
    assert cache_key("x", a) == cache_key("x", a.copy())
    assert os.sep not in cache_key("x")


def test_a_disc_of_many_corners_is_no_fan_that_coal_cannot_count() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 601)[:-1]
    rim = 0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate([np.insert(rim, 2, z, axis=1) for z in (0.0, 0.05)])
    hull = convex_hull(points)
    a, b, c = (hull.vertices[hull.faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    side = np.linalg.norm(rim[1] - rim[0])
    disc = 0.5 * 600 * 0.01 * np.sin(2.0 * np.pi / 600)
    assert area == pytest.approx(2.0 * disc + 600 * side * 0.05)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(disc * 0.05)
    scene = rp.load_scene("rr1_table").with_obstacle("drum", hull, [0.3, 0.3, 0.1])
    assert rp.CollisionChecker(scene).is_free(scene.configuration())
    waypoints = np.array([scene.configuration(), scene.configuration() + 0.05])
    assert rp.certify_path(rp.Path(scene.joint_names(), waypoints), scene).valid


def test_a_corner_that_coal_cannot_hold_is_an_input_error() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 301)[:-1]
    rim = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    with pytest.raises(InputError, match="neighbors"):
        convex_hull(np.concatenate([rim, [[0.0, 0.0, 1.0]]]))
