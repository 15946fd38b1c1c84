"""Dragging in a real browser: links, tools, obstacles, start and goal, and motions that the page plans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from drawn_links import wander

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return next(iter(rp.load_problems("rr1_cluttered").values()))


@pytest.fixture(scope="module")
def page_file(problem: rp.Problem, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    motion = rp.plan_motion(problem, rng=0)
    assert motion.report is not None
    assert motion.report.certified
    file = tmp_path_factory.mktemp("editing") / "motion.html"
    return motion.save_html(file, options=rp.ViewOptions(play=False))


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    """The page in its initial state, paused, drawn coarsely so that frames are fast."""
    wait_until(opened.page, "RR1.planner || RR1.noPlanner")
    assert opened.ask("RR1.noPlanner") == ""
    opened.resize(960, 640)
    opened.page.mouse.up()
    opened.ask(
        """() => {
        const { editing } = RR1;
        RR1.pause();
        document.body.classList.remove("bare");
        if (RR1.plots.open) RR1.plots.toggle();
        delete editing.background.run;
        if (!document.getElementById("report").hidden) document.getElementById("badge").click();
        if (editing.changed) editing.reset();
        Object.assign(editing, { past: [], future: [], planOnDrop: false, lastEdit: null });
        editing.open(false);
        editing.select({ kind: "tool", arm: 0 });
        document.activeElement.blur();
        RR1.seek(0.5);
        RR1.look(RR1.document.camera.direction);
        for (let i = 0; i < 500; i++) RR1.stage.controls.update(); // until rounding does not move the camera
    }"""
    )
    frames(opened)
    yield opened
    assert opened.complaints == []
    assert len(opened.requests) == 1


def frames(tab: Any, count: int = 2) -> None:
    """Wait until some more frames are drawn."""
    wait_until(tab.page, f"RR1.frames > {tab.ask('RR1.frames')} + {count}")


def seen_at(tab: Any, point: Any) -> tuple[float, float]:
    """Position of a point of the world in the window [px]."""
    ask = "([x, y, z]) => { const s = RR1.editing.picker.project({ x, y, z }); return [s.x, s.y]; }"
    x, y = tab.ask(ask, list(point))
    return x, y


def drag(tab: Any, start: tuple[float, float], by: tuple[float, float]) -> None:
    mouse = tab.page.mouse
    mouse.move(*start)
    mouse.down()
    mouse.move(start[0] + by[0], start[1] + by[1], steps=4)
    frames(tab)
    mouse.up()
    frames(tab)


def drag_handle(tab: Any, name: str, by: tuple[float, float]) -> None:
    box = tab.page.locator(f".handle.{name}").bounding_box()
    drag(tab, (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), by)


def grab_point(tab: Any, element: str) -> tuple[float, float]:
    """A point of the window at which an element is visible and no card covers it."""
    found = tab.ask(
        """element => {
        const pane = RR1.stage.pane.getBoundingClientRect();
        // Beside the tool's handle, which shows as soon as the mouse comes.
        const { editing } = RR1, hits = [];
        const tool = editing.picker.project(editing.hands.handles.place({ kind: "tool", arm: editing.arm }));
        for (let x = 4; x < pane.width; x += 8) for (let y = 4; y < pane.height; y += 8) {
            const hit = RR1.editing.picker.at({ clientX: x, clientY: y });
            if (Math.hypot(x - tool.x, y - tool.y) < 30) continue;
            if (hit && hit.element === element && document.elementFromPoint(x, y).closest("#pane")) hits.push([x, y]);
        }
        return hits[hits.length >> 1] || null;
    }""",
        element,
    )
    assert found, f"{element} is not seen"
    return found[0], found[1]


def q_of(tab: Any) -> np.ndarray:
    return np.array(tab.ask("Array.from(RR1.q)"))


def place_of(tab: Any, name: str) -> np.ndarray:
    """T_world_obstacle on the page, shape (4, 4)."""
    return np.reshape(tab.ask("name => Array.from(RR1.editing.poses.get(name))", name), (4, 4)).T


def scene_of(tab: Any, scene: rp.Scene) -> rp.Scene:
    """The scene with the poses of obstacles on the page."""
    for name in scene.obstacles:
        scene = scene.with_obstacle_at(name, place_of(tab, name))
    return scene


def played(tab: Any, problem: rp.Problem) -> rp.Trajectory:
    """The motion in the page's player."""
    row = tab.ask(
        """() => {
        const { track } = RR1.player, { pieces, terms, width } = track;
        const [breaks, numbers] = [track.breaks, track.coefficients].map((values) => Array.from(values));
        return { breaks, numbers, columns: track.columns, shape: [pieces, terms, width] };
    }"""
    )
    names = [problem.scene.joint_names()[c] for c in row["columns"]]
    return rp.Trajectory(names, row["breaks"], np.reshape(row["numbers"], row["shape"]))


def verdict(tab: Any) -> tuple[str, str]:
    frames(tab)
    state, more = (tab.page.inner_text(f"#verdict > {tag}") for tag in ("b", "span"))
    return state, more


# ---- what the page computes ----------------------------------------------------------------------


def test_what_is_picked_is_what_rays_of_three_js_meet(calm: Any) -> None:
    pairs = calm.ask(
        """() => {
        const { THREE, world, stage } = RR1, pane = stage.pane.getBoundingClientRect(), found = [];
        const sets = [world.robots, world.obstacles].flatMap((bodies) => bodies.sets);
        const meshes = new Map(sets.map((set) => [set.drawn, set]));
        world.detail.levels.fill(0);
        world.detail.version += 1;
        world.place();
        for (const mesh of meshes.keys()) mesh.updateMatrixWorld(true);
        const caster = new THREE.Raycaster();
        for (let x = 13; x < pane.width; x += 23) for (let y = 17; y < pane.height; y += 19) {
            caster.setFromCamera(new THREE.Vector2(2 * x / pane.width - 1, 1 - 2 * y / pane.height), stage.camera);
            const hits = [...meshes.keys()].flatMap((mesh) => caster.intersectObject(mesh, false));
            hits.sort((a, b) => a.distance - b.distance);
            const own = RR1.editing.picker.at({ clientX: pane.left + x, clientY: pane.top + y });
            const first = hits.filter(({ distance }) => distance < hits[0].distance + 2e-3);
            const near = first.map(({ object, instanceId }) => meshes.get(object).items[instanceId].element);
            found.push([own && own.element, near]);
        }
        return found;
    }"""
    )
    assert sum(bool(near) for _, near in pairs) > 100
    assert len({own for own, _ in pairs}) > 8
    wrong = [(own, near) for own, near in pairs if (own not in near if near else own is not None)]
    assert wrong == []


def test_points_are_projected_by_the_camera_as_it_is_even_before_the_next_frame(calm: Any) -> None:
    before, at_once, later = calm.ask(
        """() => {
        const at = () => { const { x, y } = RR1.editing.picker.project({ x: 0.1, y: 0.2, z: 0.3 }); return [x, y]; };
        const found = [at()];
        RR1.look([0.2, 1, 0.5]);
        found.push(at());
        RR1.stage.camera.updateMatrixWorld();
        return [...found, at()];
    }"""
    )
    assert at_once == later != before


def test_jacobian_and_manipulability_agree_with_ours(calm: Any, problem: rp.Problem) -> None:
    kinematics = rp.Kinematics(problem.scene)
    frame = f"{problem.arms[0]}/tool"
    low, high = np.array(calm.ask("RR1.limits")).T
    for q in np.random.default_rng(3).uniform(low, high, (20, len(low))):
        ask = """q => {
            const solver = RR1.editing.solver(0);
            return [solver.manipulability(q), Array.from(solver.jacobian(q)), Array.from(solver.toolPose(q))];
        }"""
        size, columns, pose = calm.ask(ask, q.tolist())
        np.testing.assert_allclose(np.reshape(columns, (-1, 6)).T, kinematics.jacobian(q, frame), atol=1e-9)
        np.testing.assert_allclose(np.reshape(pose, (4, 4)).T, kinematics.pose(q, frame), atol=1e-9)
        assert size == pytest.approx(kinematics.manipulability(q, frame), abs=1e-12)


def test_the_tool_follows_to_poses_nearby_and_stays_within_limits(calm: Any, problem: rp.Problem) -> None:
    kinematics = rp.Kinematics(problem.scene)
    frame = f"{problem.arms[0]}/tool"
    low, high = np.array(calm.ask("RR1.limits")).T
    rng = np.random.default_rng(4)
    solve = """([q, target]) => {
        const { q: found, off, turned } = RR1.editing.solver(0).solve(Float64Array.from(q), Float64Array.from(target));
        return [Array.from(found), off, turned];
    }"""
    reached = 0
    for q in rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), (30, len(low))):
        near = np.clip(q + rng.normal(0.0, 0.05, len(q)), low, high)
        target = kinematics.pose(near, frame)
        found, off, turned = calm.ask(solve, [q.tolist(), target.T.ravel().tolist()])
        assert np.all((low <= found) & (found <= high))
        T = kinematics.pose(found, frame)
        assert np.linalg.norm(T[:3, 3] - target[:3, 3]) == pytest.approx(off, abs=1e-9)
        assert rp.transforms.rotation_angle(T[:3, :3].T @ target[:3, :3]) == pytest.approx(turned, abs=1e-6)
        reached += off < 1e-4 and turned < 1e-3
    assert reached >= 27


def test_the_page_judges_configurations_as_the_checker_does(calm: Any, problem: rp.Problem) -> None:
    checker = rp.CollisionChecker(problem.scene)
    low, high = np.array(calm.ask("RR1.limits")).T
    tones = []
    for q in np.random.default_rng(5).uniform(low, high, (40, len(low))):
        judged = calm.ask("q => RR1.editing.judge(Float64Array.from(q))", q.tolist())
        touching = {frozenset(pair) for pair in judged["touching"]}
        assert touching == {frozenset((c.a, c.b)) for c in checker.contacts(q)}
        for pair in judged["touching"][:2]:
            assert " and ".join(pair) in judged["text"]
        tones.append(judged["tone"])
    assert {"good", "bad"} <= set(tones)
    over = calm.ask("q => RR1.editing.judge(Float64Array.from(q))", (high + 0.1).tolist())
    assert (over["tone"], over["title"]) == ("bad", "Out of limits")
    assert problem.scene.joint_names()[0] in over["text"]


# ---- drags ---------------------------------------------------------------------------------------


def test_dragging_a_link_turns_its_joint(calm: Any) -> None:
    before = q_of(calm)
    camera = calm.ask("RR1.stage.camera.position.toArray()")
    x, y = grab_point(calm, "rr1/elbow_link")
    ask = "([x, y]) => RR1.editing.hands.thingAt(RR1.editing.picker.at({ clientX: x, clientY: y })).local.toArray()"
    local, frame = calm.ask(ask, [x, y]), "rr1/elbow_link"
    # To where turning the joint brings the point.
    column = calm.ask("RR1.joints").index("rr1/elbow_joint")
    there = before.copy()
    there[column] += 0.15
    T = np.reshape(calm.ask("q => RR1.poses(q)['rr1/elbow_link']", there.tolist()), (4, 4)).T
    goal = seen_at(calm, (T @ [*local, 1.0])[:3])
    assert np.hypot(goal[0] - x, goal[1] - y) > 4
    drag(calm, (x, y), (goal[0] - x, goal[1] - y))
    assert np.flatnonzero(q_of(calm) != before).tolist() == [column]
    T = np.reshape(calm.ask("name => RR1.linkPose(name)", frame), (4, 4)).T
    now = seen_at(calm, (T @ [*local, 1.0])[:3])
    assert np.hypot(now[0] - goal[0], now[1] - goal[1]) < 2
    # A roll, whose links hardly move in the picture, turns with the pointer too.
    drag(calm, grab_point(calm, "rr1/wrist_link"), (12, 9))
    assert len(np.flatnonzero(q_of(calm) != before)) == 2
    calm.page.keyboard.press("Control+z")
    assert calm.ask("RR1.stage.camera.position.toArray()") == camera
    assert calm.page.locator("#editing").is_visible()
    assert verdict(calm)[0] in ("Free", "Touching")
    calm.page.keyboard.press("Control+z")
    np.testing.assert_array_equal(q_of(calm), before)


def test_dragging_the_tool_moves_it_in_the_plane_of_the_view(calm: Any, problem: rp.Problem) -> None:
    kinematics = rp.Kinematics(problem.scene)
    frame = f"{problem.arms[0]}/tool"
    calm.ask("RR1.editing.open()")
    frames(calm)
    before, forward = q_of(calm), np.array(calm.ask("RR1.editing.picker.axes().forward.toArray()"))
    drag_handle(calm, "tool", (-12, -8))
    T0, T = kinematics.pose(before, frame), kinematics.pose(q_of(calm), frame)
    moved = T[:3, 3] - T0[:3, 3]
    assert np.linalg.norm(moved) > 0.005
    assert abs(moved @ forward) < 1e-4
    np.testing.assert_allclose(T[:3, :3], T0[:3, :3], atol=2e-3)
    shown = calm.page.locator("#readout span").all_inner_texts()
    assert [float(v.replace("−", "-")) for v in shown[:3]] == pytest.approx(T[:3, 3], abs=6e-4)
    assert float(shown[6]) == pytest.approx(kinematics.manipulability(q_of(calm), frame), rel=1e-2)


def test_a_tool_dragged_too_far_says_how_far_it_falls_short(calm: Any) -> None:
    calm.ask("RR1.editing.open()")
    frames(calm)
    low, high = np.array(calm.ask("RR1.limits")).T
    drag_handle(calm, "lift", (0, -150))
    state, more = verdict(calm)
    q = q_of(calm)
    assert np.all((low - 1e-12 <= q) & (q <= high + 1e-12))
    assert state == "Touching" or (state == "Out of reach" and "short" in more)
    off = calm.ask("RR1.editing.reach.off")
    assert off > 0.005


def test_an_obstacle_moves_on_its_plane_up_and_around(calm: Any, problem: rp.Problem) -> None:
    before = place_of(calm, "ball")
    drag(calm, grab_point(calm, "ball"), (-40, 12))
    moved = place_of(calm, "ball")
    assert np.linalg.norm(moved[:2, 3] - before[:2, 3]) > 0.02
    assert moved[2, 3] == before[2, 3]
    assert calm.page.inner_text("#badge") == "Obstacles moved: not checked"
    drawn = calm.ask("RR1.world.boxAround('ball').getCenter(new RR1.THREE.Vector3()).toArray()")
    np.testing.assert_allclose(drawn, moved[:3, 3], atol=2e-3)
    np.testing.assert_array_equal(np.reshape(calm.ask("Array.from(RR1.planner.obstaclePose('ball'))"), (4, 4)).T, moved)
    drag_handle(calm, "lift", (0, -30))
    lifted = place_of(calm, "ball")
    np.testing.assert_array_equal(lifted[:2, 3], moved[:2, 3])
    assert lifted[2, 3] > moved[2, 3] + 0.01
    calm.ask("RR1.editing.select({ kind: 'obstacle', arm: -1, name: 'crate', element: 'crate' })")
    frames(calm)
    crate = place_of(calm, "crate")
    drag_handle(calm, "turn", (40, 0))
    turned = place_of(calm, "crate")
    np.testing.assert_allclose(turned[2], crate[2], atol=1e-12)
    assert np.degrees(np.arccos(np.clip((turned[:3, 0] @ crate[:3, 0]), -1, 1))) == pytest.approx(
        np.degrees(0.32), abs=1
    )
    for expected in (lifted, moved, before):
        calm.page.keyboard.press("Control+z")
        np.testing.assert_array_equal(place_of(calm, "ball"), expected)
    np.testing.assert_array_equal(place_of(calm, "crate"), crate)
    assert calm.page.inner_text("#badge") == "Certified free in continuous time"
    assert not calm.ask("RR1.editing.past.length")
    calm.page.keyboard.press("Control+Shift+z")
    np.testing.assert_array_equal(place_of(calm, "ball"), moved)
    calm.page.keyboard.press("o")
    np.testing.assert_array_equal(place_of(calm, "ball"), before)


def test_drags_beside_arms_and_of_what_they_stand_on_turn_the_camera(calm: Any) -> None:
    bench = place_of(calm, "bench")
    for start in (grab_point(calm, "bench"), (calm.page.viewport_size["width"] - 330, 20)):
        before, q = calm.ask("RR1.stage.camera.position.toArray()"), q_of(calm)
        drag(calm, start, (50, 10))
        assert calm.ask(f"RR1.stage.camera.position.distanceTo(new RR1.THREE.Vector3(...{before}))") > 0.02
        np.testing.assert_array_equal(q_of(calm), q)
    np.testing.assert_array_equal(place_of(calm, "bench"), bench)
    calm.ask("RR1.stage.turned = false; RR1.look()")
    # A click selects what the arm stands on; then its handles move it.
    calm.page.mouse.click(*grab_point(calm, "bench"))
    frames(calm)
    drag_handle(calm, "lift", (0, 20))
    assert place_of(calm, "bench")[2, 3] < bench[2, 3]


def test_fingers_drag_and_two_of_them_turn_the_camera(calm: Any) -> None:
    session = calm.page.context.new_cdp_session(calm.page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        spots = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": spots})

    x, y = grab_point(calm, "rr1/upper_arm_link")
    q = q_of(calm)
    touch("touchStart", (x, y))
    touch("touchMove", (x + 10, y + 10))
    touch("touchMove", (x + 20, y + 20))
    frames(calm)
    touch("touchEnd")
    frames(calm)
    assert np.count_nonzero(q_of(calm) != q) == 1
    moved = q_of(calm)
    far = calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)")
    x, y = grab_point(calm, "rr1/upper_arm_link")
    touch("touchStart", (x, y))
    touch("touchStart", (x, y), (x + 40, y))
    for spread in (60, 90, 130):
        touch("touchMove", (x - spread / 2, y), (x + spread, y))
        frames(calm)
    touch("touchEnd")
    frames(calm)
    np.testing.assert_array_equal(q_of(calm), moved)
    assert calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)") < 0.9 * far
    # The camera also has the second finger, on a link, if it has the first one, beside the arm.
    calm.ask("RR1.look()")
    calm.next_frames()
    far = calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)")
    x, y = grab_point(calm, "rr1/upper_arm_link")
    touch("touchStart", (30, 300))
    touch("touchStart", (30, 300), (x, y))
    for spread in (20, 40, 60, 80):
        touch("touchMove", (30, 300), (x + spread, y))
        frames(calm)
    touch("touchEnd")
    frames(calm)
    np.testing.assert_array_equal(q_of(calm), moved)
    assert calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)") < 0.95 * far
    calm.ask("RR1.stage.turned = false")


@pytest.mark.parametrize("end", ["touchCancel", "touchStart"])
def test_a_drag_that_is_canceled_or_given_to_the_camera_cannot_be_redone(calm: Any, end: str) -> None:
    session = calm.page.context.new_cdp_session(calm.page)
    q, (x, y) = q_of(calm), grab_point(calm, "rr1/upper_arm_link")
    for kind, shift in [("touchStart", 0), ("touchMove", 10), ("touchMove", 20)]:
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x + shift, "y": y + shift}]})
    frames(calm)
    assert np.any(q_of(calm) != q)
    fingers = [{"x": x + 20, "y": y + 20, "id": 0}, {"x": x + 60, "y": y + 20, "id": 1}]
    session.send("Input.dispatchTouchEvent", {"type": end, "touchPoints": fingers if end == "touchStart" else []})
    frames(calm)
    if end == "touchStart":
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    np.testing.assert_array_equal(q_of(calm), q)
    calm.page.keyboard.press("Control+y")
    np.testing.assert_array_equal(q_of(calm), q)


def test_what_touches_is_red_and_named(calm: Any, problem: rp.Problem) -> None:
    checker = rp.CollisionChecker(problem.scene)
    low, high = np.array(calm.ask("RR1.limits")).T
    q = next(q for q in np.random.default_rng(1).uniform(low, high, (200, len(low))) if not checker.is_free(q))
    calm.ask("q => { RR1.editing.open(); RR1.editing.setQ(Float64Array.from(q)); }", q.tolist())
    state, more = verdict(calm)
    pair = next((c.a, c.b) for c in checker.contacts(q))
    assert state == "Touching"
    assert set(calm.ask("RR1.touched")) == {name for c in checker.contacts(q) for name in (c.a, c.b)}
    assert any(" and ".join(p) in more for p in (pair, pair[::-1]))
    # On its motion the arm touches nothing.
    calm.ask("RR1.seek(0.5)")
    assert calm.ask("RR1.touched") == []


# ---- plans ---------------------------------------------------------------------------------------


def test_a_plan_around_a_moved_obstacle_is_valid_for_the_referee(calm: Any, problem: rp.Problem) -> None:
    middle = np.array(calm.ask("Array.from(RR1.at(0.5 * RR1.duration))"))
    tool = rp.Kinematics(problem.scene).pose(middle, "rr1/tool")[:3, 3]
    T = place_of(calm, "ball")
    T[:3, 3] = tool
    calm.ask("T => { RR1.editing.remember(null); RR1.editing.moveObstacle('ball', T); }", T.T.ravel().tolist())
    scene = scene_of(calm, problem.scene)
    original = played(calm, problem)
    assert "collision" in {v.kind for v in rp.validate(original, scene).violations}
    calm.page.keyboard.press("p")
    calm.wait_for_plan()
    assert calm.ask("RR1.playing")
    assert calm.page.inner_text("#badge") == "Planned here, certified free"
    assert calm.page.inner_text("#answer").startswith("Certified motion of ")
    assert "Planned here" in calm.page.inner_text("#facts")
    motion = played(calm, problem)
    report = rp.validate(motion, scene, problem)
    assert report.certified, str(report)
    assert calm.ask("RR1.duration") == pytest.approx(motion.duration)
    wait_until(calm.page, "Boolean(RR1.document.report.margins.clearance)")
    least = calm.ask("RR1.document.report.margins.clearance.value")
    shown = report.margins
    assert least >= min(shown["clearance"].value, shown["self_clearance"].value) - 1e-4
    calm.page.keyboard.press("o")
    assert calm.page.inner_text("#badge") == "Certified free in continuous time"
    np.testing.assert_array_equal(played(calm, problem).coefficients, original.coefficients)


def test_the_report_stays_open_while_the_least_clearance_is_measured(calm: Any) -> None:
    calm.ask("() => { RR1.editing.background.run = () => new Promise((done) => { window.measured = done; }); }")
    assert calm.ask("RR1.editing.plan().then((answer) => answer.certified)")
    calm.page.click("#badge")
    assert "the least of" not in calm.page.inner_text("#report")
    calm.ask("() => window.measured({ value: 0.0123, time: 0.1 })")
    wait_until(calm.page, "document.getElementById('facts').textContent.includes('12.3 mm')")
    assert "the least of" in calm.page.inner_text("#report")
    assert calm.page.locator("#report").is_visible()


def test_start_and_goal_by_hand(calm: Any, problem: rp.Problem) -> None:
    checker = rp.CollisionChecker(problem.scene)
    low, high = np.array(calm.ask("RR1.limits")).T
    free = [q for q in np.random.default_rng(8).uniform(low, high, (400, len(low))) if checker.is_free(q)][:2]
    for q, key in zip(free, "az", strict=True):
        calm.ask("q => RR1.editing.setQ(Float64Array.from(q))", q.tolist())
        calm.page.keyboard.press(key)
    ghosts = calm.ask("RR1.world.still.map(({ kind, poses }) => [kind, Array.from(poses)])")
    for kind, q in zip(("start", "goal"), free, strict=True):
        poses = problem.scene.link_poses(problem.scene.split(q))
        drawn = np.reshape(dict(ghosts)[kind], (-1, 4, 4)).transpose(0, 2, 1)
        np.testing.assert_allclose(drawn, list(poses.values()), atol=1e-6)
    calm.page.click(".act.plan")
    calm.wait_for_plan()
    motion = played(calm, problem)
    np.testing.assert_allclose(motion(motion.breaks[0]), free[0], atol=1e-9)
    np.testing.assert_allclose(motion(motion.breaks[-1]), free[1], atol=1e-9)
    assert rp.validate(motion, problem.scene).certified
    first = calm.ask("RR1.document.planned")
    calm.page.keyboard.press("p")
    calm.wait_for_plan()
    assert "seed 0" in first
    assert "seed 1" in calm.ask("RR1.document.planned")


def test_a_goal_that_touches_is_refused_by_name(calm: Any, problem: rp.Problem) -> None:
    checker = rp.CollisionChecker(problem.scene)
    low, high = np.array(calm.ask("RR1.limits")).T
    q = next(q for q in np.random.default_rng(2).uniform(low, high, (200, len(low))) if not checker.is_free(q))
    names = next((c.a, c.b) for c in checker.contacts(q))
    before = calm.ask("RR1.duration")
    calm.ask("q => RR1.editing.setQ(Float64Array.from(q))", q.tolist())
    calm.page.keyboard.press("z")
    said = calm.page.inner_text("#answer")
    assert said.startswith("Goal set, but it touches: ")
    calm.page.keyboard.press("p")
    calm.wait_for_plan()
    said = calm.page.inner_text("#answer")
    assert said.startswith("Goal is not valid: ")
    assert all(name in said for name in names)
    assert not calm.ask("RR1.playing")
    assert calm.ask("RR1.duration") == before
    assert calm.page.inner_text("#badge") == "Certified free in continuous time"


def test_a_dropped_obstacle_plans_at_once_if_wanted(calm: Any, problem: rp.Problem) -> None:
    calm.ask("RR1.editing.open()")
    calm.page.click(".act.drop")
    drag(calm, grab_point(calm, "ball"), (-20, 10))
    calm.wait_for_plan()
    assert calm.ask("RR1.playing")
    assert calm.page.inner_text("#badge") == "Planned here, certified free"
    assert rp.validate(played(calm, problem), scene_of(calm, problem.scene), problem).certified


# ---- keys ----------------------------------------------------------------------------------------


def test_everything_moves_by_keyboard(calm: Any, problem: rp.Problem) -> None:
    kinematics = rp.Kinematics(problem.scene)
    press, frame = calm.page.keyboard.press, f"{problem.arms[0]}/tool"
    press("m")
    assert calm.page.locator("#editing").is_visible()
    press("j")
    focused = "document.activeElement.getAttribute('aria-label')"
    assert calm.ask(focused).startswith("Move the tool of rr1")
    T0 = kinematics.pose(q_of(calm), frame)
    press("PageDown")
    moved = kinematics.pose(q_of(calm), frame)[:3, 3] - T0[:3, 3]
    np.testing.assert_allclose(moved, [0, 0, -0.01], atol=2e-4)
    press("j")
    assert calm.ask(focused).startswith(f"Turn {problem.scene.joint_names()[0]}")
    q = q_of(calm)
    press("ArrowRight")
    press("Shift+ArrowRight")
    assert q_of(calm)[0] - q[0] == pytest.approx(np.radians(12))
    np.testing.assert_array_equal(q_of(calm)[1:], q[1:])
    for _ in range(2):
        press("Shift+j")
    names = calm.ask("RR1.document.obstacles.map(({ name }) => name)")
    assert calm.ask(focused).startswith(f"Move {names[-1]}")
    before = place_of(calm, names[-1])
    press("ArrowRight")
    press("PageUp")
    moved = place_of(calm, names[-1])[:3, 3] - before[:3, 3]
    assert sorted(np.abs(moved).round(6)) == [0, 0.01, 0.01]
    assert moved[2] == pytest.approx(0.01)
    time = calm.ask("RR1.time")
    press("Escape")
    press("ArrowRight")
    assert calm.ask("RR1.time") == pytest.approx(time + 1 / 60)
    press("Escape")
    assert calm.page.locator("#editing").is_hidden()


def test_every_button_of_the_card_has_a_name_and_reach(calm: Any) -> None:
    calm.ask("RR1.editing.open()")
    frames(calm)
    nameless = """() => [...document.querySelectorAll("#editing button, .handle:not([hidden]), #edit")]
        .filter((b) => !(b.getAttribute("aria-label") || b.textContent.trim()) || b.tabIndex < 0)
        .map((b) => b.className)"""
    assert calm.ask(nameless) == []
    assert calm.ask("getComputedStyle(document.querySelector('.handle.tool')).touchAction") == "none"


# ---- pages of other kinds ------------------------------------------------------------------------


def test_bare_pages_and_pictures_have_no_handles(calm: Any) -> None:
    calm.ask("RR1.editing.open(), document.body.classList.add('bare')")
    frames(calm)
    visible = "[...document.querySelectorAll('.handle, #editing, #tip')].some((node) => node.offsetParent !== null)"
    assert not calm.ask(visible)
    calm.ask("document.body.classList.remove('bare')")
    assert calm.ask(visible)


def test_a_page_without_a_planner_says_so_and_can_be_moved(
    tab: Any, rr1: rp.Robot, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    two_arms = rp.Scene().with_arm("left", rr1).with_arm("right", planar2r, [-0.5, 0.0, 0.0])
    two_arms = two_arms.with_obstacle("ground", rp.HalfSpace()).with_obstacle("ball", rp.Sphere(0.08), [0.0, 0.4, 0.3])
    options = rp.ViewOptions(play=False, planner=False)
    tab.open(rp.save_html(tmp_path / "page.html", two_arms, trajectory=wander(two_arms), options=options))
    q = q_of(tab)
    drag(tab, grab_point(tab, "left/upper_arm_link"), (12, 12))
    assert np.count_nonzero(q_of(tab) != q) == 1
    assert verdict(tab) == ("Within limits", "collisions not checked: this page was made without a planner")
    tab.page.keyboard.press("p")
    assert tab.page.inner_text("#answer") == "Cannot plan here: this page was made without a planner."
    before = tab.ask("Array.from(RR1.editing.poses.get('ball'))")
    drag(tab, grab_point(tab, "ball"), (20, 0))
    assert tab.ask("Array.from(RR1.editing.poses.get('ball'))") != before
    assert not tab.ask("RR1.editing.canMove('ground')")
    assert tab.complaints == []


def test_a_browser_without_vectors_says_so(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script("WebAssembly.validate = () => false;")
    tab.open(page_file)
    wait_until(tab.page, "RR1.noPlanner")
    tab.page.keyboard.press("p")
    assert tab.page.inner_text("#answer") == "Cannot plan here: this browser has no WebAssembly SIMD."
    assert tab.complaints == []


def test_where_nothing_can_be_touched_no_clearance_is_stated(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    problem = rp.Problem(scene, [0.0, 0.0], [1.4, 0.3])
    tab.open(rp.save_html(tmp_path / "problem.html", scene, problem=problem))
    wait_until(tab.page, "RR1.planner || RR1.noPlanner")
    tab.page.keyboard.press("p")
    tab.wait_for_plan()
    assert tab.ask("RR1.document.report.certified")
    wait_until(tab.page, "document.getElementById('answer').textContent.includes('nothing to touch')")
    assert tab.ask("RR1.document.report.margins") == {}
    assert tab.ask("q => RR1.editing.judge(Float64Array.from(q))", [0.0, 0.0])["text"] == "nothing to touch"
    shown = tab.page.inner_text("body")
    assert "Planned here" in shown
    assert "Infinity" not in shown
    assert "nothing to touch" in shown
    assert tab.complaints == []


def test_a_problem_without_a_motion_is_planned_and_played(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("box", rp.Box((0.1, 0.1, 0.2)), [0.45, 0.25, 0.0])
    problem = rp.Problem(scene, [0.0, 0.0], rp.JointGoal([1.4, 0.3]))
    tab.open(rp.save_html(tmp_path / "problem.html", scene, problem=problem))
    wait_until(tab.page, "RR1.planner || RR1.noPlanner")
    tab.page.keyboard.press("p")
    tab.wait_for_plan()
    assert tab.ask("RR1.playing")
    assert tab.page.locator("#play").is_visible()
    motion = played(tab, problem)
    assert rp.validate(motion, scene, problem).certified
    tab.page.keyboard.press("o")
    frames(tab)
    assert tab.page.locator("#play").is_hidden()
    # Two joints cannot keep an orientation: only the position of the tool follows.
    tab.page.keyboard.press("j")
    tab.page.keyboard.press("ArrowUp")
    assert tab.complaints == []


@pytest.mark.parametrize(("bare", "omitted"), [(4, "collisions not checked"), (2, "1 link not checked")])
def test_links_without_a_shape_make_no_motion_certified_free(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath, bare: int, omitted: str
) -> None:
    links = [replace(link, collisions=()) for link in planar2r.links[-bare:]]
    robot = replace(planar2r, links=(*planar2r.links[:-bare], *links))
    scene = rp.Scene().with_arm("arm", robot)
    tab.open(rp.plan_motion(rp.Problem(scene, None, {"arm": [1.0, 0.5]})).save_html(tmp_path / "bare.html"))
    wait_until(tab.page, "RR1.planner")
    assert tab.page.inner_text("#badge") == f"Valid, {omitted}"
    assert tab.page.get_attribute("#badge", "class") == "open"
    assert tab.ask("RR1.editing.judge(RR1.q).tone") == "open"
    tab.ask("RR1.editing.plan()")
    assert tab.page.inner_text("#badge") == f"Planned here, {omitted}"
    assert omitted in tab.page.inner_text("#answer")
    assert tab.page.get_attribute("#answer", "class") == "open"
    tab.page.click("#badge")
    assert "arm/link2" in tab.page.inner_text("#report")
    assert ("collision" in tab.page.inner_text("#report p >> nth=0")) == (bare < 4)
    assert tab.complaints == []


def test_all_texts_have_contrast(calm: Any) -> None:
    calm.ask("RR1.editing.open(), RR1.plots.toggle(), document.getElementById('badge').click()")
    frames(calm)
    for tone in ("good", "open", "bad"):
        calm.ask(
            "tone => (RR1.editing.card.say('An answer.', tone), document.getElementById('verdict').className = tone)",
            tone,
        )
        assert calm.faint_texts() == []


def test_the_name_of_the_tool_stands_apart_from_its_position_on_a_phone(calm: Any) -> None:
    calm.resize(390, 844)
    calm.ask("RR1.editing.open()")
    frames(calm)
    assert calm.page.inner_text("#readout").count("°") == 3
    name, place = calm.ask("[...document.querySelectorAll('#readout > *')].map((e) => e.getBoundingClientRect())")[:2]
    assert name["right"] + 6.0 < place["left"]


def test_the_card_of_edits_covers_neither_the_arms_nor_the_title_on_phones(calm: Any) -> None:
    lowest = """() => {
        RR1.stage.camera.updateMatrixWorld();
        return Math.max(...Object.values(RR1.poses(RR1.q)).map((T) => {
            const p = new RR1.THREE.Vector3(T[12], T[14], -T[13]).project(RR1.stage.camera);
            return (1 - p.y) / 2 * RR1.stage.pane.clientHeight;
        }));
    }"""
    for width, height in ((844, 390), (390, 844)):
        calm.resize(width, height)
        calm.ask("RR1.look(), RR1.editing.isOpen && RR1.editing.toggle(), RR1.plots.toggle()")
        calm.page.keyboard.press("m")
        frames(calm)
        title, card = calm.ask("[title, editing].map((node) => node.getBoundingClientRect().toJSON())")
        assert title["bottom"] < card["top"], (width, height)
        assert calm.ask(lowest) < card["top"], (width, height)
        assert calm.page.locator("#plots").is_hidden()
        calm.page.keyboard.press("m")
        assert calm.page.locator("#plots").is_visible()
        calm.ask("RR1.plots.toggle()")


# The links that the title, the card of edits or the bar cover.
COVERED = """() => {
    const cards = [headline, editing, bar].map((node) => node.getBoundingClientRect());
    return Object.entries(RR1.poses(RR1.q)).filter(([, T]) => {
        const { x, y } = RR1.editing.picker.project({ x: T[12], y: T[13], z: T[14] });
        return cards.some((r) => x > r.left && x < r.right && y > r.top && y < r.bottom);
    }).map(([name]) => name);
}"""


def test_the_card_of_a_plan_covers_no_arm_in_a_low_window(calm: Any) -> None:
    calm.resize(640, 360)
    calm.page.keyboard.press("p")
    wait_until(calm.page, "document.getElementById('answer').textContent.startsWith('Certified')")
    calm.ask("RR1.pause()")
    for t in (0.0, 0.5, 1.0):
        calm.ask("t => RR1.seek(RR1.player.start + t * RR1.duration)", t)
        frames(calm)
        assert calm.ask(COVERED) == [], t


def test_a_card_that_a_drag_opens_covers_no_arm_after_it_in_a_low_window(calm: Any) -> None:
    calm.resize(640, 360)
    drag(calm, grab_point(calm, "rr1/forearm_link"), (10, 5))
    assert calm.page.locator("#editing").is_visible()
    assert calm.ask(COVERED) == []


def test_the_verdict_of_the_motion_is_whole_above_plots_and_the_card_of_edits(calm: Any) -> None:
    calm.ask("document.getElementById('description').textContent = 'A description in two lines. '.repeat(3)")
    calm.ask("RR1.editing.open(), RR1.plots.toggle()")
    frames(calm)
    bottom = "(id) => document.getElementById(id).getBoundingClientRect().bottom"
    badge, head = calm.ask(f"['badge', 'headline'].map({bottom})")
    calm.ask("document.getElementById('description').textContent = RR1.document.description")
    assert badge < head


def test_the_picture_is_framed_above_the_whole_card_of_edits(calm: Any) -> None:
    calm.ask("document.getElementById('readout').replaceChildren()")
    before, after = calm.ask("""async () => {
        const heights = [], measure = () => heights.push(document.getElementById("editing").offsetHeight);
        const { viewer } = RR1.editing, { frame } = viewer;
        viewer.frame = () => { measure(); frame.call(viewer); };
        RR1.editing.toggle();
        delete viewer.frame;
        for (let k = 0; k < 3; k++) await new Promise(requestAnimationFrame);
        measure();
        return heights;
    }""")
    assert before == after


def test_the_buttons_of_edits_are_in_one_row_at_200_percent_zoom(calm: Any) -> None:
    calm.resize(640, 360)
    calm.page.keyboard.press("m")
    frames(calm)
    tops = calm.ask("Array.from(document.querySelectorAll('#acts .act'), (act) => act.offsetTop)")
    assert len(tops) == 6
    assert len(set(tops)) == 1


def test_plots_that_editing_hides_in_the_same_frame_take_no_room_on_phones(calm: Any) -> None:
    calm.resize(844, 390)
    calm.ask("RR1.editing.isOpen && RR1.editing.toggle()")
    frames(calm)
    calm.ask("(RR1.plots.toggle(), RR1.editing.open())")
    frames(calm)
    title, card = calm.ask("[title, editing].map((node) => node.getBoundingClientRect().toJSON())")
    assert title["bottom"] < card["top"]
    calm.ask("RR1.plots.toggle()")


def test_the_picture_stays_under_the_pointer_when_the_window_changes_during_a_drag(calm: Any) -> None:
    x, y = grab_point(calm, "rr1/forearm_link")
    calm.page.mouse.move(x, y)
    calm.page.mouse.down()
    calm.page.mouse.move(x + 20, y + 10)
    frames(calm)
    camera = "RR1.stage.camera.position.toArray()"
    before = calm.ask(camera)
    calm.resize(480, 640)
    frames(calm)
    assert calm.ask(camera) == before
    calm.page.mouse.up()


def test_another_document_ends_a_drag_and_its_label(calm: Any) -> None:
    x, y = grab_point(calm, "rr1/elbow_link")
    calm.page.mouse.move(x, y)
    calm.page.mouse.down()
    calm.page.mouse.move(x + 30, y + 20, steps=3)
    frames(calm)
    assert calm.page.locator("#tip").is_visible()
    calm.ask("RR1.load(RR1.document, true)")
    frames(calm)
    assert calm.page.locator("#tip").is_hidden()
    assert "grabbing" not in calm.ask("document.body.className")


def test_the_report_ends_above_the_card_of_edits(calm: Any) -> None:
    calm.ask("RR1.editing.open(), document.getElementById('badge').click()")
    # A long report, as of an invalid motion.
    calm.ask(
        "document.getElementById('report').append(...Array.from({ length: 40 }, () => document.createElement('p')))"
    )
    bottom, top = calm.ask("[headline.getBoundingClientRect().bottom, editing.getBoundingClientRect().top]")
    assert 0.0 < top - bottom < 60.0
