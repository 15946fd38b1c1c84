"""Curves under the scene and layers on demand, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

# Values of all curves of the motion of the page of a quantity at a time, in the units that are drawn.
VALUES = """([key, t]) => RR1.plots.source.curves(RR1.plots.arm, key).filter((curve) => curve.motion === null)
    .map((curve) => curve.at(t))"""


@pytest.fixture(scope="module")
def motions() -> tuple[rp.MotionPlan, rp.MotionPlan, rp.Replay]:
    """A plan with its tree, one of another seed, and a replay of the first."""
    problem = next(iter(rp.load_problems("rr1_cage").values()))
    plan = rp.plan_motion(problem, rng=1, planner=rp.RrtConnect(tree=True))
    other = rp.plan_motion(problem, rng=5)
    assert plan
    assert other
    return plan, other, rp.simulate(plan.trajectory, problem.scene)


@pytest.fixture(scope="module")
def page_file(
    motions: tuple[rp.MotionPlan, rp.MotionPlan, rp.Replay], tmp_path_factory: pytest.TempPathFactory
) -> FilePath:
    plan, other, replay = motions
    file = tmp_path_factory.mktemp("plots") / "page.html"
    options = rp.ViewOptions(compare={"seed 5": other.trajectory}, play=False)
    return plan.save_html(file, replay=replay, options=options)


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    """The page paused at its start, with its own motion and all curves under the scene."""
    opened.resize(960, 640)
    opened.page.emulate_media(forced_colors="none", color_scheme="light")
    opened.ask(
        """() => {
        RR1.pause();
        if (RR1.editing.changed) RR1.editing.reset();
        RR1.seek(0);
        for (const layer of ["frames", "toolspeed", "nearest", "tree"]) RR1.setShown(layer, false);
        RR1.setShown("compare", true);
        if (!RR1.plots.open) RR1.plots.toggle();
        Object.assign(RR1.plots, { joint: null, zoomed: false, chosen: RR1.plots.firstChoice() });
        RR1.plots.build();
    }"""
    )
    opened.next_frames()
    yield opened
    assert opened.complaints == []


def test_g_opens_and_closes_the_card(calm: Any) -> None:
    card = calm.page.locator("#plots")
    assert card.is_visible()
    assert calm.page.get_attribute("#plotter", "aria-pressed") == "true"
    calm.page.keyboard.press("g")
    assert card.is_hidden()
    calm.page.click("#plotter")
    assert card.is_visible()


def test_the_last_curve_stays_after_a_motion_without_another_chosen_one(calm: Any) -> None:
    keys = "RR1.plots.charts.map(({ key }) => key)"
    calm.ask(
        """() => {
        Object.assign(RR1.plots, { isFirstChoice: false, chosen: ["velocity", "error"] });
        const { replay, samples } = RR1.document, { error, ...others } = samples;
        window.replayed = { replay, samples };
        RR1.setMotion({ replay: null, samples: others });
        RR1.plots.switch("velocity");
    }"""
    )
    assert calm.ask(keys) == ["velocity"]
    calm.ask("RR1.setMotion(window.replayed)")
    assert calm.ask(keys) == ["velocity", "error"]
    calm.ask("RR1.plots.isFirstChoice = true, 0")


def test_derivatives_are_those_of_the_polynomials(calm: Any, motions: Any) -> None:
    trajectory = motions[0].trajectory
    rng = np.random.default_rng(3)
    for order, key in enumerate(("position", "velocity", "acceleration", "jerk")):
        scale = 180.0 / np.pi
        largest = np.abs(scale * trajectory(np.linspace(0.0, trajectory.duration, 400), order)).max()
        for t in rng.uniform(0.0, trajectory.duration, 12):
            found = calm.ask(VALUES, [key, float(t)])
            np.testing.assert_allclose(found, scale * trajectory(t, order), atol=2e-5 * largest, err_msg=key)


def test_limits_are_those_of_the_robot(calm: Any, motions: Any) -> None:
    limits = motions[0].scene.arms["rr1"].robot.limits
    bounds = """key => RR1.plots.source.curves(RR1.plots.arm, key).filter((curve) => curve.motion === null)
        .map((curve) => curve.bounds)"""
    scale = 180.0 / np.pi
    np.testing.assert_allclose(calm.ask(bounds, "position"), scale * np.stack([limits.lower, limits.upper], axis=1))
    for key in ("velocity", "acceleration", "jerk"):
        highest = scale * getattr(limits, key)
        np.testing.assert_allclose(calm.ask(bounds, key), np.stack([-highest, highest], axis=1))
    np.testing.assert_allclose(calm.ask(bounds, "torque"), np.stack([-limits.effort, limits.effort], axis=1))


def test_jumps_are_drawn_upright(calm: Any, motions: Any) -> None:
    trajectory = motions[0].trajectory
    times, values = calm.ask(
        """() => {
            const { times, values } = RR1.plots.source.curves(RR1.plots.arm, "acceleration")[0].points(100000);
            return [Array.from(times), Array.from(values)];
        }"""
    )
    times, values = np.array(times), np.deg2rad(values)
    assert (np.diff(times) >= 0.0).all()
    for k, t in enumerate(trajectory.breaks[1:-1]):
        here = values[np.abs(times - t) < 1e-9]
        piece = trajectory.derivative_coefficients(2)[k, :, 0]
        before = np.polynomial.polynomial.polyval(trajectory.breaks[k + 1] - trajectory.breaks[k], piece)
        assert np.abs(here - before).min() < 1e-3
        assert np.abs(here - trajectory(t, 2)[0]).min() < 1e-3


def test_many_points_are_thinned_without_losing_peaks(calm: Any) -> None:
    kept, low, high = calm.ask(
        """() => {
            const Sampled = RR1.plots.source.curves(RR1.plots.arm, "torque")[0].constructor, count = 200000;
            const times = Float64Array.from({ length: count }, (_, i) => i), values = times.map((t) => Math.sin(t / 7));
            values[123457] = 40;
            values[54321] = -50;
            const thin = new Sampled(times, values, null).points(300);
            return [thin.times.length, Math.min(...thin.values), Math.max(...thin.values)];
        }"""
    )
    assert kept < 4 * 600 + 8
    assert (low, high) == (-50, 40)


def test_torques_and_errors_are_those_of_python(calm: Any, motions: Any) -> None:
    plan, _, replay = motions
    kinematics = rp.Kinematics(plan.scene)
    t = 0.37 * plan.trajectory.duration
    expected = kinematics.inverse_dynamics(*(plan.trajectory(t, k) for k in range(3)))
    np.testing.assert_allclose(calm.ask(VALUES, ["torque", t]), expected, atol=0.05)
    i = len(replay.record.times) // 2
    error = np.rad2deg(replay.record.actual[i] - replay.record.desired[i])
    np.testing.assert_allclose(calm.ask(VALUES, ["error", float(replay.record.times[i])]), error, atol=1e-6)


def test_texts_and_curves_grow_with_the_window(calm: Any) -> None:
    texts = """["#title", "#plots .legend", "#clock"].map((at) =>
        parseFloat(getComputedStyle(document.querySelector(at)).fontSize))"""
    calm.resize(1280, 720)
    small, dots = np.array(calm.ask(texts)), calm.ask("RR1.plots.charts[0].area.clientHeight")
    calm.resize(3840, 2160)
    np.testing.assert_allclose(np.array(calm.ask(texts)) / small, 1.88, atol=0.03)
    assert calm.ask("RR1.plots.charts[0].area.clientHeight") == pytest.approx(1.88 * dots, rel=0.02)
    box = calm.page.locator("#plots .area").first.bounding_box()
    left, right = calm.ask("(({ box, large }) => [large * box.left, large * box.right])(RR1.plots.charts[0])")
    calm.page.mouse.click(box["x"] + 0.25 * left + 0.75 * right, box["y"] + 0.5 * box["height"])
    assert calm.ask("RR1.time / RR1.duration") == pytest.approx(0.75, abs=0.01)


def test_dragging_the_cursor_scrubs_the_motion(calm: Any) -> None:
    area = calm.page.locator("#plots .area").first
    box = area.bounding_box()
    left, right = calm.ask("[RR1.plots.charts[0].box.left, RR1.plots.charts[0].box.right]")
    y = box["y"] + 0.6 * box["height"]
    calm.page.mouse.move(box["x"] + left, y)
    calm.page.mouse.down()
    calm.page.mouse.move(box["x"] + 0.5 * (left + right), y, steps=3)
    duration = calm.ask("RR1.duration")
    assert calm.ask("RR1.time") == pytest.approx(0.5 * duration, abs=0.02 * duration)
    calm.page.mouse.up()
    calm.page.mouse.move(box["x"] + right, y)
    assert calm.ask("RR1.time") == pytest.approx(0.5 * duration, abs=0.02 * duration)
    area.focus()
    before = calm.ask("RR1.time")
    calm.page.keyboard.press("ArrowRight")
    assert calm.ask("RR1.time") == pytest.approx(before + 1 / 60)
    assert float(area.get_attribute("aria-valuenow")) == pytest.approx(before + 1 / 60)


def test_chips_choose_the_curves_and_one_stays(calm: Any) -> None:
    calm.ask("RR1.plots.chosen = ['velocity'], RR1.plots.build()")
    calm.page.click("[data-plot=jerk]")
    titles = calm.page.locator("#plots figcaption b").all_inner_texts()
    assert titles == ["Velocity", "Jerk"]
    calm.page.click("[data-plot=velocity]")
    calm.page.click("[data-plot=jerk]")
    assert calm.page.locator("#plots figcaption b").all_inner_texts() == ["Jerk"]


def test_a_joint_is_shown_in_its_unit_with_its_limits(calm: Any, motions: Any) -> None:
    calm.ask("RR1.plots.chosen = ['velocity'], RR1.plots.build()")
    assert calm.ask("RR1.plots.charts[0].relative")
    calm.page.select_option("#plots select[aria-label=Joint]", "elbow_joint")
    t = 0.4 * motions[0].trajectory.duration
    calm.ask("t => RR1.seek(t)", t)
    value = float(np.rad2deg(motions[0].trajectory(t, 1)[2]))
    said = calm.page.inner_text("#plots figcaption output").split(",")[0].replace("−", "-")
    assert float(said.split()[0]) == pytest.approx(value, rel=0.01)
    assert said.endswith("°/s")
    low, high = calm.ask("RR1.plots.charts[0].range")
    assert low < -450 < 450 < high
    calm.page.click("#plots .head .chip >> text=Fit")
    assert calm.ask("RR1.plots.charts[0].range[1]") < 450
    calm.page.click("#plots .head .chip >> text=Fit")
    calm.page.click("#plots .legend button >> text=elbow_joint")
    assert calm.ask("RR1.plots.joint") is None


def test_the_motion_to_compare_is_a_ghost_and_a_dashed_curve_on_one_clock(calm: Any, motions: Any) -> None:
    plan, other, _ = motions
    end = max(plan.trajectory.end_time, other.trajectory.end_time)
    assert calm.ask("RR1.player.end") == pytest.approx(end)
    found = calm.ask(
        """RR1.plots.source.curves(RR1.plots.arm, "velocity").map(({ motion, dash }) => [motion, dash.length])"""
    )
    assert found == [[None, 0]] * 6 + [["seed 5", 2]] * 6
    t = 0.6 * other.trajectory.duration
    calm.ask("t => RR1.seek(t)", t)
    tool = plan.scene.arms["rr1"].robot.tool
    at = calm.ask(
        "name => { const k = 16 * RR1.kinematics.linkIndex(RR1.kinematics.arms[0], name);"
        " return Array.from(RR1.world.followers.compare.poses.slice(k, k + 16)); }",
        tool,
    )
    expected = plan.scene.link_poses(plan.scene.split(other.trajectory(t)))[f"rr1/{tool}"]
    np.testing.assert_allclose(np.reshape(at, (4, 4)).T, expected, atol=1e-5)
    calm.page.click("[data-layer=compare]")
    assert not calm.ask("RR1.world.layers.compare.visible")
    calm.page.click("[data-layer=compare]")


@pytest.mark.drawn
def test_layers_on_demand_are_made_when_they_are_first_shown(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    # The path of the tool is bright up to the current time.
    tab.ask("RR1.seek(0.9 * RR1.player.end), document.body.classList.add('bare')")
    before = tab.picture()
    for layer in ("frames", "toolspeed", "nearest", "tree"):
        tab.ask("layer => RR1.setShown(layer, true)", layer)
        shown = tab.picture()
        assert (np.abs(shown - before).max(axis=2) > 30).sum() > 30, layer
        tab.ask("layer => RR1.setShown(layer, false)", layer)
        assert (np.abs(tab.picture() - before).max(axis=2) > 30).sum() < 30, layer
    assert tab.complaints == []


@pytest.mark.parametrize("layer", ["frames", "toolspeed", "nearest", "tree"])
def test_a_layer_is_shown_and_hidden_by_its_button(calm: Any, layer: str) -> None:
    calm.page.click(f"[data-layer={layer}]")
    assert calm.ask("layer => RR1.isShown(layer)", layer)
    calm.page.click(f"[data-layer={layer}]")


def test_frames_stand_at_the_links(calm: Any, motions: Any) -> None:
    plan = motions[0]
    t = 0.3 * plan.trajectory.duration
    calm.ask("t => { RR1.setShown('frames', true); RR1.seek(t); }", t)
    rods = calm.ask(
        """() => {
            const { rods } = RR1.overlays.made.frames, m = new RR1.THREE.Matrix4();
            return [...Array(rods.count).keys()].map((i) => { rods.getMatrixAt(i, m); return m.toArray(); });
        }"""
    )
    calm.ask("RR1.setShown('frames', false)")
    matrices = np.reshape(rods, (-1, 3, 4, 4)).transpose(0, 1, 3, 2)
    poses = plan.scene.link_poses(plan.scene.split(plan.trajectory(t)))
    for link, own in zip(plan.scene.arms["rr1"].robot.link_names, matrices, strict=True):
        for k in range(3):
            np.testing.assert_allclose(own[k, :3, 3], poses[f"rr1/{link}"][:3, 3], atol=1e-5)
            along = own[k, :3, 1] / np.linalg.norm(own[k, :3, 1])
            np.testing.assert_allclose(along, poses[f"rr1/{link}"][:3, k], atol=1e-5)


def test_the_speed_of_the_tool_is_that_of_its_jacobian(calm: Any, motions: Any) -> None:
    trajectory, kinematics = motions[0].trajectory, rp.Kinematics(motions[0].scene)
    calm.ask("RR1.setShown('toolspeed', true)")
    times, speeds = calm.ask("[RR1.toolPath.times, Array.from(RR1.toolPath.lines[0].speeds)]")
    expected = [np.linalg.norm((kinematics.jacobian(trajectory(t)) @ trajectory(t, 1))[:3]) for t in times]
    np.testing.assert_allclose(speeds, expected, atol=1e-4)
    assert max(speeds) > 0.5
    assert calm.page.inner_text("#speedbar").split()[-2:] == [f"{max(speeds):.2f}", "m/s"]
    calm.ask("RR1.setShown('toolspeed', false)")
    assert calm.page.locator("#speedbar").is_hidden()


def test_clearance_lines_end_on_the_nearest_bodies(calm: Any, motions: Any) -> None:
    plan = motions[0]
    checker = rp.CollisionChecker(plan.scene)
    around = [k for k, pair in enumerate(checker.pairs) if not all(name.startswith("rr1/") for name in pair)]
    # At a sample, and between two of them.
    calm.ask("RR1.setShown('nearest', true)")
    times = calm.ask("Array.from(RR1.overlays.made.nearest.times)")
    for share, slack in ((0.0, 1e-5), (0.4, 1e-3)):
        t = (1.0 - share) * times[20] + share * times[21]
        calm.ask("t => { RR1.seek(t); RR1.overlays.label(); }", t)
        distances = checker.distances(plan.trajectory(t))[around]
        words = calm.page.inner_text("#nearest").split()
        assert float(words[0]) == pytest.approx(1e3 * distances.min(), abs=0.1 + 1e3 * slack)
        assert {*words[2::2]} == {*checker.pairs[around[distances.argmin()]]}
        matrix = "RR1.overlays.made.nearest.rods.getMatrixAt(0, m)"
        rod = calm.ask(f"() => {{ const m = new RR1.THREE.Matrix4(); {matrix}; return m.toArray(); }}")
        assert np.linalg.norm(rod[4:7]) == pytest.approx(distances.min(), abs=slack)
    calm.ask("RR1.setShown('nearest', false)")
    calm.page.locator("#nearest").wait_for(state="hidden")  # the next frame hides it


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (800, 600), (390, 844)])
def test_the_card_covers_no_arm(tab: Any, page_file: FilePath, width: int, height: int) -> None:
    tab.resize(width, height)
    tab.open(page_file)
    tab.page.keyboard.press("g")
    wait_until(tab.page, "RR1.plots.charts.every(({ box }) => box)")
    hidden = """() => {
        const { camera, pane } = RR1.stage, plots = document.getElementById("plots").getBoundingClientRect();
        camera.updateMatrixWorld();
        return Object.values(RR1.poses(RR1.q)).filter((T) => {
            const p = new RR1.THREE.Vector3(T[12], T[14], -T[13]).project(camera);
            return (1 - p.y) / 2 * pane.clientHeight > plots.top;
        }).length;
    }"""
    assert tab.ask(hidden) == 0
    wide = tab.ask("[document.documentElement.scrollWidth, document.getElementById('plots').scrollWidth]")
    assert wide[0] <= width
    assert wide[1] <= width
    assert tab.complaints == []


@pytest.mark.drawn
def test_violations_are_marked_in_their_chart_and_lead_to_their_place(
    tab: Any, rr1_table: rp.Scene, tmp_path: FilePath
) -> None:
    start = rr1_table.configuration()
    away = start + np.array([0.0, 1.5, 0.8, 0.0, 0.0, 0.0])
    trajectory = rp.Trajectory.from_samples(rr1_table.joint_names(), [0.0, 1.0], [start, away])
    report = rp.validate(trajectory, rr1_table)
    options = rp.ViewOptions(play=False)
    tab.open(rp.save_html(tmp_path / "bad.html", rr1_table, trajectory=trajectory, report=report, options=options))
    tab.page.keyboard.press("g")
    wait_until(tab.page, "Boolean(RR1.planner) && RR1.plots.offered.includes('clearance')")
    tab.ask("RR1.plots.chosen = ['clearance', 'position'], RR1.plots.build()")
    times = [v.time for v in report.violations if v.time is not None]
    assert tab.ask("RR1.conflicts.all.map(({ time }) => time)") == sorted(times)
    # Red pixels where the position is beyond its limit, at the end of that chart.
    place = tab.ask(
        """() => {
            const { area, x, box } = RR1.plots.charts[1], at = area.getBoundingClientRect();
            return [at.left + RR1.plots.charts[1].x(1), at.top + box.top - 8];
        }"""
    )
    picture = tab.picture()
    red, green, blue = picture[int(place[1]), int(place[0]) - 1]
    assert (red, green, blue) == pytest.approx((194, 37, 92), abs=40)
    tab.page.mouse.click(place[0] - 1, place[1])
    assert tab.ask("RR1.time") == 1.0
    # A joint beyond its limit: its link is red.
    tab.page.click("#report .violation >> nth=2")
    assert tab.ask("RR1.touched") == ["rr1/upper_arm_link"]
    # A contact: a ring where Coal says that the bodies touch.
    rings = tab.ask(
        """() => RR1.overlays.rings.filter(({ ring }) => ring.visible)
            .map(({ conflict, ring }) => [conflict.subject, ring.position.toArray()])"""
    )
    contacts = {frozenset((c.a, c.b)): c.point for c in rp.CollisionChecker(rr1_table).contacts(away)}
    checked = 0
    for subject, position in rings:
        if frozenset(subject) in contacts:
            np.testing.assert_allclose(position, contacts[frozenset(subject)], atol=1e-6)
            checked += 1
    assert checked >= 1
    tab.ask("RR1.seek(0.5)")
    assert tab.ask("RR1.overlays.rings.filter(({ ring }) => ring.visible).length") == 0
    tab.page.keyboard.press("n")
    assert tab.ask("RR1.time") == min(t for t in times if t > 0.5)
    # Contacts with an obstacle that is elsewhere now are none; everything else that is wrong stays.
    name = next(name for v in report.violations for name in v.subject if name in rr1_table.obstacles)
    left = [v for v in report.violations if name not in v.subject]
    tab.ask(
        "name => RR1.editing.moveObstacle(name, RR1.editing.poses.get(name).map((v, i) => (i === 14 ? v - 1 : v)))",
        name,
    )
    assert tab.ask("RR1.conflicts.all.map(({ time }) => time)") == sorted(v.time for v in left if v.time is not None)
    assert tab.page.locator("#report .violation").count() == len(left) > 0
    assert tab.complaints == []


def test_the_arm_is_chosen_among_those_that_move(
    tab: Any, rr1: rp.Robot, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    scene = rp.Scene().with_arm("one", rr1).with_arm("two", planar2r, [1.5, 0.0, 0.0]).with_arm("still", rr1, [3, 0, 0])
    q = scene.configuration()[:8]
    names = scene.joint_names()[:8]
    motion = rp.Trajectory.from_samples(names, [0.0, 1.0], [q, q + 0.3])
    options = rp.ViewOptions(play=False)
    tab.open(rp.save_html(tmp_path / "page.html", scene, trajectory=motion, options=options))
    tab.page.click("#plotter")
    menu = "#plots select[aria-label=Arm]"
    assert tab.page.locator(f"{menu} option").all_inner_texts() == ["one", "two"]
    assert tab.page.locator("#plots .legend button").count() == 6
    tab.page.select_option(menu, "two")
    assert tab.page.locator("#plots .legend button").count() == 2
    # It has no limit of the torque: the note says so, and the curves have their unit.
    tab.ask("RR1.plots.chosen = ['velocity'], RR1.plots.build()")
    np.testing.assert_allclose(tab.ask(VALUES, ["velocity", 0.5]), np.rad2deg([0.3, 0.3]), rtol=1e-5)
    assert tab.complaints == []


def test_the_planner_of_the_page_measures_clearances_that_were_not_sent(
    tab: Any, motions: Any, tmp_path: FilePath
) -> None:
    plan = motions[0]
    file = plan.save_html(tmp_path / "page.html", options=rp.ViewOptions(clearances=False, play=False))
    tab.resize(1600, 800)
    tab.open(file)
    tab.page.keyboard.press("g")
    wait_until(tab.page, "RR1.planner || RR1.noPlanner")
    tab.ask("() => { RR1.planner.clearance = () => { throw new Error('in the page'); }; RR1.plots.load(); }")
    wait_until(tab.page, "RR1.plots.offered.includes('clearance')")
    assert tab.ask("RR1.plots.chosen.includes('clearance')")
    times = np.linspace(0.0, plan.trajectory.duration, 201)[::20]
    found = [tab.ask(VALUES, ["clearance", float(t)])[0] for t in times]
    checker = rp.CollisionChecker(plan.scene)
    expected = [1e3 * checker.moving_clearance(plan.trajectory(t)) for t in times]
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert tab.complaints == []


def test_clearances_follow_a_moved_obstacle(calm: Any, motions: Any) -> None:
    plan = motions[0]
    wait_until(calm.page, "RR1.planner || RR1.noPlanner")
    curves = "RR1.plots.source.curves(RR1.plots.arm, 'clearance').filter((curve) => curve.motion === null)"
    times = np.linspace(0.0, plan.trajectory.duration, 201)[::20]
    sent = [calm.ask(VALUES, ["clearance", float(t)]) for t in times]
    name = calm.ask("RR1.planner.obstacles.find((name) => RR1.editing.canMove(name))")
    # Until they are measured again none is shown, not even for a moment those of before.
    at_once, nearest = calm.ask(
        f"""name => {{
            const pose = Float64Array.from(RR1.editing.poses.get(name));
            pose[14] += 0.03;
            RR1.editing.remember(null);
            RR1.editing.moveObstacle(name, pose);
            return [{curves}.map((curve) => curve.at(0.2)), RR1.hasLayer('nearest')];
        }}""",
        name,
    )
    assert np.isnan(at_once).tolist() == [True]
    assert not nearest
    wait_until(calm.page, f"Number.isFinite({curves}[0].at(0.2))")
    scene = plan.scene.with_obstacle_at(
        name, np.reshape(calm.ask("n => Array.from(RR1.planner.obstaclePose(n))", name), (4, 4)).T
    )
    checker = rp.CollisionChecker(scene)
    expected = [1e3 * checker.moving_clearance(plan.trajectory(t)) for t in times]
    np.testing.assert_allclose([calm.ask(VALUES, ["clearance", float(t)])[0] for t in times], expected, atol=2e-3)
    calm.ask("RR1.editing.undo()")
    assert [calm.ask(VALUES, ["clearance", float(t)]) for t in times] == sent
    assert calm.ask("RR1.hasLayer('nearest')")


def test_a_page_without_a_timed_motion_has_no_plots(tab: Any, rr1_table: rp.Scene, tmp_path: FilePath) -> None:
    q = rr1_table.configuration()
    path = rp.Path(rr1_table.joint_names(), [q, q + 0.1])
    tab.open(rp.save_html(tmp_path / "path.html", rr1_table, path=path))
    assert tab.page.locator("#plotter").is_hidden()
    tab.page.keyboard.press("g")
    assert tab.page.locator("#plots").is_hidden()
    assert tab.complaints == []


def test_a_motion_without_duration_has_one_instant_on_its_axis(
    tab: Any, rr1_table: rp.Scene, tmp_path: FilePath
) -> None:
    rest = rp.Trajectory.rest(rr1_table.joint_names(), rr1_table.configuration())
    tab.record_texts()
    tab.open(rp.save_html(tmp_path / "rest.html", rr1_table, trajectory=rest))
    tab.ask("RR1.plots.toggle()")
    tab.next_frames()
    tab.ask("window.texts = [], RR1.plots.chosen = ['velocity'], RR1.plots.build()")
    tab.next_frames()
    texts = tab.ask("window.texts")
    assert "0 s" in texts
    assert "0" not in texts
    assert "Duration\n0.00 s" in tab.page.inner_text("#facts")
    assert tab.complaints == []


def test_clearances_say_at_how_many_instants_they_were_sampled(calm: Any) -> None:
    assert calm.ask("RR1.plots.source.remark('clearance')") == (
        f"at {calm.ask('RR1.document.samples.clearance.times.shape[0]')} instants"
    )


def test_paper_shows_the_curves(calm: Any) -> None:
    """Chromium prints nothing of a canvas that is drawn while it makes the sheet."""
    calm.ask(
        """() => {
        window.printed = [];
        for (const chart of RR1.plots.charts) {
            const { draw } = chart;
            chart.draw = () => { window.printed.push(chart.key); draw.call(chart); };
        }
    }"""
    )
    calm.page.pdf()
    assert calm.ask("window.printed") == []
    calm.ask("RR1.plots.charts.forEach((chart) => delete chart.draw)")


def test_curves_keep_their_ground_and_colors_with_forced_colors(calm: Any) -> None:
    calm.page.emulate_media(forced_colors="active", color_scheme="dark")
    color = "(node) => getComputedStyle(document.querySelector(node)).backgroundColor"
    assert calm.ask(color, "#plots .area canvas") == "rgb(255, 255, 255)"
    assert calm.ask(color, "#plots .area canvas + canvas") == "rgba(0, 0, 0, 0)"
    assert calm.ask(color, "#plots .number") == calm.ask(
        "document.querySelector('#plots .number').style.backgroundColor"
    )
