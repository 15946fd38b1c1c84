"""The lesson page in a real browser: sliders, clicks, hovering, the tree, the proof that there is no path."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

import rr1plan as rp
from rr1plan.playback.cspace.cspace_colors import ink_on, layer_patterns, pattern_cells
from rr1plan.playback.cspace.cspace_verdict import verdict
from rr1plan.playback.viewer.page_capture import wait_until
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene.model_library import load_problems

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.lesson)"
CELLS = 90


@pytest.fixture(scope="module")
def lesson() -> rp.CSpace:
    problem = load_problems("planar2r_path")["over_the_seam"]
    result = rp.RrtConnect(tree=True).plan(problem, rng=0)
    assert result.found
    assert result.tree is not None
    return rp.cspace(problem.scene, problem, result=result, resolution=CELLS)


@pytest.fixture(scope="module")
def page_file(lesson: rp.CSpace, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    return lesson.save_html(tmp_path_factory.mktemp("lesson") / "lesson.html", options=rp.ViewOptions(play=False))


@pytest.fixture(scope="module")
def opened(shared_tab: Any, page_file: FilePath) -> Any:
    shared_tab.resize(1280, 720)
    shared_tab.open(page_file, READY)
    return shared_tab


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    opened.ask("document.activeElement.blur(), RR1.pause(), RR1.seek(0)")
    opened.ask("RR1.lesson.showTree = true, RR1.lesson.tinted = false, RR1.lesson.pauseTree()")
    opened.ask("RR1.lesson.growTo(RR1.lesson.tree.length), RR1.lesson.repaint()")
    opened.page.mouse.move(2, 2)
    yield opened
    assert opened.complaints == []


def shown(tab: Any) -> np.ndarray:
    """The two joint values of the 3-D arm."""
    return np.array(tab.ask("Array.from(RR1.q)"))


def on_canvas(tab: Any, q: Any) -> tuple[float, float]:
    """The pixel of the page where a configuration is drawn."""
    x, y = tab.ask(
        """([a, b]) => {
            const { plot, ratio, canvas } = RR1.lesson.chart, box = canvas.getBoundingClientRect();
            const u = (a + Math.PI) / (2 * Math.PI), v = (b + Math.PI) / (2 * Math.PI);
            return [box.left + (plot.x + u * plot.size) / ratio, box.top + (plot.y + (1 - v) * plot.size) / ratio];
        }""",
        [float(v) for v in q],
    )
    return float(x), float(y)


def in_view(tab: Any, point: Any) -> tuple[float, float]:
    """The pixel of the page where a point of the world is drawn."""
    x, y = tab.ask(
        """([x, y, z]) => {
            const { camera, pane } = RR1.stage, box = pane.getBoundingClientRect();
            camera.updateMatrixWorld();
            const p = new RR1.THREE.Vector3(x, z, -y).project(camera);
            return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height];
        }""",
        [float(v) for v in point],
    )
    return float(x), float(y)


def near(pixels: np.ndarray, color: str, tolerance: int = 12) -> np.ndarray:
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return np.asarray(np.abs(pixels - wanted).max(axis=2) <= tolerance)


def check_arm(tab: Any, scene: rp.Scene, q: np.ndarray) -> None:
    """The page's kinematics place every link like ours."""
    expected = scene.link_poses({"arm": q})
    for name, T in expected.items():
        found = np.reshape(tab.ask("n => RR1.linkPose(n)", name), (4, 4)).T
        np.testing.assert_allclose(found, T, atol=1e-6)


def test_the_page_asks_nobody_for_anything(opened: Any, page_file: FilePath) -> None:
    assert opened.requests == [page_file.as_uri()]
    assert opened.complaints == []


def test_every_cell_reached_the_page(calm: Any, lesson: rp.CSpace) -> None:
    grid = lesson.grid
    bits = np.array(calm.ask("Array.from(RR1.lesson.cells.bits)")).reshape(grid.free.shape)
    for k, mask in enumerate(grid.layers.values()):
        assert (((bits >> k) & 1).astype(bool) == mask).all()
    labels = np.array(calm.ask("Array.from(RR1.lesson.cells.labels)"))[: bits.size].reshape(bits.shape)
    assert ((labels > 0) == grid.free).all()


def test_obstacles_images_are_drawn_in_their_own_colors_and_patterns(calm: Any, lesson: rp.CSpace) -> None:
    calm.ask("RR1.lesson.showTree = false, RR1.lesson.redraw()")
    pixels = calm.cspace_picture()
    calm.ask("RR1.lesson.showTree = true, RR1.lesson.redraw()")
    area = calm.ask("(RR1.lesson.chart.plot.size / RR1.lesson.chart.ratio) ** 2")
    for name, mask in lesson.grid.layers.items():
        color = lesson.grid.scene.obstacles[name].geometries[0].color
        text = "#{:02x}{:02x}{:02x}".format(*(round(255 * c) for c in color[:3]))
        # Overlaps are shared among their layers, and the path covers a little.
        plain, ink = near(pixels, text).sum(), near(pixels, to_hex(ink_on(text))).sum()
        assert plain + ink == pytest.approx(mask.mean() * area, rel=0.25)
        pattern = layer_patterns(lesson.grid)[name]
        inked = pattern_cells(pattern, (360, 360)).mean()
        assert ink / (plain + ink) == pytest.approx(inked, abs=0.08)
        assert (inked > 0.05) == (pattern > 0)


def test_a_slider_moves_the_arm_and_the_mark(calm: Any, lesson: rp.CSpace) -> None:
    before = calm.cspace_picture()
    slider = calm.page.locator("#cspace-0")
    slider.focus()
    q = shown(calm)
    for _ in range(8):
        calm.page.keyboard.press("ArrowLeft")
    moved = shown(calm)
    assert moved[0] == pytest.approx(q[0] - 8 * np.pi / 360, abs=np.pi / 360)
    assert moved[1] == pytest.approx(q[1])
    check_arm(calm, lesson.grid.scene, moved)
    after = calm.cspace_picture()
    x, y = on_canvas(calm, moved)
    box = calm.page.locator("#panel-cspace canvas").bounding_box()
    spot = after[round(y - box["y"]), round(x - box["x"])]
    assert near(spot[None, None], "#e4500e", 20).all()
    assert (before != after).any()


def test_a_click_puts_the_arm_there_and_a_drag_wraps_over_the_seam(calm: Any, lesson: rp.CSpace) -> None:
    for q in ([-1.0, 0.4], [2.9, -2.5], [-3.0, 3.0]):
        calm.page.mouse.click(*on_canvas(calm, q))
        np.testing.assert_allclose(shown(calm), q, atol=0.02)
        check_arm(calm, lesson.grid.scene, shown(calm))
        assert float(calm.page.locator("#cspace-0").input_value()) == pytest.approx(q[0], abs=0.02)
    calm.page.mouse.move(*on_canvas(calm, [3.0, 0.0]))
    calm.page.mouse.down()
    calm.page.mouse.move(*on_canvas(calm, [3.3, 0.0]))
    calm.page.mouse.up()
    np.testing.assert_allclose(shown(calm), [3.3 - 2 * np.pi, 0.0], atol=0.02)


def test_the_keyboard_moves_the_arm(calm: Any) -> None:
    calm.page.locator("#panel-cspace canvas").focus()
    q = shown(calm)
    calm.page.keyboard.press("ArrowRight")
    calm.page.keyboard.press("Shift+ArrowUp")
    np.testing.assert_allclose(shown(calm) - q, [np.pi / 180, 10 * np.pi / 180], atol=1e-9)
    assert calm.ask("RR1.time") == 0.0


def test_hovering_says_what_forbids_a_cell(calm: Any, lesson: rp.CSpace) -> None:
    grid = lesson.grid
    for name in ("yellow", "violet", "red"):
        alone = grid.layers[name] & (sum(m.astype(int) for m in grid.layers.values()) == 1)
        i, j = deep_inside(alone)
        calm.page.mouse.move(*on_canvas(calm, [grid.axes[0][i], grid.axes[1][j]]))
        assert calm.page.locator(".tip b").inner_text() == f"blocked by {name}"
    overlap = grid.layers["red"] & grid.layers["blue"]
    i, j = deep_inside(overlap)
    calm.page.mouse.move(*on_canvas(calm, [grid.axes[0][i], grid.axes[1][j]]))
    assert calm.page.locator(".tip b").inner_text() == "blocked by red and blue"
    i, j = deep_inside(grid.free)
    calm.page.mouse.move(*on_canvas(calm, [grid.axes[0][i], grid.axes[1][j]]))
    assert calm.page.locator(".tip b").inner_text() == "free"
    calm.page.mouse.move(2, 2)
    assert calm.page.locator(".tip").is_hidden()


def deep_inside(mask: np.ndarray) -> tuple[int, int]:
    """The cell of a mask farthest from its rim."""
    from scipy.ndimage import distance_transform_edt

    i, j = np.unravel_index(np.argmax(distance_transform_edt(np.pad(mask, 1))), np.add(mask.shape, 2))
    return int(i) - 1, int(j) - 1


def test_the_badge_says_whether_the_arm_is_free_and_the_arm_turns_red(calm: Any, lesson: rp.CSpace) -> None:
    state = calm.page.locator("#panel-cspace .state")
    assert state.inner_text() == "free"
    i, j = deep_inside(lesson.grid.layers["yellow"])
    calm.page.mouse.click(*on_canvas(calm, [lesson.grid.axes[0][i], lesson.grid.axes[1][j]]))
    assert state.inner_text() == "blocked by yellow"
    assert calm.ask("RR1.lesson.blocked")
    # A long name leaves room for the title.
    state.evaluate("node => { node.textContent = 'blocked by ' + 'a very long name of an obstacle '.repeat(9); }")
    title, badge, panel = (
        calm.page.locator(part).bounding_box() for part in ("#panel-cspace h2", "#panel-cspace .state", "#panel-cspace")
    )
    assert title["x"] + title["width"] <= badge["x"]
    assert badge["x"] + badge["width"] < panel["x"] + panel["width"]
    calm.page.mouse.click(*on_canvas(calm, lesson.start))
    assert state.inner_text() == "free"
    assert not calm.ask("RR1.lesson.blocked")
    np.testing.assert_allclose(shown(calm), lesson.start, atol=1e-9)  # a click on the mark selects the mark


def test_the_mark_follows_the_clock(calm: Any, lesson: rp.CSpace) -> None:
    calm.ask("RR1.seek(0.4 * RR1.duration)")
    q = shown(calm)
    np.testing.assert_allclose(q, calm.ask("Array.from(RR1.at(0.4 * RR1.duration))"))
    wrapped = (q + np.pi) % (2 * np.pi) - np.pi
    x, y = on_canvas(calm, wrapped)
    box = calm.page.locator("#panel-cspace canvas").bounding_box()
    assert near(calm.cspace_picture()[round(y - box["y"]), round(x - box["x"])][None, None], "#e4500e", 20).all()


def test_a_path_over_the_seam_is_drawn_on_both_sides(calm: Any, lesson: rp.CSpace) -> None:
    assert np.abs(lesson.path).max() > np.pi
    assert "over the seam" in calm.page.locator(".verdict").inner_text()
    calm.ask("RR1.lesson.showTree = false, RR1.lesson.redraw()")
    with_path = calm.cspace_picture()
    calm.ask("RR1.lesson.kept = RR1.lesson.curve, RR1.lesson.curve = [], RR1.lesson.redraw()")
    without = calm.cspace_picture()
    calm.ask("RR1.lesson.curve = RR1.lesson.kept, RR1.lesson.showTree = true, RR1.lesson.redraw()")
    changed = (np.abs(with_path - without).max(axis=2) > 30).any(axis=0)
    x, size = calm.ask("(({ plot, ratio }) => [plot.x / ratio, plot.size / ratio])(RR1.lesson.chart)")
    left, right = round(x) + 3, round(x + size) - 3
    assert changed[left : left + 4].any()
    assert changed[right - 4 : right].any()


def test_the_tree_can_be_hidden_and_grown(calm: Any, lesson: rp.CSpace) -> None:
    edges = len(lesson.tree.edges)
    assert calm.ask("RR1.lesson.tree.length") == edges
    whole = calm.cspace_picture()
    calm.page.locator("[data-tool=tree]").click()
    calm.page.mouse.move(2, 2)
    hidden = calm.cspace_picture()
    assert (np.abs(whole - hidden).max(axis=2) > 40).sum() > 200
    slider = calm.page.locator("#panel-cspace .grow input")
    slider.fill(str(edges // 2))
    half = calm.cspace_picture()
    ink = [(np.abs(p - hidden).max(axis=2) > 40).sum() for p in (half, whole)]
    assert 0.1 * ink[1] < ink[0] < 0.9 * ink[1]
    calm.page.keyboard.press("g")
    wait_until(calm.page, f"RR1.lesson.grown === {edges}")
    assert (calm.cspace_picture() == whole).all()


def test_the_tree_grows_from_its_roots(calm: Any, lesson: rp.CSpace) -> None:
    """At every stage of its growth, every edge is connected to the start or a goal."""
    pieces = calm.ask("RR1.lesson.tree.map((copies) => copies[0])")
    first = np.array([pieces[0][0], pieces[0][1]])
    span = 2 * np.pi
    roots = [(np.asarray(q) + np.pi) / span for q in (lesson.start, *lesson.goals)]
    turns = [np.abs((end - root + 0.5) % 1.0 - 0.5).max() for end in first for root in roots]
    assert min(turns) < 1e-5


def test_the_elbow_flips_and_the_tool_stays(calm: Any, lesson: rp.CSpace) -> None:
    tool = calm.ask("RR1.linkPose('arm/tool').slice(12, 14)")
    q = shown(calm)
    calm.page.locator("[data-tool=elbow]").click()
    np.testing.assert_allclose(calm.ask("RR1.linkPose('arm/tool').slice(12, 14)"), tool, atol=1e-9)
    flipped = shown(calm)
    assert flipped[1] == pytest.approx(-q[1])
    calm.page.keyboard.press("e")
    np.testing.assert_allclose(shown(calm), q, atol=1e-9)
    for goal in lesson.goals:
        calm.page.mouse.click(*on_canvas(calm, goal))
        np.testing.assert_allclose(shown(calm), goal, atol=1e-9)


def test_a_click_and_a_drag_in_the_workspace_bring_the_tool_there(calm: Any) -> None:
    def tool() -> np.ndarray:
        return np.array(calm.ask("RR1.linkPose('arm/tool').slice(12, 15)"))

    for target in ([0.5, 0.9, 0.0], [-1.0, 0.3, 0.0]):
        calm.page.mouse.click(*in_view(calm, target))
        np.testing.assert_allclose(tool(), target, atol=0.01)
    calm.page.mouse.move(*in_view(calm, tool()))
    calm.page.mouse.down()
    calm.page.mouse.move(*in_view(calm, [-0.9, -0.6, 0.0]), steps=4)
    np.testing.assert_allclose(tool(), [-0.9, -0.6, 0.0], atol=0.01)
    calm.page.mouse.move(*in_view(calm, [-0.1, 0.0, 0.0]))  # too near: as near as the arm can
    calm.page.mouse.up()
    assert np.linalg.norm(tool()) == pytest.approx(0.3, abs=1e-6)
    assert not calm.ask("RR1.lesson.workspace.turned")


def test_components_get_colors(calm: Any) -> None:
    plain = calm.cspace_picture()
    calm.page.keyboard.press("c")
    tinted = calm.cspace_picture()
    calm.page.keyboard.press("c")
    assert near(plain, "#cfe0fb", 2).sum() < 100
    assert near(tinted, "#cfe0fb", 2).sum() > 20_000
    assert (calm.cspace_picture() == plain).all()


def test_where_no_path_exists_the_page_says_so_in_two_colors(tab: Any, tmp_path: FilePath) -> None:
    problem = load_problems("planar2r_no_path")["no_way"]
    picture = rp.cspace(problem.scene, problem, resolution=CELLS)
    file = picture.save_html(tmp_path / "none.html", options=rp.ViewOptions(title="<b>no & way</b>"))
    tab.resize(1280, 720)
    tab.open(file, READY)
    said = tab.page.locator(".verdict").inner_text()
    assert said.startswith("No path exists")
    assert "proven by certified cells" in said
    pixels = tab.cspace_picture()
    assert near(pixels, "#cfe0fb", 2).sum() > 10_000
    assert near(pixels, "#cdeedb", 2).sum() > 10_000
    assert tab.page.locator(".grow").is_hidden()
    assert tab.page.title() == "<b>no & way</b>"
    assert tab.complaints == []
    assert tab.requests == [file.as_uri()]
    # Nothing is cut off on the smallest projector.
    assert tab.ask("(p => p.scrollHeight <= p.clientHeight)(document.getElementById('panels'))")


def test_a_timed_motion_plays_on_its_own_clock(tab: Any, lesson: rp.CSpace, tmp_path: FilePath) -> None:
    trajectory = rp.retime(rp.Path(("arm/joint1", "arm/joint2"), lesson.path), lesson.grid.scene)
    file = lesson.save_html(tmp_path / "timed.html", trajectory=trajectory, options=rp.ViewOptions(play=False))
    tab.open(file, READY)
    assert tab.ask("RR1.duration") == pytest.approx(trajectory.duration)
    tab.ask("t => RR1.seek(t)", trajectory.duration / 3)
    np.testing.assert_allclose(shown(tab), trajectory(trajectory.duration / 3), atol=1e-5)
    assert tab.complaints == []


def test_the_phase_plane_appears_once_the_planner_is_loaded(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene(name="PR").with_arm("arm", rp.planar_arm("PR"))
    motion = rp.retime(rp.Path(scene.joint_names(), [[0.1, 0.5], [0.3, -0.5]]), scene)
    file = rp.cspace(scene, resolution=40).save_html(tmp_path / "phase.html", trajectory=motion)
    tab.record_texts()
    tab.open(file, READY)
    # As if the button was pressed before.
    tab.ask("RR1.planner = null, RR1.lesson.tools.phase.click()")
    assert "No limits of joints: the page has no planner" in tab.ask("texts")
    tab.ask("RR1.loadPlanner(RR1.document)")
    wait_until(tab.page, "RR1.planner && RR1.lesson.plane")
    tab.next_frames()
    assert any(text.endswith(" m and rad") for text in tab.ask("texts"))
    assert tab.complaints == []


@pytest.mark.parametrize(
    ("limits", "marks"),
    [
        ([(-2.0, 1.0), (0.1, 2.3)], {"−π/2", "−π/4", "0", "π/4", "π/2"}),
        ([(-0.4, 0.4), (0.1, 0.3)], {"−π/8", "0", "π/8", "0.2", "[rad]"}),
    ],
)
def test_short_ranges_of_angles_have_a_scale(
    tab: Any, limits: list[tuple[float, float]], marks: set[str], tmp_path: FilePath
) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", limits=limits), q=(0.0, 0.2))
    tab.record_texts()
    tab.open(rp.cspace(scene, resolution=40).save_html(tmp_path / "short.html"), READY)
    assert marks <= set(tab.ask("texts"))
    assert tab.complaints == []


def test_two_joints_of_a_bigger_arm_have_their_page_too(tab: Any, rr1_table: rp.Scene, tmp_path: FilePath) -> None:
    picture = rp.cspace(rr1_table, joints=("shoulder_joint", "elbow_joint"), resolution=32)
    tab.open(picture.save_html(tmp_path / "rr1.html"), READY)
    start = shown(tab)
    i, j = deep_inside(picture.grid.free)
    columns = tab.ask(
        "RR1.lesson.cells && RR1.joints.map((n) => n.endsWith('/shoulder_joint') || n.endsWith('/elbow_joint'))"
    )
    low, high = (np.array([a[k] for a in picture.grid.axes]) for k in (0, -1))
    q = np.array([picture.grid.axes[0][i], picture.grid.axes[1][j]])
    half = 0.5 * (high - low) / 31
    part = (q - low + half) / (high - low + 2 * half)
    tab.page.mouse.click(*on_canvas(tab, -np.pi + 2 * np.pi * part))
    np.testing.assert_allclose(shown(tab)[columns], q, atol=0.05)
    assert (shown(tab)[~np.array(columns)] == start[~np.array(columns)]).all()
    assert tab.page.locator("#panel-cspace .state").inner_text() == "free"
    assert tab.page.locator("[data-tool=elbow]").is_hidden()
    assert tab.complaints == []


def test_a_live_page_redraws_both_spaces_for_another_scene(tab: Any, rr1_table: rp.Scene) -> None:
    """Cells, names, marks, verdict, badge, sliders and the arm in the plane are all of the scene that is shown."""
    path_scene, no_path = load_problems("planar2r_path")["over_the_seam"], load_problems("planar2r_no_path")["no_way"]
    first = rp.cspace(path_scene.scene, path_scene, result=rp.plan(path_scene, rng=0), resolution=48)

    def seen(expression: str, expected: Any) -> None:
        wait_until(tab.page, f"JSON.stringify({expression}) === JSON.stringify({json.dumps(expected)})")

    with first.show(options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        tab.open(viewer.url, READY)
        wait_until(tab.page, "RR1.live.socket && RR1.live.socket.readyState === 1")
        assert tab.page.locator(".verdict").inner_text().startswith("Start and goal lie in the same")
        # Another scene without a query: nothing of the old query remains.
        emptied = path_scene.scene.without_obstacle("red").without_obstacle("green")
        viewer.load(emptied)
        second = rp.cspace(emptied, resolution=48)
        seen("Array.from(RR1.lesson.cells.bits).filter((b) => b === 0).length", int(second.grid.free.sum()))
        assert tab.page.locator("#panel-cspace .legend").inner_text().split() == ["blue", "yellow", "violet"]
        assert tab.page.locator(".verdict").inner_text() == verdict(second)
        assert tab.ask("RR1.lesson.curve.length") == 0
        i, j = deep_inside(first.grid.layers["red"] & (first.grid.layers["blue"] == 0))
        tab.page.mouse.click(*on_canvas(tab, [first.grid.axes[0][i], first.grid.axes[1][j]]))
        assert tab.page.locator("#panel-cspace .state").inner_text() == "free"
        # With another query.
        viewer.load(no_path.scene, problem=no_path)
        wait_until(tab.page, "document.querySelector('.verdict').classList.contains('bad')")
        assert tab.page.locator(".verdict").inner_text().startswith("No path exists")
        assert near(tab.cspace_picture(), "#cdeedb", 2).sum() > 5_000
        # An arm that is not flat, and back by a picture of its own resolution.
        viewer.load(rp.cspace(rr1_table, joints=("shoulder_joint", "elbow_joint"), resolution=16))
        seen("RR1.lesson.cells.n", 16)
        assert tab.page.locator("[data-tool=elbow]").is_hidden()
        assert "lesson" not in (tab.page.locator("body").get_attribute("class") or "")
        assert tab.page.locator(".pair.shown").inner_text().count("shoulder_joint") == 1
        chosen = np.array(tab.ask("RR1.document.camera.direction"))
        np.testing.assert_allclose(looked_from(tab), chosen / np.linalg.norm(chosen), atol=1e-2)
        viewer.load(first)
        seen("RR1.lesson.cells.n", 48)
        wait_until(tab.page, "!document.querySelector('[data-tool=elbow]').hidden")
        assert tab.page.locator(".verdict").inner_text() == verdict(first)
        # A page that connects later shows the same.
        tab.page.reload()
        wait_until(tab.page, READY)
        seen("Array.from(RR1.lesson.cells.bits).filter((b) => b === 0).length", int(first.grid.free.sum()))
    assert tab.complaints == []


@pytest.mark.parametrize(("width", "height", "radius"), [(800, 600, 170), (1024, 600, 170), (390, 844, 90)])
def test_both_pictures_are_large_in_a_small_window(
    tab: Any, page_file: FilePath, width: int, height: int, radius: int
) -> None:
    tab.resize(width, height)
    tab.open(page_file, READY)
    base, reach = (in_view(tab, [x, 0.0, 0.0]) for x in (0.0, 1.7))
    assert reach[0] - base[0] > radius
    assert reach[0] < width
    assert min(base[1], tab.page.locator("#bar").bounding_box()["y"] - base[1]) > radius
    canvas = tab.page.locator("#panel-cspace canvas").bounding_box()
    assert min(canvas["width"], canvas["height"]) > 0.4 * min(width, height)
    assert canvas["y"] + canvas["height"] <= height
    tools = [tab.page.locator(f"#panel-cspace {part}").bounding_box() for part in (".verdict", ".tools", ".grow")]
    assert all(box["x"] >= 0.0 and box["x"] + box["width"] <= width for box in tools)
    # On a phone the tools may need scrolling; the answer never does.
    assert max(box["y"] + box["height"] for box in (tools if width > height else tools[:1])) <= height
    card = tab.page.locator("#panel-cspace").bounding_box()
    assert max(box["y"] + box["height"] for box in tools) < card["y"] + card["height"]
    assert tab.complaints == []


def looked_from(tab: Any) -> np.ndarray:
    """The direction of the world from which the camera looks."""
    x, y, z = tab.ask("RR1.stage.camera.position.clone().sub(RR1.stage.controls.target).normalize().toArray()")
    return np.array([x, -z, y])


@pytest.mark.parametrize(("view", "direction"), [(None, [0, 0, 1]), ("corner", [1, -1, 0.8]), ((0, 0.5), None)])
def test_a_planar_arm_is_looked_at_from_above_or_from_the_view_that_is_given(
    tab: Any, lesson: rp.CSpace, tmp_path: FilePath, view: Any, direction: Any
) -> None:
    tab.open(lesson.save_html(tmp_path / "page.html", options=rp.ViewOptions(view=view)), READY)
    expected = np.array([np.cos(0.5), 0.0, np.sin(0.5)] if direction is None else direction, dtype=float)
    np.testing.assert_allclose(looked_from(tab), expected / np.linalg.norm(expected), atol=1e-2)
    assert tab.complaints == []


def test_without_a_path_the_arm_stands_at_the_start_and_both_ends_are_seen(tab: Any, tmp_path: FilePath) -> None:
    """A ball that slides along x and y; as the scene has it, it is inside a wall that is much larger."""
    x, y, _ = np.eye(3)
    joints = (
        Joint("x", "prismatic", "base", "slide", axis=x, lower=-1, upper=1),
        Joint("y", "prismatic", "slide", "hand", axis=y, lower=-1, upper=1),
    )
    ball = Link("hand", collisions=(Geometry("ball", rp.Sphere(0.05)),))
    ones = np.ones(2)
    robot = Robot(
        "gantry",
        (Link("base"), Link("slide"), ball),
        joints,
        ("x", "y"),
        Limits(-ones, *[ones] * 5),
        {"home": np.zeros(2)},
        {},
        frozenset(),
        "hand",
    )
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("wall", rp.Box((0.1, 3.0, 0.4)))
    picture = rp.cspace(scene, rp.Problem(scene, [-0.8, -0.5], [0.8, 0.5]), resolution=24)
    tab.resize(1280, 800)
    tab.open(picture.save_html(tmp_path / "page.html"), READY)
    np.testing.assert_allclose(shown(tab), [-0.8, -0.5])
    assert tab.page.locator("#panel-cspace .state").inner_text() == "free"
    pane = tab.page.locator("#pane").bounding_box()
    hidden = """([x, y, z]) => {
        const eye = RR1.stage.camera.position, to = new RR1.THREE.Vector3(x, z, -y);
        const ray = new RR1.THREE.Raycaster(eye, to.clone().sub(eye).normalize(), 0, eye.distanceTo(to));
        return ray.intersectObjects(RR1.world.obstacles.sets.map((set) => set.drawn), false).length;
    }"""
    for end in ([-0.8, -0.5, 0.0], [0.8, 0.5, 0.0]):
        across, down = in_view(tab, end)
        assert pane["x"] < across < pane["x"] + pane["width"]
        assert pane["y"] < down < pane["y"] + pane["height"]
        assert tab.ask(hidden, end) == 0
    # The wall has no color of its own: it gets that of its image.
    assert tab.page.locator("#panel-cspace .legend").inner_text() == "wall"
    image = tab.page.locator(".legend i").evaluate("(dot) => getComputedStyle(dot).backgroundColor")
    drawn = tab.ask("RR1.document.obstacles[0].parts[0].color.slice(0, 3).map((c) => Math.round(255 * c))")
    assert image == f"rgb({', '.join(map(str, drawn))})"
    assert tab.complaints == []


def written(tab: Any) -> tuple[dict[str, np.ndarray], list[float]]:
    """Labels in the configuration space: left, top, right and bottom of each text, and of the picture."""
    rows, plot = tab.ask("""() => {
        const usual = CanvasRenderingContext2D.prototype.fillText, rows = [], { plot } = RR1.lesson.chart;
        CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
            const wide = this.measureText(text).width, before = { center: 0.5, right: 1 }[this.textAlign] || 0;
            const left = x - before * wide;
            const tall = 0.35 * parseFloat(this.font.match(/([\\d.]+)px/)[1]);
            rows.push([text, [left, y - tall, left + wide, y + tall]]);
            usual.call(this, text, x, y);
        };
        RR1.lesson.redraw();
        CanvasRenderingContext2D.prototype.fillText = usual;
        return [rows, [plot.x, plot.y, plot.x + plot.size, plot.y + plot.size]];
    }""")
    return {text: np.array(box) for text, box in rows}, plot


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (800, 600)])
def test_names_are_whole_in_the_picture(
    tab: Any, rr1_table: rp.Scene, tmp_path: FilePath, width: int, height: int
) -> None:
    picture = rp.cspace(rr1_table, joints=("shoulder_joint", "elbow_joint"), resolution=40)
    tab.resize(width, height)
    tab.open(picture.save_html(tmp_path / "slice.html"), READY)
    texts, plot = written(tab)
    names = [box for text, box in texts.items() if text in picture.grid.layers]
    assert len(names) >= 2
    assert all(plot[0] <= left and right <= plot[2] for left, _, right, _ in names)


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (390, 844)])
def test_very_long_names_stay_in_the_pictures_and_in_their_card(
    tab: Any, tmp_path: FilePath, width: int, height: int
) -> None:
    name = "the upper rail of the conveyor " + "beside_the_press_" * 6
    scene = rp.Scene(name="long").with_arm("arm", rp.planar_arm("RR"))
    scene = scene.with_obstacle(name, rp.Sphere(0.2), [1.2, 0.0, 0.0])
    tab.resize(width, height)
    tab.open(rp.cspace(scene, resolution=CELLS).save_html(tmp_path / "long.html"), READY)
    texts, plot = written(tab)
    (label,) = (text for text in texts if text.startswith("the upper rail"))
    assert plot[0] <= texts[label][0] < texts[label][2] <= plot[2]
    tag = "(({ scale }) => scale.x / scale.y)([...RR1.lesson.arm.tags.values()][0].tag)"
    assert tab.ask(tag) < 20  # as wide as 40 letters at most
    chip = tab.page.locator("#panel-cspace .legend .chip")
    assert chip.inner_text() == name
    panel, box = (node.bounding_box() for node in (tab.page.locator("#panel-cspace"), chip))
    assert box["x"] + box["width"] <= panel["x"] + panel["width"]
    assert tab.complaints == []


def test_a_long_title_leaves_the_workspace_its_room_in_a_small_window(tab: Any, tmp_path: FilePath) -> None:
    name = "A very long name of a scene, with the press, the conveyor and the shelf behind it"
    scene = rp.Scene(name=name).with_arm("arm", rp.planar_arm("RR"))
    tab.resize(640, 360)  # as at a zoom of 200 %
    tab.open(rp.cspace(scene, resolution=40).save_html(tmp_path / "title.html"), READY)
    base, reach = (in_view(tab, [x, 0.0, 0.0]) for x in (0.0, 1.8))
    assert reach[0] - base[0] > 75
    assert base[1] - (reach[0] - base[0]) > tab.page.locator(".readout").bounding_box()["y"]
    assert tab.complaints == []


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (800, 600)])
def test_goals_are_not_written_over_names(tab: Any, tmp_path: FilePath, width: int, height: int) -> None:
    problem = load_problems("planar2r_path")["to_a_point"]
    picture = rp.cspace(problem.scene, problem, resolution=CELLS)
    tab.resize(width, height)
    tab.open(picture.save_html(tmp_path / "point.html"), READY)
    texts, plot = written(tab)
    assert {"goal, IK 1", "goal, IK 2", "start", "green"} <= set(texts)
    for mark in ("goal, IK 1", "goal, IK 2", "start"):
        left, top, right, bottom = texts[mark]
        assert plot[0] <= left < right <= plot[2]
        assert plot[1] <= top < bottom <= plot[3]
        for name in picture.grid.layers:
            box = texts[name]
            assert right < box[0] or box[2] < left or bottom < box[1] or box[3] < top, (mark, name)


@pytest.mark.parametrize("kinds", ["RP", "PP"])
def test_names_of_axes_stand_between_their_marks(kinds: str, tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene(name=kinds).with_arm("arm", rp.planar_arm(kinds, (1.0, 0.8)))
    tab.open(rp.cspace(scene, resolution=40).save_html(tmp_path / "axes.html"), READY)
    texts, _ = written(tab)
    assert {"0", "0.2", "0.4", "0.6", "0.8"} <= set(texts)
    for name in ("θ₁" if kinds == "RP" else "d₁ [m]", "d₂", "[m]"):
        left, top, right, bottom = texts[name]
        for text, box in texts.items():
            assert text == name or right < box[0] or box[2] < left or bottom < box[1] or box[3] < top, (name, text)
    assert tab.page.is_visible(".readout .links") == (kinds == "RP")  # a gantry has no lengths
    assert tab.complaints == []


@pytest.mark.parametrize(
    ("travel", "unit", "label"),
    [
        ((0.0, 0.004), "[mm]", "4"),
        ((0.0, 1e-4), "[mm]", "0.08"),
        ((-0.15, 0.15), "[m]", "−0.15"),
        ((-2e3, 2e3), "[m]", "−2000"),
    ],
)
def test_numbers_of_axes_are_whole(
    tab: Any, tmp_path: FilePath, travel: tuple[float, float], unit: str, label: str
) -> None:
    arm = rp.planar_arm("PP", (travel[1], travel[1]), limits=(travel, travel))
    scene = rp.Scene(name="axes").with_arm("arm", arm)
    tab.open(rp.cspace(scene, resolution=CELLS).save_html(tmp_path / "axes.html"), READY)
    texts, _ = written(tab)
    assert {unit, label} <= set(texts)
    assert min(left for left, *_ in texts.values()) >= 0.0
    assert tab.complaints == []


def test_of_names_that_overlap_the_first_one_is_shown(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene(name="crowded").with_arm("arm", rp.planar_arm("RR"))
    for name, place in {"one": [1.2, 0.0, 0.0], "two": [1.2, 0.08, 0.0], "three": [-1.2, 0.0, 0.0]}.items():
        scene = scene.with_obstacle(name, rp.Sphere(0.05), place)
    tab.resize(1280, 720)
    tab.open(rp.cspace(scene, resolution=CELLS).save_html(tmp_path / "crowded.html"), READY)
    names = "[...RR1.lesson.arm.tags].filter(([, { tag }]) => tag.visible).map(([name]) => name)"
    tab.next_frames()
    assert tab.ask(names) == ["one", "three"]
    # Seen along the line through them, all overlap.
    tab.ask("RR1.look([-1, 0, 0.05])")
    tab.next_frames()
    assert tab.ask(names) == ["one"]
    assert tab.complaints == []


def test_names_at_the_edges_of_a_small_window_are_whole(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene(name="edges").with_arm("arm", rp.planar_arm("RR"))
    for side, x in (("left", -1.6), ("right", 1.6)):
        scene = scene.with_obstacle(f"a long name on the {side}", rp.Sphere(0.05), (x, 0.0, 0.0))
    tab.resize(390, 844)
    tab.open(rp.cspace(scene, resolution=CELLS).save_html(tmp_path / "edges.html"), READY)
    # Both ends of each name, -1 and 1 at the edges of the picture.
    ends = tab.ask("""[...RR1.lesson.arm.tags.values()].flatMap(({ tag }) => {
        const { camera } = RR1.stage, place = tag.getWorldPosition(new RR1.THREE.Vector3());
        const at = place.applyMatrix4(camera.matrixWorldInverse), size = tag.scale.x / -at.z;
        const wide = size * camera.projectionMatrix.elements[0], { x } = at.applyMatrix4(camera.projectionMatrix);
        return [x - tag.center.x * wide, x + (1 - tag.center.x) * wide];
    })""")
    assert np.abs(ends).max() <= 1.0 + 1e-6
    assert tab.complaints == []


def test_names_are_readable_in_a_small_window_and_from_afar(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene(name="small").with_arm("arm", rp.planar_arm("RR"))
    scene = scene.with_obstacle("one", rp.Sphere(0.05), (1.2, 0.0, 0.0))
    tab.resize(390, 844)
    tab.open(rp.cspace(scene, resolution=CELLS).save_html(tmp_path / "small.html"), READY)
    # Height [px] of the name's picture, two thirds of which are letters.
    height = """(() => {
        const { camera, pane } = RR1.stage, { tag } = RR1.lesson.arm.tags.get("one");
        const at = tag.getWorldPosition(new RR1.THREE.Vector3()).applyMatrix4(camera.matrixWorldInverse);
        return (-0.5 * pane.clientHeight * tag.scale.y * camera.projectionMatrix.elements[5]) / at.z;
    })()"""
    for distance in (1, 3):
        tab.ask(f"() => {{ RR1.stage.camera.position.multiplyScalar({distance}); RR1.redraw(); }}")
        tab.next_frames()
        assert tab.ask(height) > 16.0
    assert tab.complaints == []


@pytest.mark.parametrize("kinds", ["PP", "RP"])
def test_the_ends_of_sliding_joints_are_in_the_picture(tab: Any, kinds: str, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm(kinds, (0.8, 0.6)))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.05, 0.1), (-1.0, -1.0, 0.0))
    tab.open(rp.cspace(scene, resolution=40).save_html(tmp_path / "page.html"))
    drag = """([k, end]) => {
        const slider = document.getElementById(`cspace-${k}`);
        slider.value = slider[end];
        slider.dispatchEvent(new Event("input", { bubbles: true }));
        const state = document.querySelector("#panel-cspace .state");
        return [slider.parentElement.querySelector("output").textContent, state.textContent];
    }"""
    ends = {"min": "0.0 mm", "max": "600.0 mm"}
    assert {end: tab.ask(drag, [1, end]) for end in ends} == {end: [text, "free"] for end, text in ends.items()}
    if kinds == "PP":
        assert tab.ask(drag, [0, "max"]) == ["800.0 mm", "free"]
    assert tab.complaints == []


def test_two_fingers_zoom_the_workspace_and_leave_the_arm(calm: Any) -> None:
    session = calm.page.context.new_cdp_session(calm.page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        spots = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": spots})
        calm.next_frames()

    q, far = shown(calm), "RR1.stage.camera.position.distanceTo(RR1.stage.controls.target)"
    before = calm.ask(far)
    x, y = in_view(calm, [*calm.ask("RR1.lesson.arm.flat.places(Array.from(RR1.q))[2]"), 0.0])
    touch("touchStart", (x, y))
    touch("touchStart", (x, y), (x - 40, y))
    for spread in (20, 40, 60, 80):
        touch("touchMove", (x + spread / 4, y), (x - 40 - spread, y))
    touch("touchEnd")
    np.testing.assert_array_equal(shown(calm), q)
    assert calm.ask(far) < 0.8 * before
    calm.ask("RR1.lesson.arm.turned = false, RR1.lesson.arm.look()")
    # In the configuration space the arm follows the first finger only.
    spot, other = on_canvas(calm, [-0.5, 0.4]), on_canvas(calm, [0.5, -2.0])
    touch("touchStart", spot)
    first = shown(calm)
    touch("touchStart", spot, other)
    touch("touchMove", spot, (other[0] + 30, other[1] + 30))
    np.testing.assert_array_equal(shown(calm), first)
    touch("touchEnd")


def test_a_phone_can_fit_the_view_and_show_the_keys_without_a_motion(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    tab.resize(390, 844)
    tab.open(rp.cspace(scene, resolution=20).save_html(tmp_path / "page.html"), READY)
    tab.page.click("#home")
    assert tab.ask("RR1.framed") == "whole"
    tab.page.click("#bar .help")
    assert tab.page.locator("#help").is_visible()
    assert tab.complaints == []
