"""The data sent to the page, tested without a browser."""

from __future__ import annotations

import json
import re
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from packed_arrays import unpacked

import rr1plan as rp
from rr1plan import Panel, pack_array, save_html
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.html_page import growing_lengths, json_for_html, page_html
from rr1plan.report import Margin
from rr1plan.robot.robot import affine_value

NASTY = "</script><script>alert(1)</script> \" ' <!-- \u2028 & <img src=x onerror=alert(2)>"


def quintic(scene: rp.Scene, duration: float = 2.0) -> rp.Trajectory:
    q = scene.configuration()
    coefficients = np.zeros((1, 6, len(q)))
    coefficients[0, 0] = q
    coefficients[0, 3:] = np.outer([10 / duration**3, -15 / duration**4, 6 / duration**5], np.full(len(q), 0.3))
    return rp.Trajectory(scene.joint_names(), np.array([0.0, duration]), coefficients)


def test_a_robot_is_described_once_for_all_its_arms(rr1: rp.Robot) -> None:
    scene = rp.Scene()
    for i in range(5):
        scene = scene.with_arm(f"arm{i}", rr1, [float(i), 0.0, 0.0])
    document = view_document(scene)
    assert len(document["robots"]) == 1
    assert [row["robot"] for row in document["arms"]] == [0] * 5
    assert document["columns"] == list(scene.joint_names())


def test_twelve_arms_stay_small(rr1: rp.Robot) -> None:
    def size(count: int) -> int:
        scene = rp.Scene()
        for i in range(count):
            scene = scene.with_arm(f"arm{i}", rr1, [float(i), 0.0, 0.0])
        return len(json.dumps(view_document(scene, trajectory=quintic(scene))))

    assert size(120) < 4 * size(12) + 120_000


def test_equal_shapes_are_sent_once(rr1_table: rp.Scene) -> None:
    cube = rp.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3]]))
    again = rp.Mesh(cube.vertices.copy(), cube.faces.copy())
    scene = rr1_table.with_obstacle("one", cube).with_obstacle("two", again, [1.0, 0.0, 0.0])
    kinds = [row["kind"] for row in view_document(scene)["shapes"]]
    assert kinds.count("mesh") == 1


def test_every_kind_of_shape_is_sent() -> None:
    tetra = rp.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3]]))
    shapes = [
        rp.Box((1, 2, 3)),
        rp.Sphere(0.5),
        rp.Cylinder(0.1, 0.4),
        rp.Capsule(0.1, 0.4),
        rp.HalfSpace((0, 0, 2), 0.1),
        tetra,
        rp.PointCloud(np.zeros((4, 3)), 0.05),
    ]
    scene = rp.Scene()
    for i, shape in enumerate(shapes):
        scene = scene.with_obstacle(f"thing{i}", shape)
    rows = view_document(scene)["shapes"]
    assert [r["kind"] for r in rows] == ["box", "sphere", "cylinder", "capsule", "halfspace", "mesh", "cloud"]
    assert rows[0]["size"] == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(unpacked(rows[5]["vertices"]), tetra.vertices)
    np.testing.assert_array_equal(unpacked(rows[5]["faces"]), tetra.faces)


def test_a_motion_is_sent_as_its_polynomials(rr1_table: rp.Scene) -> None:
    trajectory = quintic(rr1_table)
    track = view_document(rr1_table, trajectory=trajectory)["track"]
    assert track["exact"]
    assert track["timed"]
    np.testing.assert_allclose(unpacked(track["coefficients"]), trajectory.coefficients, rtol=1e-6)
    np.testing.assert_array_equal(unpacked(track["breaks"]), trajectory.breaks)


def test_a_motion_of_very_many_pieces_is_sent_as_samples(rr1_table: rp.Scene) -> None:
    names = rr1_table.joint_names()
    breaks = np.linspace(0.0, 10.0, 30_001)
    q = 0.2 * np.sin(breaks)[:, None] * np.ones(len(names))
    slopes = np.diff(q, axis=0) / np.diff(breaks)[:, None]
    trajectory = rp.Trajectory(names, breaks, np.stack([q[:-1], slopes, *[np.zeros_like(slopes)] * 3], axis=1))
    track = view_document(rr1_table, trajectory=trajectory)["track"]
    assert not track["exact"]
    times, sent = unpacked(track["breaks"]), unpacked(track["coefficients"])
    assert len(times) < 700
    np.testing.assert_allclose(sent[:, 0], trajectory(times[:-1]), atol=1e-6)


def test_a_path_without_times_is_played_at_a_steady_speed(rr1_table: rp.Scene) -> None:
    q = rr1_table.configuration()
    step = np.zeros(len(q))
    step[0] = 0.5
    path = rp.Path(rr1_table.joint_names(), np.stack([q, q, q + step, q + 3 * step]))
    document = view_document(rr1_table, path=path)
    assert not document["track"]["timed"]
    np.testing.assert_allclose(unpacked(document["track"]["breaks"]), [0.0, 0.5, 1.5])
    assert document["path"]["waypoints"]["shape"] == [4, len(q)]


def test_a_path_of_one_waypoint_stands_still(rr1_table: rp.Scene) -> None:
    path = rp.Path(rr1_table.joint_names(), rr1_table.configuration()[None])
    assert unpacked(view_document(rr1_table, path=path)["track"]["breaks"]).tolist() == [0.0]


def test_unknown_columns_are_refused_with_the_near_name(rr1_table: rp.Scene) -> None:
    arm = next(iter(rr1_table.arms))
    wrong = rp.Trajectory.rest((f"{arm}/elbow_joimt",), [0.0])
    with pytest.raises(rp.UnknownNameError, match="elbow_joint"):
        view_document(rr1_table, trajectory=wrong)


def test_the_goals_and_the_start_are_sent(rr1_table: rp.Scene) -> None:
    problem = rp.Problem(
        rr1_table,
        start="home",
        goal=[
            rp.JointGoal(rr1_table.configuration()),
            rp.PoseGoal("tool", [-0.3, 0.2, 0.2]),
            rp.RegionGoal("tool", [-0.3, 0, 0.1], [-0.2, 0.1, 0.3]),
        ],
    )
    document = view_document(rr1_table, problem=problem)
    assert [g["kind"] for g in document["ghosts"]] == ["start", "goal"]
    assert [t["kind"] for t in document["targets"]] == ["pose", "region"]
    assert document["targets"][0]["pose"][12:15] == [-0.3, 0.2, 0.2]
    assert not document["targets"][0]["turned"]


def test_infinite_margins_do_not_break_the_page(rr1_table: rp.Scene) -> None:
    report = rp.Report((), {"clearance": Margin(float("inf"), "m"), "torque": Margin(float("nan"))}, ("collision",))
    document = view_document(rr1_table, report=report)
    assert document["report"]["margins"]["clearance"]["value"] is None
    assert "clearance" in page_html(document)


def test_mimic_joints_follow_the_planning_joints(rr1: rp.Robot) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = rng.uniform(rr1.limits.lower, rr1.limits.upper)
        values = rr1.joint_values(q)
        for joint in rr1.joints:
            if joint.kind == "fixed":
                continue
            column, factor, offset = affine_value(rr1, joint)
            sent = offset + (0.0 if column < 0 else factor * q[column])
            assert sent == pytest.approx(values[joint.name], abs=1e-12)


def test_lengths_of_style_sheets_grow_except_where_they_cannot() -> None:
    style = "a { width: 12.5px; margin: -3px calc(1em - .5px); } @container (max-width: 600px) { b { } }"
    grown = "a { width: 1.25rem; margin: -0.3rem calc(1em - 0.05rem); } @container (max-width: 60rem) { b { } }"
    assert growing_lengths(style) == grown
    others = ("@media (max-width: 600px) { }", 'a { content: "12px"; }', "#n5px { }", "a { background: url(5px.png); }")
    for style in others:
        assert growing_lengths(style) == style


@settings(deadline=None, max_examples=60)
@given(st.text())
def test_no_text_can_leave_its_script_element(text: str) -> None:
    written = json_for_html({"name": text})
    assert not re.search(r"[<>&]", written)
    assert json.loads(written) == {"name": text}


def test_numbers_and_arrays_of_numpy_are_plain_on_a_page(rr1_table: rp.Scene) -> None:
    data = {"one": np.int64(3), "off": np.float32(0.5), "free": np.bool_(True), "q": np.eye(2)}
    plain = {"one": 3, "off": 0.5, "free": True, "q": [[1.0, 0.0], [0.0, 1.0]]}
    assert json.loads(json_for_html(data)) == plain
    options = rp.ViewOptions(quiet=True, port=0, panels=[Panel("own", "Own", data=data)])
    with rp.show(rr1_table, options=options) as viewer:
        viewer.update_panel("own", data)
        for bad in (np.array([np.nan]), np.array([1j]), {1}):
            with pytest.raises(rp.InputError, match="the page cannot hold this data"):
                viewer.update_panel("own", {"value": bad})


def test_nasty_names_stay_names(rr1: rp.Robot) -> None:
    scene = rp.Scene(name=NASTY, description=NASTY).with_arm("arm", rr1)
    page = page_html(view_document(scene, options=rp.ViewOptions(title=NASTY)))
    assert "<script>alert" not in page
    plain = page_html(view_document(rp.Scene(name="plain").with_arm("arm", rr1)))
    assert page.count("<script") == plain.count("<script")


def test_a_page_forbids_everything_from_outside(rr1_table: rp.Scene) -> None:
    page = page_html(view_document(rr1_table))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert "default-src 'none'" in policy[1].replace("&#x27;", "'")
    assert "unsafe-inline" not in policy[1].split("style-src")[0]
    assert not re.search(r'(src|href)="(https?:)?//', page)


def test_numbers_json_cannot_hold_are_refused(rr1_table: rp.Scene) -> None:
    panel = Panel("mine", "Mine", data={"value": float("nan")})
    with pytest.raises(rp.InputError, match="hold"):
        page_html(view_document(rr1_table), rp.ViewOptions(panels=[panel]))


def test_panels_need_distinct_plain_names(rr1_table: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match="letters"):
        Panel("<b>", "Bad")
    with pytest.raises(rp.InputError, match="unique"):
        page_html(view_document(rr1_table), rp.ViewOptions(panels=[Panel("a", "A"), Panel("a", "B")]))
    with pytest.raises(rp.InputError, match="script"):
        page_html(view_document(rr1_table), rp.ViewOptions(panels=[Panel("a", "A", script="'</script>'")]))


def test_the_same_question_gives_the_same_bytes(rr1_table: rp.Scene, tmp_path: FilePath) -> None:
    one = save_html(tmp_path / "one.html", rr1_table, trajectory=quintic(rr1_table))
    two = save_html(tmp_path / "two.html", rr1_table, trajectory=quintic(rr1_table))
    assert one.read_bytes() == two.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.html", "two.html"]


def test_a_missing_folder_is_named(rr1_table: rp.Scene, tmp_path: FilePath) -> None:
    with pytest.raises(rp.InputError, match="nowhere"):
        save_html(tmp_path / "nowhere" / "page.html", rr1_table)


def test_arrays_are_packed_exactly() -> None:
    values = np.arange(6, dtype=np.float64).reshape(2, 3) / 7.0
    np.testing.assert_array_equal(unpacked(pack_array(values, "f8")), values)
    np.testing.assert_allclose(unpacked(pack_array(values)), values, rtol=1e-7)


# ---- spheres -----------------------------------------------------------------------------


def spheres_sent(document: dict) -> dict[str, list[np.ndarray]]:
    """Levels, centers and radii by names of links of the first robot and of attached objects."""
    (robot,) = document["robots"]
    things = [(robot["links"], robot["spheres"])] + [([a["name"]], a["spheres"]) for a in document["attachments"]]
    sent = {}
    for names, packed in things:
        links, levels, spheres = (unpacked(packed[key]) for key in ("links", "levels", "spheres"))
        for i in np.unique(links):
            sent[names[i]] = [levels[links == i], spheres[links == i, :3], spheres[links == i, 3]]
    return sent


def test_spheres_are_sent_when_asked_for_as_they_are_computed(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("a", rr1).with_arm("b", rr1, [1.0, 0.0, 0.0])
    scene = scene.with_obstacle("rod", rp.Capsule(0.01, 0.2), [0.3, 0.0, 0.5]).attach("rod", "a")
    sent = spheres_sent(view_document(scene, options=rp.ViewOptions(spheres=True)))
    covers = rp.cover_with_spheres(scene)
    expected = {name.removeprefix("a/"): c for name, c in covers.items() if name[0] != "b" and len(c.radii)}
    assert set(sent) == set(expected)
    for name, (levels, centers, radii) in sent.items():
        np.testing.assert_array_equal(levels, expected[name].levels)
        np.testing.assert_array_equal(centers, expected[name].centers)
        np.testing.assert_array_equal(radii, expected[name].radii)


def test_spheres_are_left_out_unless_asked_for(rr1_table: rp.Scene) -> None:
    (robot,) = view_document(rr1_table)["robots"]
    assert robot["spheres"] is None


@pytest.mark.parametrize("wish", ["yes", 1, None, [True]])
def test_a_wish_for_spheres_that_is_neither_yes_nor_no_is_refused(rr1_table: rp.Scene, wish: object) -> None:
    with pytest.raises(rp.InputError, match="spheres is"):
        view_document(rr1_table, options=rp.ViewOptions(spheres=wish))


def test_a_scene_without_arms_has_no_spheres_to_show(tmp_path: FilePath) -> None:
    scene = rp.Scene().with_obstacle("box", rp.Box((0.1, 0.1, 0.1)))
    assert view_document(scene, options=rp.ViewOptions(spheres=True))["robots"] == []
    assert save_html(tmp_path / "page.html", scene, options=rp.ViewOptions(spheres=True)).exists()


def test_a_held_mesh_without_volume_is_named_when_spheres_are_asked_for(rr1: rp.Robot) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    sheet = rp.Mesh(corners, np.array([[0, 1, 2], [1, 3, 2]]))
    scene = rp.Scene().with_arm("arm", rr1).with_obstacle("sheet", sheet).attach("sheet")
    with pytest.raises(rp.InputError, match="around 'sheet'"):
        view_document(scene, options=rp.ViewOptions(spheres=True))
