"""The page in a real browser: what it draws, what it computes, what a click does."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from drawn_links import DRAWN_LINKS, link_boxes, wander
from PIL import Image

import rr1plan as rp
from rr1plan import Panel, Replay, pack_array, save_html, show
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.page_capture import wait_until
from rr1plan.report import Margin, Violation

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def two_arms(rr1: rp.Robot, planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene(name="two").with_arm("left", rr1, rp.transforms.pose([0.4, 0.1, 0.02], rpy=[0.1, -0.2, 1.0]))
    scene = scene.with_arm("right", planar2r, [-0.5, 0.0, 0.0])
    scene = scene.with_obstacle("ground", rp.HalfSpace()).with_obstacle("ball", rp.Sphere(0.08), [0.0, 0.4, 0.3])
    return scene.with_obstacle("held", rp.Box((0.03, 0.03, 0.06)), [0.1, 0.1, 0.4]).attach("held", "left")


@pytest.fixture(scope="module")
def page_file(two_arms: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    trajectory = wander(two_arms)
    problem = rp.Problem(two_arms, None, {"left": trajectory(3.0)[:6], "right": trajectory(3.0)[6:]})
    report = rp.Report(
        (Violation("collision", ("left/hand", "ball"), 1.25, -0.004, 0.0, "left/hand is 4 mm inside ball"),),
        {
            "clearance": Margin(-0.004, "m", ("left/hand", "ball"), 1.25),
            "self_clearance": Margin(0.0102, "m", ("left/a", "left/b"), 0.5),
            "velocity": Margin(0.8),
        },
        ("collision", "velocity"),
        {"torque": "not asked for"},
        3.0,
    )
    times = np.linspace(0, 3, 31)
    zeros = np.zeros(trajectory.coefficients.shape[2])
    actual = trajectory(times) + 0.01
    record = rp.ReplayRecord(times, trajectory(times), actual)
    replay = Replay("dynamic", trajectory.joint_names, record, zeros + 0.02, zeros, zeros, (), 1, 0.1, 1.0)
    file = tmp_path_factory.mktemp("page") / "page.html"
    return save_html(
        file,
        two_arms,
        trajectory=trajectory,
        problem=problem,
        report=report,
        replay=replay,
        options=rp.ViewOptions(play=False),
    )


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    """The page at its start, paused, regardless of earlier tests."""
    opened.ask("RR1.pause(), RR1.setSpeed(1), RR1.setLoop(true), RR1.seek(0)")
    opened.ask("RR1.editing.open(false), RR1.look(RR1.document.camera.direction)")
    yield opened
    assert opened.complaints == []


def test_the_page_asks_nobody_for_anything(opened: Any, page_file: FilePath) -> None:
    assert opened.requests == [page_file.as_uri()]
    assert opened.complaints == []
    assert opened.ask("document.title") == "two"


@pytest.mark.drawn
def test_the_picture_shows_the_robot_and_its_ghosts(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    tab.ask("RR1.pause(), RR1.seek(0)")
    with_robot = tab.bare_picture()
    red, green, blue = with_robot[..., 0], with_robot[..., 1], with_robot[..., 2]
    orange = (red > 120) & (green < 0.75 * red) & (blue < 0.6 * red)
    assert orange.sum() > 2000
    tab.ask("['robots', 'start', 'goal', 'toolpath'].forEach(l => RR1.setShown(l, false))")
    without = tab.bare_picture()
    assert (np.abs(with_robot - without).max(axis=2) > 40).sum() > 4000


def test_kinematics_in_the_page_agree_with_ours(calm: Any, two_arms: rp.Scene) -> None:
    trajectory = wander(two_arms)
    for t in np.random.default_rng(5).uniform(0.0, 3.0, 25):
        poses = calm.ask("t => RR1.poses(RR1.at(t))", t)
        expected = two_arms.link_poses(two_arms.split(trajectory(t)))
        assert set(poses) == set(expected)
        for name, T in expected.items():
            np.testing.assert_allclose(np.reshape(poses[name], (4, 4)).T, T, atol=1e-6)


def test_what_is_drawn_is_where_the_kinematics_say(calm: Any, two_arms: rp.Scene) -> None:
    calm.ask("RR1.seek(1.7)")
    wait_until(calm.page, "RR1.stage.quality === RR1.pace.full")
    drawn_boxes = calm.ask(DRAWN_LINKS, 0)
    expected = link_boxes(two_arms, wander(two_arms)(1.7))
    assert set(drawn_boxes) == set(expected)
    for name, box in expected.items():
        # A round part of 36 sides lies up to 0.4 % of its radius inside the circle.
        np.testing.assert_allclose(drawn_boxes[name], box, atol=6e-4, err_msg=name)


def test_play_and_pause_by_clicks(calm: Any) -> None:
    calm.page.click("#play")
    wait_until(calm.page, "RR1.time > 0.05")
    assert calm.ask("RR1.playing")
    calm.page.click("#play")
    stopped = calm.ask("RR1.time")
    assert not calm.ask("RR1.playing")
    calm.next_frames()
    assert calm.ask("RR1.time") == stopped


def test_scrubbing_with_the_mouse_goes_to_that_time(calm: Any, two_arms: rp.Scene) -> None:
    box = calm.page.locator("#scrub").bounding_box()
    calm.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    time = calm.ask("RR1.time")
    assert time == pytest.approx(1.5, abs=0.1)
    np.testing.assert_allclose(calm.ask("Array.from(RR1.q)"), wander(two_arms)(time), atol=1e-6)


def test_the_speed_menu_changes_the_speed(calm: Any) -> None:
    calm.page.select_option("#speed", "5")
    assert calm.ask("RR1.player.speed") == 5
    gone = calm.ask("(RR1.player.playing = true, RR1.player.last = 1000, RR1.player.tick(1100), RR1.pause(), RR1.time)")
    assert gone == pytest.approx(0.5)


def test_the_motion_repeats_or_stops_at_its_end(calm: Any) -> None:
    run = """loop => {
        RR1.setLoop(loop);
        RR1.seek(2.9);
        RR1.play();
        RR1.player.last = 0;
        for (const now of [200, 900, 901]) RR1.player.tick(now);
        const found = [RR1.playing, RR1.time];
        RR1.pause();
        return found;
    }"""
    assert calm.ask(run, False) == [False, 3]
    playing, time = calm.ask(run, True)
    assert playing
    assert time < 0.5


def test_another_document_leaves_repeat_and_speed_as_they_are(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    assert tab.ask(
        "(RR1.setLoop(false), RR1.setSpeed(2), RR1.load(RR1.document), [RR1.player.loop, RR1.player.speed])"
    ) == [False, 2]
    assert tab.page.get_attribute("#loop", "aria-pressed") == "false"


def test_a_wait_at_the_end_that_was_broken_off_does_not_count_later(calm: Any) -> None:
    run = """() => {
        RR1.setLoop(true);
        const found = [];
        for (const begin of [5000, 0]) {
            RR1.seek(2.9);
            RR1.play();
            RR1.player.last = begin;
            for (const now of [200, 500]) RR1.player.tick(begin + now);
            found.push(RR1.time);
            RR1.player.tick(begin + 900);
            found.push(RR1.time);
            RR1.seek(2.9);
            RR1.player.tick(begin + 1000);
            RR1.pause();
        }
        return found;
    }"""
    assert calm.ask(run) == [3, 0, 3, 0]


def test_keys_do_what_buttons_do(calm: Any) -> None:
    calm.page.click("#pane", position={"x": 480, "y": 300})
    calm.page.keyboard.press("ArrowRight")
    assert calm.ask("RR1.time") == pytest.approx(1 / 60)
    calm.page.keyboard.press("End")
    assert calm.ask("RR1.time") == 3
    calm.page.keyboard.press("ArrowUp")
    assert calm.ask("RR1.player.speed") == 2
    calm.page.keyboard.press("Space")
    assert calm.ask("RR1.playing")
    calm.page.keyboard.press("Space")
    assert not calm.ask("RR1.playing")


def test_a_joint_slider_poses_the_arm(calm: Any) -> None:
    slider = calm.page.locator("#joint-0")
    box = slider.bounding_box()
    calm.page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    low, high = calm.ask("RR1.limits[0]")
    assert calm.ask("RR1.q[0]") == pytest.approx(low + 0.75 * (high - low), abs=0.1 * (high - low))
    assert calm.ask("RR1.manual")
    calm.ask("RR1.seek(0)")
    assert not calm.ask("RR1.manual")


def test_screen_readers_read_values_in_their_units_and_only_on_a_visit(calm: Any) -> None:
    calm.ask("(RR1.pause(), RR1.seek(0.5))")
    calm.next_frames()
    assert calm.ask("document.getElementById('scrub').getAttribute('aria-valuetext')") == "0.50 s"
    said = "[...document.querySelectorAll('.joint input')].map((slider) => slider.getAttribute('aria-valuetext'))"
    shown = calm.ask("[...document.querySelectorAll('.joint output')].map((out) => out.textContent)")
    assert calm.ask(said) == shown
    assert all(text.endswith("°") for text in shown)
    live = "(node) => (node.getAttribute('aria-live') || 'polite') !== 'off'"
    assert not calm.ask(f"[...document.querySelectorAll('.joint output, #clock, #hud, #tip')].some({live})")


def test_a_browser_that_darkens_pages_leaves_the_paper_under_drawings(calm: Any) -> None:
    session = calm.page.context.new_cdp_session(calm.page)
    calm.page.emulate_media(color_scheme="dark")
    session.send("Emulation.setAutoDarkModeOverride", {"enabled": True})
    side = Image.open(io.BytesIO(calm.page.locator("#side").screenshot())).convert("L")
    session.detach()
    calm.page.emulate_media(color_scheme="light")
    assert np.median(np.asarray(side)) > 200


def test_a_finger_can_set_the_time_on_a_phone(calm: Any) -> None:
    calm.resize(390, 844)
    line, bar = (calm.page.locator(name).bounding_box() for name in ("#scrub", "#bar"))
    calm.resize(960, 640)
    assert line["width"] > 0.9 * bar["width"]


@pytest.mark.parametrize(("width", "hidden"), [(390, []), (360, []), (320, ["speed", "loop"])])
def test_a_phone_has_the_buttons_of_the_bar_side_by_side(calm: Any, width: int, hidden: list[str]) -> None:
    calm.resize(width, 740)
    calm.ask("RR1.setQ(RR1.q)")  # the clock then shows "by hand"
    boxes = calm.ask("""() => [...document.querySelectorAll("#bar > :not(#line, #length)")]
        .map((node) => ({ name: node.id || "help", ...node.getBoundingClientRect().toJSON() }))""")
    bar = calm.page.locator("#bar").bounding_box()
    shown = [box for box in boxes if box["width"]]
    assert [box["name"] for box in boxes if not box["width"]] == hidden
    for one, two in itertools.pairwise(shown):
        assert one["right"] <= two["left"]
    assert shown[-1]["right"] <= bar["x"] + bar["width"]
    assert min(box["width"] for box in shown) >= 26
    calm.page.click("#bar .help")
    assert calm.page.locator("#help").is_visible()
    calm.page.keyboard.press("Escape")
    calm.resize(960, 640)


def test_a_slider_of_a_joint_without_limits_stays_in_its_turn(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r, q=[7.0, 0.0])
    tab.open(save_html(tmp_path / "turns.html", scene))
    assert float(tab.ask("document.getElementById('joint-0').value")) == pytest.approx(7.0 - 2 * np.pi)
    assert tab.ask("document.querySelector('.joint output').textContent") == "401.1°"
    for value, expected in ((-0.5, 2 * np.pi - 0.5), (-3.1, 2 * np.pi - 3.1), (3.1, 3.1)):
        tab.page.fill("#joint-0", str(value))
        assert tab.ask("RR1.q[0]") == pytest.approx(expected)
    assert tab.complaints == []


def test_values_of_sliding_joints_stay_on_their_line(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RP", (1.0, 0.8)), q=[0.3, 0.788])
    tab.open(save_html(tmp_path / "slides.html", scene))
    assert tab.page.locator(".joint output").all_inner_texts() == ["17.2°", "788.0 mm"]
    turning, sliding = (out.bounding_box() for out in tab.page.locator(".joint output").all())
    assert sliding["height"] == turning["height"]


@pytest.mark.parametrize("layer", ["robots", "obstacles", "start", "goal", "toolpath", "collisions", "replay"])
def test_every_toggle_shows_and_hides_its_layer(calm: Any, layer: str) -> None:
    visible = f"RR1.world.layers['{layer}'].visible"
    before = calm.ask(visible)
    calm.page.click(f"[data-layer={layer}]")
    assert calm.ask(visible) != before
    calm.page.click(f"[data-layer={layer}]")
    assert calm.ask(visible) == before


def test_the_simulated_shadow_is_where_the_replay_was(calm: Any, two_arms: rp.Scene) -> None:
    calm.ask("RR1.setShown('replay', true), RR1.seek(1.5)")
    tool = two_arms.arms["left"].robot.tool
    at = calm.ask(
        "n => Array.from(RR1.world.followers.replay.poses.slice(16 * n, 16 * n + 16))",
        two_arms.arms["left"].robot.link_names.index(tool),
    )
    calm.ask("RR1.setShown('replay', false)")
    expected = two_arms.link_poses(two_arms.split(wander(two_arms)(1.5) + 0.01))[f"left/{tool}"]
    np.testing.assert_allclose(np.reshape(at, (4, 4)).T, expected, atol=1e-5)


@pytest.mark.parametrize(("error", "unit"), [((0.02, 0.001), "mm"), ((0.001, 0.02), "mrad")])
def test_the_error_of_a_replay_has_the_unit_of_its_joint(
    tab: Any, tmp_path: FilePath, error: tuple[float, float], unit: str
) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PR"))
    names, q = scene.joint_names(), scene.configuration()
    motion = rp.Trajectory.from_samples(names, [0.0, 1.0], [q, q + 0.1])
    times, zeros = np.linspace(0, 1, 5), np.zeros(2)
    record = rp.ReplayRecord(times, motion(times), motion(times) + error)
    replay = Replay("dynamic", names, record, np.array(error), zeros, zeros, (), 1, 0.1, 1.0)
    tab.open(save_html(tmp_path / "page.html", scene, trajectory=motion, replay=replay))
    assert f"off by 20 {unit} at most" in tab.page.inner_text("#facts")
    assert tab.complaints == []


def test_a_violation_leads_to_its_moment_and_pair(calm: Any) -> None:
    assert calm.page.inner_text("#badge") == "Invalid: 1 found"
    facts = calm.page.inner_text("#facts")
    assert re.search(r"Clearance\s+−4.0 mm", facts)
    assert re.search(r"Self clearance\s+10.2 mm", facts)
    assert re.search(r"MuJoCo\s+motion not followed, off by 20 mrad at most, no contact", facts)
    assert "self clearance" in calm.page.text_content("#report")
    calm.page.click("#report .violation")
    assert calm.ask("RR1.time") == 1.25
    assert calm.ask("RR1.touched") == ["left/hand", "ball"]


def test_the_frame_button_looks_at_everything_and_back(calm: Any) -> None:
    calm.ask("RR1.look()")
    near = calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)")
    calm.page.click("#home")
    assert calm.ask("RR1.framed") == "whole"
    whole = calm.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)")
    calm.page.click("#home")
    assert calm.ask("RR1.framed") == "near"
    assert whole >= near


def test_obstacles_within_reach_are_framed_and_larger_ones_are_not(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("ball", rp.Sphere(0.1), [-0.9, -1.0, 0.0])
    wide = scene.with_obstacle("floor", rp.Box((100.0, 100.0, 0.1)), [0.0, 0.0, -0.2])
    wide = wide.with_obstacle("far", rp.Sphere(0.3), [8.0, 5.0, 0.0])
    distances = []
    for k, one in enumerate((scene, wide)):
        tab.open(save_html(tmp_path / f"{k}.html", one, options=rp.ViewOptions(planner=False)))
        x, y = tab.ask("(({ x, y }) => [x, y])(RR1.editing.picker.project({ x: -0.9, y: -1, z: 0 }))")
        assert 30 < x < 930
        assert 30 < y < 610
        distances.append(tab.ask("RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)"))
    assert distances[1] < 1.5 * distances[0]


def small_world(size: float) -> tuple[rp.Scene, rp.Trajectory]:
    """An arm whose links are together as long as `size` [m], a plate beside it, and a motion."""
    robot = rp.planar_arm("RR", (0.6 * size, 0.4 * size), width=0.06 * size)
    scene = rp.Scene(name="world").with_arm("arm", robot, [0.1 * size, 0.0, 0.2 * size])
    scene = scene.with_obstacle("plate", rp.Box((0.3 * size, 0.2 * size, 0.4 * size)), (0.4 * size, -0.6 * size, 0.0))
    return scene, rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [[0.2, 0.4], [1.9, 1.1]])


@pytest.mark.drawn
def test_worlds_of_any_size_look_alike(tab: Any, tmp_path: FilePath) -> None:
    pictures, places, words = [], [], []
    for size in (1.0, 0.005, 50.0):
        scene, motion = small_world(size)
        options = rp.ViewOptions(play=False, planner=False)
        tab.open(save_html(tmp_path / f"{size}.html", scene, trajectory=motion, options=options))
        at = """RR1.kinematics.arms[0].robot.links.map((_, i) => {
            const [x, y, z] = RR1.world.poses.slice(16 * i + 12, 16 * i + 15);
            const p = RR1.editing.picker.project({ x, y, z });
            return [p.x, p.y, p.front];
        })"""
        tab.ask("RR1.seek(0.5)")
        tab.next_frames()  # which place the camera
        places.append(tab.ask(at))
        pictures.append(tab.bare_picture())
        tab.ask("RR1.editing.open()")
        tab.next_frames()
        words.append(tab.page.inner_text("#readout"))
    for k in (1, 2):
        np.testing.assert_allclose(places[k], places[0], atol=2.0)
        # The floor's lines are at powers of ten.
        assert (np.abs(pictures[k] - pictures[0]).max(axis=2) > 24).mean() < 0.03
    digits = [float(re.findall(r"x (\S+)", text)[0]) for text in words]
    np.testing.assert_allclose(digits, digits[0] * np.array([1.0, 0.005, 50.0]), rtol=5e-3)
    assert tab.complaints == []


def test_dragging_turns_the_camera(calm: Any) -> None:
    before = calm.ask("RR1.stage.camera.position.toArray()")
    calm.page.mouse.move(480, 350)
    calm.page.mouse.down()
    calm.page.mouse.move(600, 330, steps=4)
    calm.page.mouse.up()
    wait_until(calm.page, f"RR1.stage.camera.position.distanceTo(new RR1.THREE.Vector3(...{before})) > 0.05")


def test_a_view_that_is_framed_while_the_camera_still_turns_stays(calm: Any) -> None:
    calm.page.mouse.move(480, 350)
    calm.page.mouse.down()
    calm.page.mouse.move(600, 330, steps=4)
    calm.page.mouse.up()
    framed = calm.ask("(RR1.look([1, 0, 0.5]), RR1.stage.camera.position.toArray())")
    calm.next_frames()
    np.testing.assert_allclose(calm.ask("RR1.stage.camera.position.toArray()"), framed, atol=1e-9)


def test_a_document_that_keeps_the_camera_keeps_its_direction_when_the_window_changes(calm: Any) -> None:
    place = "RR1.stage.camera.position.toArray()"
    calm.ask("window.before = RR1.document, RR1.look([1, 0, 0.5])")
    calm.ask("RR1.load({ ...RR1.document, camera: { ...RR1.document.camera, direction: [0, 1, 0.2] } }, true)")
    kept = calm.ask(place)
    calm.ask("RR1.frame()")
    np.testing.assert_allclose(calm.ask(place), kept, atol=1e-9)
    calm.ask("RR1.load(window.before)")


def test_more_arms_are_not_more_things_to_draw(calm: Any, planar2r: rp.Robot) -> None:
    def drawn_things(count: int) -> int:
        scene = rp.Scene()
        for i in range(count):
            scene = scene.with_arm(f"arm{i}", planar2r, [i % 4, i // 4, 0.0])
        found = calm.ask(
            """doc => {
                const before = RR1.document;
                RR1.load(doc);
                const { robots, layers } = RR1.world;
                const found = robots.sets.length + layers.toolpath.children[0].children.length;
                RR1.load(before);
                return found;
            }""",
            view_document(scene, trajectory=wander(scene)),
        )
        return int(found)

    assert drawn_things(24) == drawn_things(6)


def test_an_arm_has_dots_at_waypoints_to_which_it_moves(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("left", planar2r).with_arm("right", planar2r, [4.0, 0.0, 0.0])
    # First the left arm by two edges, then the right one by one, then both.
    waypoints = [[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 0.5, 0], [0, 0, 0, 0]]
    tab.open(save_html(tmp_path / "path.html", scene, path=rp.Path(scene.joint_names(), waypoints)))
    dots = """RR1.world.layers.path.children[0].children.filter((o) => o.isInstancedMesh).flatMap((balls) => (
        Array.from({ length: balls.count }, (_, i) => {
            const T = new RR1.THREE.Matrix4();
            balls.getMatrixAt(i, T);
            return T.elements.slice(12, 14);
        })))"""
    model = rp.Kinematics(scene)
    moved = [("left", 0), ("left", 1), ("left", 2), ("left", 4), ("right", 0), ("right", 3), ("right", 4)]
    tools = [model.pose(np.array(waypoints[i], dtype=float), f"{arm}/{planar2r.tool}")[:2, 3] for arm, i in moved]
    np.testing.assert_allclose(tab.ask(dots), tools, atol=1e-5)
    assert tab.complaints == []


def test_the_clock_of_a_short_motion_has_more_digits(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 0.01], [[0.0, 0.0], [0.01, 0.01]])
    tab.open(save_html(tmp_path / "short.html", scene, trajectory=motion, options=rp.ViewOptions(play=False)))
    tab.ask("RR1.seek(0.0042)")
    assert tab.page.inner_text("#clock") == "0.0042 s"
    assert tab.page.inner_text("#length") == "/ 0.0100 s"
    assert "0.0100 s" in tab.page.inner_text("#facts")


@pytest.mark.parametrize(
    ("script", "words"), [("nowhere.x();", "nowhere is not defined"), ("const = 1;", "Unexpected")]
)
def test_a_mistake_in_the_script_of_a_panel_stops_only_that_panel(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath, script: str, words: str
) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    panels = (Panel("broken", "Broken", script=script), Panel("whole", "Whole", script="root.id = 'done';"))
    tab.open(save_html(tmp_path / "page.html", scene, options=rp.ViewOptions(panels=panels)))
    assert tab.page.locator("#done").count() == 1
    wait_until(tab.page, "RR1.frames > 0")
    assert [text for text in tab.complaints if words not in text] == []
    assert tab.complaints


def test_all_times_of_a_short_motion_have_more_digits(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    slow = rp.plan_motion(rp.Problem(scene, (0.0, 0.5), (1.0, 0.7))).trajectory
    rp.save_csv(tmp_path / "short.csv", slow.stretched(0.001 / slow.duration), dt=0.00002)
    motion = rp.load_motion(tmp_path / "short.csv", scene)
    options = rp.ViewOptions(play=False, compare={"slower": motion.trajectory.stretched(3.0)})
    tab.open(motion.save_html(tmp_path / "short.html", options=options))
    assert "0.0030 s" in tab.page.inner_text("#facts")
    titles = tab.ask("[...document.querySelectorAll('.meter, #marks *')].map((mark) => mark.title).filter(Boolean)")
    assert titles
    assert [title for title in titles if "0.00 s" in title] == []
    tab.page.keyboard.press("g")
    tab.ask("RR1.seek(0.00042)")
    words = "[...document.querySelectorAll('#plots [aria-valuetext]')].map((area) => area.ariaValueText)"
    wait_until(tab.page, f"{words}.some((words) => words.startsWith('0.0004 s'))")


def test_a_motion_starts_by_itself_unless_the_reader_wants_less_motion(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 9.0], [[0.0, 0.0], [1.0, 1.0]])
    page = save_html(tmp_path / "page.html", scene, trajectory=motion, options=rp.ViewOptions(planner=False))
    tab.open(page, plays=True)
    assert tab.ask("RR1.playing")
    tab.page.emulate_media(reduced_motion="reduce")
    tab.open(page, plays=True)
    tab.next_frames()
    assert not tab.ask("RR1.playing")
    assert tab.ask("RR1.time") == 0.0
    tab.page.keyboard.press("Space")
    assert tab.ask("RR1.playing")


def test_the_page_follows_its_window(calm: Any) -> None:
    calm.resize(640, 480)
    wait_until(calm.page, "RR1.meshcat.renderer.domElement.clientWidth <= 640")
    calm.resize(960, 640)
    wait_until(calm.page, "RR1.meshcat.renderer.domElement.clientWidth > 900")


def test_pictures_have_the_pixels_of_a_zoomed_page(calm: Any) -> None:
    tools = calm.page.context.new_cdp_session(calm.page)
    usual = {"width": 960, "height": 640, "deviceScaleFactor": 1, "mobile": False}
    tools.send("Emulation.setDeviceMetricsOverride", {**usual, "width": 480, "height": 320, "deviceScaleFactor": 2})
    wait_until(calm.page, "RR1.stage.renderer.domElement.width === 2 * RR1.stage.pane.clientWidth")
    tools.send("Emulation.setDeviceMetricsOverride", usual)
    wait_until(calm.page, "RR1.stage.renderer.domElement.width === RR1.stage.pane.clientWidth")


def test_time_during_which_the_page_was_hidden_does_not_count_as_slow(calm: Any) -> None:
    calm.ask("RR1.play()")
    calm.ask("() => { RR1.player.last -= 3.6e6; document.dispatchEvent(new Event('visibilitychange')); }")
    calm.next_frames()
    assert calm.ask("RR1.player.realTimeFactor") > 0.01


def test_names_from_files_stay_text(tab: Any, rr1: rp.Robot, tmp_path: FilePath) -> None:
    nasty = '</script><img src=x onerror="window.hacked=1"> \' <!--'
    flat = nasty.replace("/", "")
    scene = (
        rp.Scene(name=nasty, description=nasty).with_arm(flat, rr1).with_obstacle(flat + "2", rp.Box((0.1, 0.1, 0.1)))
    )
    panel = Panel(
        "own", nasty, html="<p id='told'></p>", script="root.querySelector('#told').textContent = data;", data=nasty
    )
    tab.open(save_html(tmp_path / "nasty.html", scene, options=rp.ViewOptions(panels=[panel])))
    assert tab.ask("document.title") == nasty
    assert tab.page.text_content("#title") == nasty
    assert tab.page.text_content("#told") == nasty
    assert tab.page.text_content("#joints summary span:last-child") == flat
    assert tab.ask("document.images.length") == 0
    assert tab.ask("window.hacked") is None
    assert len(tab.requests) == 1
    assert tab.complaints == []


def test_a_panel_sees_and_moves_the_arm(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    script = """
        const out = root.querySelector('output');
        viewer.on('change', (q, time, manual) => { out.textContent = `${q[0].toFixed(3)} ${manual}`; });
        root.querySelector('button').onclick = () => viewer.setQ(viewer.unpack(data).values);
    """
    panel = Panel(
        "lesson",
        "Lesson",
        html="<button>go</button><output></output>",
        script=script,
        data=pack_array([0.25, 0.5], "f8"),
    )
    tab.open(save_html(tmp_path / "panel.html", scene, options=rp.ViewOptions(panels=[panel])))
    tab.page.click("#panel-lesson button")
    assert tab.page.inner_text("#panel-lesson output") == "0.250 true"
    assert tab.complaints == []


def test_a_live_page_follows_the_program(tab: Any, two_arms: rp.Scene) -> None:
    with show(two_arms, trajectory=wander(two_arms), options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        tab.open(viewer.url)
        wait_until(tab.page, "RR1.live.socket && RR1.live.socket.readyState === 1")
        q = two_arms.configuration() + 0.125
        for i in range(50):
            viewer.update(q - 50 + i)
        viewer.update(q)
        wait_until(tab.page, f"Math.abs(RR1.q[0] - {q[0]}) < 1e-12")
        np.testing.assert_array_equal(tab.ask("Array.from(RR1.q)"), q)
        viewer.seek(2.0)
        wait_until(tab.page, "RR1.time === 2 && !RR1.manual")
        viewer.load(two_arms.without_obstacle("ball"), options=rp.ViewOptions(title="another"))
        wait_until(tab.page, "document.title === 'another'")
        assert tab.ask("RR1.document.obstacles.length") == len(two_arms.obstacles) - 1
        camera = "RR1.stage.camera.position.toArray()"
        tab.ask("RR1.look([1, 2, 0.5])")
        before = tab.ask(camera)
        viewer.load(two_arms.without_obstacle("ball").without_obstacle("ground"))
        wait_until(tab.page, f"RR1.document.obstacles.length === {len(two_arms.obstacles) - 2}")
        np.testing.assert_allclose(tab.ask(camera), before, atol=1e-9)
        robot = two_arms.arms["left"].robot
        viewer.load(rp.Scene(name="far").with_arm("arm", robot, [8.0, 0.0, 0.0]))
        wait_until(tab.page, "document.title === 'far'")
        assert tab.ask(COVERED) == []
        assert {url.split("?")[0] for url in tab.requests} <= {viewer.url, viewer.url.replace("http", "ws") + "updates"}
    wait_until(tab.page, "RR1.live.ended")
    status, title = (tab.page.locator(name).bounding_box() for name in ("#status", "#headline"))
    assert status["y"] > title["y"] + title["height"]
    assert tab.complaints == []


# The links that a card covers, or that are outside the window.
COVERED = """() => {
    const { camera, pane } = RR1.stage, box = pane.getBoundingClientRect();
    camera.updateMatrixWorld();
    const cards = ["headline", "side", "bar"].map((id) => document.getElementById(id).getBoundingClientRect());
    return Object.entries(RR1.poses(RR1.q)).filter(([, T]) => {
        const p = new RR1.THREE.Vector3(T[12], T[14], -T[13]).project(camera);
        const x = box.left + (p.x + 1) / 2 * box.width, y = box.top + (1 - p.y) / 2 * box.height;
        const inside = (r) => x > r.left && x < r.right && y > r.top && y < r.bottom;
        return !inside(box) || cards.some(inside);
    }).map(([name]) => name);
}"""


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (800, 600), (390, 844)])
def test_a_long_report_covers_no_arm(
    tab: Any, rr1_table: rp.Scene, tmp_path: FilePath, width: int, height: int
) -> None:
    start = rr1_table.configuration()
    away = start + np.array([0.0, 1.5, 0.8, 0.0, 0.0, 0.0])
    motion = rp.Trajectory.from_samples(rr1_table.joint_names(), [0.0, 1.0], [start, away])
    report = rp.validate(motion, rr1_table)
    assert len(report.violations) > 5
    tab.resize(width, height)
    options = rp.ViewOptions(play=False)
    tab.open(save_html(tmp_path / "page.html", rr1_table, trajectory=motion, report=report, options=options))
    assert tab.page.inner_text("#badge") == f"Invalid: {len(report.violations)} found"
    assert tab.page.locator("#report").is_visible() == (width >= 700)
    for t in (0.0, 0.5, 1.0):
        tab.ask("t => RR1.seek(t)", t)
        assert tab.ask(COVERED) == [], t
    assert tab.complaints == []


# Some seconds: four windows are drawn.
def test_both_ends_of_a_motion_are_seen_in_every_window(tab: Any, tmp_path: FilePath) -> None:
    motion = rp.plan_motion(next(iter(rp.load_problems("rr1_cluttered").values())), rng=0)
    file = motion.save_html(tmp_path / "motion.html", options=rp.ViewOptions(play=False))
    # What three.js' own rays meet between the camera and the tool, at each end.
    hidden = """t => {
        RR1.seek(RR1.player.start + t * RR1.duration);
        const eye = RR1.stage.camera.position, { THREE } = RR1, arm = RR1.kinematics.arms[0];
        const [x, y, z] = RR1.linkPose(`${arm.name}/${arm.robot.links[arm.robot.tool]}`).slice(12, 15);
        const to = new THREE.Vector3(x, z, -y);
        const ray = new THREE.Raycaster(eye, to.clone().sub(eye).normalize(), 0, eye.distanceTo(to) - 0.001);
        return ray.intersectObjects(RR1.world.obstacles.sets.map((set) => set.drawn), false).length;
    }"""
    tab.open(file)
    for width, height in ((1280, 800), (800, 600), (390, 844), (844, 390)):
        tab.resize(width, height)
        wait_until(tab.page, f"RR1.stage.renderer.domElement.clientWidth === {width}")
        for t in (0.0, 1.0):
            assert tab.ask(hidden, t) == 0, (width, height, t)
            assert tab.ask(COVERED) == [], (width, height, t)
    assert tab.complaints == []


@pytest.mark.drawn
def test_a_panda_behind_a_wall_is_seen(
    tab: Any, panda_and_wall: tuple[rp.Scene, rp.Trajectory, tuple[float, float, float]], tmp_path: FilePath
) -> None:
    scene, motion, before = panda_and_wall
    tab.resize(600, 420)

    def magenta() -> int:
        red, green, blue = np.moveaxis(tab.picture(), 2, 0)
        return int(((red > green + 60) & (blue > green + 60)).sum())

    def shown(view: Any) -> list[float]:
        """The part of the arm's pixels that the wall leaves, at three instants, in the first view."""
        options = rp.ViewOptions(view=view, play=False)
        tab.open(save_html(tmp_path / "page.html", scene, trajectory=motion, options=options))
        shares = []
        for t in (0.0, 0.5, 1.0):
            tab.ask("t => { RR1.seek(t); RR1.setShown('obstacles', true); }", t)
            seen = magenta()
            tab.ask("RR1.setShown('obstacles', false)")
            whole = magenta()
            assert whole > 800
            shares.append(seen / whole)
        return shares

    assert max(shown(before)) < 0.02
    assert min(shown(None)) > 0.95
    assert tab.complaints == []


def test_without_webgl_the_page_says_so_and_the_rest_works(tab: Any, page_file: FilePath, two_arms: rp.Scene) -> None:
    tab.disable_webgl()
    tab.open(page_file)
    assert "no WebGL" in tab.page.inner_text("#pane")
    assert tab.page.inner_text("#title") == "two"
    assert tab.page.inner_text("#badge") == "Invalid: 1 found"
    assert tab.page.locator("#toggles").is_hidden()
    # Cards do not cover the note, in the window of the tests and in that of a phone.
    for width, height in ((360, 740), (960, 640)):
        tab.resize(width, height)
        tab.next_frames()
        for words in ("#note h2", "#note p:last-child"):
            tab.page.locator(words).click(trial=True)
    tab.page.click("#report .violation")
    assert tab.ask("RR1.time") == 1.25
    np.testing.assert_allclose(tab.ask("Array.from(RR1.q)"), wander(two_arms)(1.25), atol=1e-6)
    assert tab.page.locator("#joints output").first.inner_text() == f"{np.degrees(wander(two_arms)(1.25)[0]):.1f}°"
    tab.page.click("#play")
    wait_until(tab.page, "RR1.time > 1.3")
    assert [c for c in tab.complaints if "WebGL" not in c] == []


def test_forced_colors_mark_pressed_buttons(tab: Any, page_file: FilePath) -> None:
    tab.page.emulate_media(forced_colors="active", color_scheme="dark")
    tab.open(page_file)
    tab.ask("RR1.editing.open()")
    grounds = "[...document.querySelectorAll('#loop, .act.drop')].map((node) => getComputedStyle(node).backgroundColor)"
    loop, drop = tab.ask(grounds)
    assert drop != loop
    tab.page.click(".act.drop")
    assert tab.ask(grounds) == [loop, loop]


def test_forced_colors_leave_marks_their_colors(tab: Any, page_file: FilePath) -> None:
    colors = """Object.entries({ "#marks button": "::before", ".act.start": "::before", ".act.goal": "::before",
        "#joints .swatch": null, "#report .meter i": null, "#report .meter b": null
    }).map(([part, pseudo]) => getComputedStyle(document.querySelector(part), pseudo).backgroundColor)"""
    tab.open(page_file)
    tab.ask("RR1.editing.open()")
    usual = tab.ask(colors)
    tab.page.emulate_media(forced_colors="active", color_scheme="dark")
    assert tab.ask(colors) == usual


def test_forced_colors_leave_the_picture_beside_the_cards(tab: Any, page_file: FilePath) -> None:
    rooms = "RR1.stage.rooms(RR1.stage.tiles()[0])"
    tab.open(page_file)
    beside = tab.ask(rooms)
    tab.page.emulate_media(forced_colors="active")
    assert tab.ask(rooms) == beside


def test_a_page_saved_from_the_browser_begins_anew(tab: Any, page_file: FilePath, tmp_path: FilePath) -> None:
    shape = (
        "['#pane > *', 'button', '#bar svg', '#side input', 'p'].map((part) => document.querySelectorAll(part).length)"
    )
    tab.open(page_file)
    before = tab.ask(shape)
    tab.page.keyboard.press("h")
    saved = tmp_path / "saved.html"
    saved.write_text("<!DOCTYPE html>" + tab.ask("document.documentElement.outerHTML"), encoding="utf-8")
    tab.open(saved)
    assert tab.ask(shape) == before
    assert tab.page.locator("#headline").is_visible()
    assert tab.complaints == []


def test_a_motion_without_a_report_is_called_not_checked(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r, [0.0, 0.0, 300.0])
    motion = rp.Trajectory(scene.joint_names(), [0.0, 1.0], [[[0.0, 0.0], [0.5, 0.2]]])
    tab.open(rp.save_html(tmp_path / "motion.html", scene, trajectory=motion, options=rp.ViewOptions(planner=False)))
    # Far above the ground, where no shadow would reach it.
    assert 299.0 < tab.ask("RR1.extent.floor") <= 300.0
    assert tab.page.inner_text("#badge") == "Not checked"
    tab.page.click("#badge")
    assert tab.page.inner_text("#report") == "Not checked: the motion – it came without a report."
    shapeless = replace(planar2r, links=tuple(replace(link, visuals=(), collisions=()) for link in planar2r.links))
    scene = rp.Scene().with_arm("arm", shapeless)
    tab.open(rp.save_html(tmp_path / "scene.html", scene, options=rp.ViewOptions(planner=False)))
    assert tab.page.locator("#badge").is_hidden()
    # Nothing else shows such an arm.
    assert tab.page.get_attribute("#toggles [data-layer=frames]", "aria-pressed") == "true"
    assert tab.ask("RR1.overlays.made.frames.group.visible && RR1.world.layers.frames.visible")
    assert tab.complaints == []


@pytest.mark.drawn
def test_the_picture_returns_with_its_lost_context(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    before = tab.bare_picture()
    # Neither the note nor its end frames the scene again, although there is more room for it without cards.
    tab.ask("document.body.classList.add('bare')")
    tab.ask("(window.lost = RR1.stage.renderer.getContext().getExtension('WEBGL_lose_context')).loseContext()")
    tab.page.locator("#note").wait_for(state="attached")
    tab.next_frames()
    tab.ask("lost.restoreContext()")
    tab.page.locator("#note").wait_for(state="detached")
    np.testing.assert_allclose(tab.picture(), before, atol=4)


@pytest.mark.drawn
def test_a_motion_plays_on_while_the_graphics_card_is_lost(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    # A quality at which shadows are not drawn in each frame, and a clock that hardly moves.
    tab.ask("() => { RR1.pace.count = () => {}; RR1.pace.level = 2; RR1.setSpeed(0.01); RR1.seek(0.1); RR1.play(); }")
    before = tab.bare_picture()
    tab.ask("(window.lost = RR1.stage.renderer.getContext().getExtension('WEBGL_lose_context')).loseContext()")
    wait_until(tab.page, "RR1.stage.renderer.getContext().isContextLost()")
    tab.next_frames()
    tab.ask("lost.restoreContext()")
    tab.page.locator("#note").wait_for(state="detached")
    tab.next_frames()
    assert np.abs(tab.bare_picture() - before).mean() < 2.0
    assert tab.complaints == []


def test_a_note_says_that_the_graphics_card_is_lost(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    tab.ask("(window.lost = RR1.stage.renderer.getContext().getExtension('WEBGL_lose_context')).loseContext()")
    tab.page.wait_for_selector("#note")
    assert "has stopped the 3-D view" in tab.page.inner_text("#pane")
    tab.page.locator("#note h2").click(trial=True)
    assert tab.page.locator("#pane canvas").is_hidden()
    tab.ask("lost.restoreContext()")
    tab.page.locator("#note").wait_for(state="detached")
    assert tab.page.locator("#pane canvas").is_visible()


@pytest.mark.drawn
def test_paper_shows_the_page_as_the_window_does(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    pdf = tab.page.pdf()
    assert pdf.count(b"/Type /Page\n") == 1
    # What stands in for the picture, whose drawing buffer is empty on paper.
    colors = """() => {
        dispatchEvent(new Event("beforeprint"));
        const { width, height } = RR1.printing.copy, pen = RR1.printing.copy.getContext("2d");
        const { data } = pen.getImageData(0, 0, width, height), found = new Set();
        for (let i = 0; i < data.length; i += 4) found.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
        const shown = document.querySelectorAll(".printed").length;
        dispatchEvent(new Event("afterprint"));
        return [found.size, shown, document.querySelectorAll(".printed").length];
    }"""
    count, during, after = tab.ask(colors)
    assert count > 500
    assert (during, after) == (1, 0)
    assert tab.complaints == []


@pytest.mark.parametrize(
    ("size", "place", "unit"), [(100.0, "25.000 m", "m"), (0.05, "12.5 mm", "mm"), (0.005, "1.25 mm", "mm")]
)
def test_lengths_have_a_unit_and_digits_for_their_size(
    tab: Any, tmp_path: FilePath, size: float, place: str, unit: str
) -> None:
    arm = rp.planar_arm("PR", (size, 0.25 * size), width=0.03 * size, limits=[[0.0, size], None])
    scene = rp.Scene().with_arm("arm", arm).with_obstacle("crate", rp.Box([0.05 * size] * 3), [0, 0.6 * size, 0])
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [[0.25 * size, 0.0], [0.75 * size, 0.1]])
    tab.open(rp.save_html(tmp_path / "page.html", scene, trajectory=motion, options=rp.ViewOptions(play=False)))
    assert tab.ask("document.querySelector('.joint output').textContent") == place
    curves = "key => RR1.plots.source.curves(RR1.plots.arm, key).map((curve) => [curve.unit, curve.at(0)])"
    scale = {"m": 1, "mm": 1000}[unit]
    assert tab.ask(curves, "position")[0] == [unit, pytest.approx(0.25 * scale * size)]
    assert tab.ask(curves, "clearance")[0][0] == unit
    assert 0.2 * scale * size < tab.ask(curves, "clearance")[0][1] < 0.8 * scale * size
    assert tab.complaints == []
