"""The configuration-space page that plans by itself: obstacles, start and goal are dragged, and everything follows."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid, compute_grid
from rr1plan.playback.viewer.page_capture import wait_until
from rr1plan.scene.model_library import load_problems
from rr1plan.transforms import pose

pytestmark = pytest.mark.browser

READY = "Boolean(window.RR1 && RR1.ready && RR1.lesson)"
LIVE = f"{READY} && Boolean(RR1.lesson.live)"
CELLS = 120
TURN = 2.0 * np.pi


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    """The query of the lesson, with a box and a pyramid in addition to its discs."""
    asked = load_problems("planar2r_path")["over_the_seam"]
    corners = [[-0.1, -0.1, -0.1], [0.2, -0.1, -0.1], [0.0, 0.2, -0.1], [0.0, 0.0, 0.1]]
    pyramid = rp.Mesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], convex=True)
    scene = asked.scene.with_obstacle("box", rp.Box((0.3, 0.1, 0.2)), pose([-1.4, 0.9, 0], rpy=[0, 0, 0.5]))
    return rp.Problem(scene.with_obstacle("pyramid", pyramid, [1.5, -0.9, 0.0]), asked.start, asked.goal)


@pytest.fixture(scope="module")
def page_file(problem: rp.Problem, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    result = rp.RrtConnect(tree=True).plan(problem, rng=0)
    picture = rp.cspace(problem.scene, problem, result=result, resolution=CELLS)
    return picture.save_html(tmp_path_factory.mktemp("live") / "live.html", options=rp.ViewOptions(play=False))


@pytest.fixture(scope="module")
def opened(shared_tab: Any, page_file: FilePath) -> Any:
    shared_tab.resize(1280, 720)
    shared_tab.open(page_file, LIVE)
    return shared_tab


@pytest.fixture
def fresh(opened: Any) -> Iterator[Any]:
    """The page in its initial state."""
    opened.ask(
        "delete RR1.planner.plan, delete RR1.lesson.live.background.plan, delete RR1.lesson.live.background.cancel"
    )
    opened.ask("RR1.lesson.phase.hidden || RR1.lesson.tools.phase.click(), RR1.plots.open && RR1.plots.toggle()")
    opened.ask("RR1.lesson.edits.past.length && RR1.lesson.edits.restore(RR1.lesson.edits.first)")
    wait_for_answer(opened)
    opened.ask("RR1.lesson.edits.past = [], RR1.lesson.edits.select(null)")
    opened.ask("document.activeElement.blur(), RR1.pause()")
    yield opened
    assert opened.complaints == []


def in_view(tab: Any, point: Any) -> tuple[float, float]:
    """The pixel of the page where a point of the plane is drawn."""
    x, y = tab.ask(
        """([x, y]) => {
            const { camera, pane } = RR1.stage, box = pane.getBoundingClientRect();
            camera.updateMatrixWorld();
            const p = new RR1.THREE.Vector3(x, 0, -y).project(camera);
            return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height];
        }""",
        [float(v) for v in point[:2]],
    )
    return float(x), float(y)


def camera_at_rest(tab: Any) -> Any:
    """The position of the camera after its damped motion."""
    # As many updates as a page makes in some seconds: rounding moves the camera until then.
    tab.ask("() => { for (let i = 0; i < 500; i++) RR1.stage.controls.update(); }")
    return tab.ask("RR1.stage.camera.position.toArray()")


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


def wait_for_answer(tab: Any) -> None:
    wait_until(tab.page, "!RR1.lesson.edits.planning")


def drag(tab: Any, begin: tuple[float, float], end: tuple[float, float], *, drop: bool = True) -> None:
    tab.page.mouse.move(*begin)
    tab.page.mouse.down()
    tab.page.mouse.move(0.6 * begin[0] + 0.4 * end[0], 0.6 * begin[1] + 0.4 * end[1])
    tab.page.mouse.move(*end)
    wait_until(tab.page, "!RR1.lesson.edits.waiting")
    wait_for_answer(tab)
    if drop:
        tab.page.mouse.up()
        wait_for_answer(tab)


def place(tab: Any, name: str) -> np.ndarray:
    return np.array(tab.ask("name => RR1.lesson.edits.obstaclePlace(name)", name))


def moved_scene(tab: Any, scene: rp.Scene) -> rp.Scene:
    """The scene in the state of the page."""
    for name in scene.obstacles:
        pose = np.reshape(tab.ask("name => Array.from(RR1.planner.obstaclePose(name))", name), (4, 4)).T
        scene = scene.with_obstacle_at(name, pose)
    return scene


def check_cells(tab: Any, scene: rp.Scene) -> CSpaceGrid:
    """The page's cells and components are those of Python's grid of the moved scene, bit for bit."""
    grid = compute_grid(moved_scene(tab, scene), resolution=CELLS)
    bits = np.array(tab.ask("Array.from(RR1.lesson.cells.bits)")).reshape(grid.free.shape)
    for k, (name, mask) in enumerate(grid.layers.items()):
        assert np.array_equal((bits >> k & 1).astype(bool), mask), name
    labels = np.array(tab.ask("Array.from(RR1.lesson.cells.labels)"))[: bits.size]
    both = np.unique(np.stack([labels, grid.labels.ravel()]), axis=1)
    assert both.shape[1] == len(np.unique(both[0])) == len(np.unique(both[1]))
    return grid


def verdict(tab: Any) -> str:
    return str(tab.page.locator(".verdict").inner_text())


def waypoints(tab: Any) -> np.ndarray:
    return np.reshape(tab.ask("Array.from(RR1.lesson.answer.shortened.waypoints.values)"), (-1, 2))


def check_path(tab: Any, scene: rp.Scene) -> None:
    """The path that the page has found is certified free by Python, and leads from its start to its goal."""
    found = waypoints(tab)
    checker = CollisionChecker(moved_scene(tab, scene))
    assert checker.path_is_free(found)
    ends = np.array(tab.ask("[RR1.lesson.live.start, RR1.lesson.live.goals[0]].map((q) => Array.from(q))"))
    off = found[[0, -1]] - ends
    np.testing.assert_allclose(off - TURN * np.round(off / TURN), 0.0, atol=1e-9)


def test_the_page_is_sealed_and_plans(fresh: Any, page_file: FilePath) -> None:
    assert fresh.requests == [page_file.as_uri()]
    policy = fresh.page.locator("meta[http-equiv]").first.get_attribute("content")
    assert "'wasm-unsafe-eval'" in policy
    assert "'unsafe-eval'" not in policy
    assert fresh.page.locator(".fixed").is_hidden()


@pytest.mark.parametrize(
    ("name", "to"),
    [
        ("red", [0.9, -0.2]),
        ("box", [-0.5, 0.1]),  # into the reach of the first link
        ("pyramid", [0.9, 0.75]),  # over another one
        ("yellow", [-1.75, -1.3]),  # out of reach
    ],
)
def test_a_dragged_obstacle_takes_its_image_with_it(
    fresh: Any, problem: rp.Problem, name: str, to: list[float]
) -> None:
    at, target = place(fresh, name), np.array(to)
    view = camera_at_rest(fresh)
    drag(fresh, in_view(fresh, at), in_view(fresh, target), drop=False)
    np.testing.assert_allclose(place(fresh, name), target, atol=0.02)
    check_cells(fresh, problem.scene)
    fresh.page.mouse.up()
    wait_for_answer(fresh)
    # The camera stays, and the drawn obstacle is where the planner has it.
    assert fresh.ask("RR1.stage.camera.position.toArray()") == view
    assert not fresh.ask("RR1.lesson.arm.turned")
    items = "RR1.world.obstacles.sets.flatMap((set) => set.items)"
    drawn = fresh.ask(f"(name) => [...{items}.find((item) => item.element === name).local.slice(12, 14)]", name)
    assert np.linalg.norm(np.array(drawn) - place(fresh, name)) < 0.2
    if fresh.ask("Boolean(RR1.lesson.answer && RR1.lesson.answer.track)"):
        check_path(fresh, problem.scene)
        assert fresh.ask("RR1.duration") == pytest.approx(fresh.ask("RR1.lesson.track.end"))
        assert fresh.page.locator("#badge").text_content() == "Planned here, certified free"
    fresh.page.keyboard.press("Control+z")
    np.testing.assert_allclose(place(fresh, name), at, atol=1e-12)
    check_cells(fresh, problem.scene)


def test_the_verdict_turns_from_path_to_proven_no_path_and_back(fresh: Any, problem: rp.Problem) -> None:
    # Two discs near the base block the first joint in both directions.
    fresh.ask(
        "RR1.lesson.edits.remember(), RR1.lesson.edits.moveObstacle('red', 0.15, 0.7), "
        "RR1.lesson.edits.moveObstacle('blue', -0.45, -0.62)"
    )
    fresh.ask("RR1.lesson.edits.drop()")
    assert verdict(fresh).startswith("No path exists: start and goal are free, but in different components")
    assert "proven by certified cells" in verdict(fresh)
    assert fresh.page.locator(".verdict.bad").count() == 1
    assert fresh.ask("RR1.duration") == 0.0
    grid = check_cells(fresh, problem.scene)
    asked = rp.Problem(grid.scene, problem.start, problem.goal)
    assert rp.cspace(grid.scene, asked, resolution=CELLS).proves_no_path
    fresh.page.keyboard.press("Control+z")
    wait_for_answer(fresh)
    assert verdict(fresh).startswith("Start and goal lie in the same component of free space")
    assert "certified free" in verdict(fresh)
    check_path(fresh, problem.scene)


def test_a_blocked_start_is_named(fresh: Any) -> None:
    fresh.ask("RR1.lesson.edits.remember(), RR1.lesson.edits.moveObstacle('green', 0.5, 0.1), RR1.lesson.edits.drop()")
    assert verdict(fresh) == "The start is not free: green."


def test_start_and_goal_are_dragged_in_the_configuration_space(fresh: Any, problem: rp.Problem) -> None:
    drag(fresh, on_canvas(fresh, problem.start), on_canvas(fresh, [0.6, -1.9]))
    np.testing.assert_allclose(fresh.ask("Array.from(RR1.lesson.live.start)"), [0.6, -1.9], atol=0.03)
    np.testing.assert_allclose(
        fresh.ask("Array.from(RR1.q)"), fresh.ask("Array.from(RR1.lesson.live.start)"), atol=1e-9
    )
    (target,) = problem.goal["arm"]
    drag(fresh, on_canvas(fresh, target.q), on_canvas(fresh, [2.9, 2.2]))
    np.testing.assert_allclose(fresh.ask("Array.from(RR1.lesson.live.goals[0])"), [2.9, 2.2], atol=0.03)
    check_path(fresh, problem.scene)
    fresh.page.keyboard.press("o")
    np.testing.assert_allclose(fresh.ask("Array.from(RR1.lesson.live.start)"), problem.start)


@pytest.mark.parametrize("end", ["touchCancel", "touchStart"])
def test_a_drag_that_is_canceled_or_given_to_the_camera_moves_nothing(fresh: Any, end: str) -> None:
    session = fresh.page.context.new_cdp_session(fresh.page)

    def touch(kind: str, *fingers: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(fingers)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    camera_at_rest(fresh)
    q, before = fresh.ask("Array.from(RR1.q)"), place(fresh, "violet")
    for at in (in_view(fresh, before), in_view(fresh, fresh.ask("RR1.lesson.arm.flat.tool([...RR1.q])"))):
        x, y = at
        touch("touchStart", (x, y))
        for far in (10, 20, 30):
            touch("touchMove", (x - far, y))
        fresh.next_frames()
        assert fresh.ask("Boolean(RR1.lesson.drags.held)")
        touch(end, *([(x - 30, y), (x + 60, y)] if end == "touchStart" else []))
        wait_for_answer(fresh)
        np.testing.assert_allclose(place(fresh, "violet"), before, atol=1e-12)
        np.testing.assert_allclose(fresh.ask("Array.from(RR1.q)"), q, atol=1e-9)
        if end == "touchStart":
            touch("touchEnd")
    assert fresh.ask("RR1.lesson.edits.past.length") == 0
    fresh.ask("RR1.lesson.arm.turned = false, RR1.lesson.arm.look()")


def test_links_turn_about_their_joints(fresh: Any) -> None:
    fresh.ask("RR1.setQ([0.2, -0.9])")
    elbow, tool = np.array(fresh.ask("RR1.lesson.arm.flat.places([0.2, -0.9])"))[1:]
    drags = (0.5 * elbow, np.array([0.5, 0.35])), (0.5 * (elbow + tool), elbow + np.array([0.3, 0.1]))
    for link, (middle, end) in enumerate(drags):
        fresh.ask("RR1.setQ([0.2, -0.9])")
        drag(fresh, in_view(fresh, middle), in_view(fresh, end))
        q = np.array(fresh.ask("Array.from(RR1.q)"))
        assert q[1 - link] == pytest.approx([0.2, -0.9][1 - link])
        away = end - (elbow if link else 0.0)
        heading = q[0] + (q[1] if link else 0.0)
        assert heading == pytest.approx(np.arctan2(away[1], away[0]), abs=0.06)
    assert not fresh.ask("RR1.lesson.arm.turned")


def test_the_keyboard_moves_obstacles_and_sets_start_and_goal(fresh: Any, problem: rp.Problem) -> None:
    fresh.page.keyboard.press("j")
    name = fresh.ask("RR1.lesson.edits.selected")
    assert name in problem.scene.obstacles
    assert name in fresh.page.locator(".said").inner_text()
    before = place(fresh, name)
    for key in ("ArrowRight", "Shift+ArrowUp", "<"):
        fresh.page.keyboard.press(key)
    np.testing.assert_allclose(place(fresh, name) - before, [0.017, 0.085], atol=1e-9)
    check_cells(fresh, problem.scene)
    fresh.page.keyboard.press("Escape")
    assert fresh.ask("RR1.lesson.edits.selected") is None
    fresh.ask("RR1.setQ([0.4, -1.2])")
    fresh.page.keyboard.press("a")
    np.testing.assert_allclose(fresh.ask("Array.from(RR1.lesson.live.start)"), [0.4, -1.2])
    for _ in range(4):
        fresh.page.keyboard.press("Control+z")
    np.testing.assert_allclose(place(fresh, name), before, atol=1e-12)
    np.testing.assert_allclose(fresh.ask("Array.from(RR1.lesson.live.start)"), problem.start)


def test_a_playing_motion_plays_on_after_edits_by_keyboard(fresh: Any) -> None:
    fresh.page.keyboard.press("j")
    for key in ("ArrowRight", "Control+z"):
        # A clock that hardly moves does not reach the end of the motion meanwhile.
        fresh.ask("RR1.setSpeed(0.01), RR1.play()")
        fresh.ask("window.played = RR1.editing.motion, 0")
        fresh.page.keyboard.press(key)
        wait_for_answer(fresh)
        assert fresh.ask("RR1.editing.motion !== played && RR1.playing"), key
    fresh.ask("RR1.setSpeed(1)")


def test_data_of_another_panel_leaves_the_query_as_it_is(fresh: Any) -> None:
    fresh.ask("RR1.lesson.edits.remember(), RR1.lesson.edits.moveObstacle('violet', 0.7, -1.0)")
    fresh.ask("RR1.lesson.edits.drop()")
    path, said = waypoints(fresh), verdict(fresh)
    fresh.ask("RR1.fillPanels({ measurements: { force: 3 } })")
    assert fresh.ask("Boolean(RR1.lesson.live) && RR1.lesson.edits.past.length === 1")
    assert waypoints(fresh).tobytes() == path.tobytes()
    assert verdict(fresh) == said


def test_new_data_of_the_program_leave_the_page_editable(fresh: Any) -> None:
    hashed = "(row) => row.reduce((sum, v, k) => (31 * sum + v + k) % 1e9, 0)"
    sums = f"[RR1.lesson.cells.bits, RR1.lesson.cells.labels].map({hashed})"
    original = fresh.ask(sums)
    fresh.ask("RR1.lesson.edits.remember(), RR1.lesson.edits.moveObstacle('violet', 0.7, -1.0, 0.3)")
    wait_for_answer(fresh)
    moved = fresh.ask(sums)
    assert moved != original
    fresh.ask("RR1.fillPanels({ cspace: { goalNames: ['goal'] } })")
    wait_until(fresh.page, LIVE)
    wait_for_answer(fresh)
    assert fresh.ask(sums) == moved  # the obstacle stands where it was dragged
    fresh.ask("RR1.lesson.edits.reset()")
    wait_for_answer(fresh)
    assert fresh.ask(sums) == original


def test_the_same_drag_has_the_same_answer(fresh: Any) -> None:
    paths = []
    for _ in range(2):
        fresh.ask("RR1.lesson.edits.moveObstacle('violet', 0.7, -1.0)")
        paths.append(waypoints(fresh))
        fresh.ask("RR1.lesson.edits.moveObstacle('violet', 0.6, -1.3)")
    assert paths[0].tobytes() == paths[1].tobytes()
    fresh.ask("RR1.lesson.edits.remember(), RR1.lesson.edits.drop()")


_QUERY = "seed: 0, iterations: 4000, step: 0.15"


def test_a_worker_plans_what_the_page_would_plan(fresh: Any) -> None:
    # Searches in the page do not succeed within a moment.
    fresh.ask("() => { RR1.planner.plan = () => ({ status: 'timeout' }); RR1.lesson.edits.remember(); }")
    assert fresh.ask("RR1.lesson.edits.moveObstacle('violet', 0.7, -1.0)")
    fresh.ask("delete RR1.planner.plan")
    numbers = "(({ trees, track }) => [trees.map((tree) => [...tree.vertices.values]), [...track.coefficients.values]])"
    own = f"RR1.planner.plan(RR1.lesson.live.start, RR1.lesson.live.goals[0], {{ {_QUERY} }})"
    assert fresh.ask(f"{numbers}(RR1.lesson.answer)") == fresh.ask(f"{numbers}({own})")
    assert fresh.ask("RR1.lesson.live.background.isParallel")


def test_slow_planning_is_announced_canceled_and_overtaken(fresh: Any) -> None:
    # The worker reports a step and never answers.
    fresh.ask(
        """() => {
            const { background } = RR1.lesson.live;
            background.plan = (start, goal, options, report) => new Promise((resolve) => {
                background.cancel = () => resolve(null);
                report("1,000 iterations");
            });
        }"""
    )
    fresh.page.keyboard.press("p")
    wait_until(fresh.page, "document.querySelector('.verdict').textContent.startsWith('Planning … 1,000')")
    fresh.next_frames()
    fresh.page.keyboard.press("Escape")
    assert verdict(fresh) == "Planning canceled."
    assert fresh.ask("RR1.lesson.edits.planning") is None
    fresh.page.keyboard.press("p")
    fresh.page.keyboard.press("p")
    assert verdict(fresh) == "Planning canceled."
    fresh.ask("() => { window.first = RR1.lesson.edits.update(); }")
    fresh.ask("() => { delete RR1.lesson.live.background.plan; }")
    assert fresh.ask("RR1.lesson.edits.update()")
    assert not fresh.ask("first")
    assert verdict(fresh).startswith("Start and goal lie in the same component")


def test_without_workers_the_page_plans_itself(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script("window.Worker = class { constructor() { throw new Error('no workers'); } };")
    tab.open(page_file, LIVE)
    assert tab.ask("RR1.lesson.edits.moveObstacle('violet', 0.7, -1.0)")
    assert not tab.ask("RR1.lesson.live.background.isParallel")
    assert "certified free" in verdict(tab)
    assert tab.complaints == []


def test_the_phase_plane_stays_below_its_limit_curve_and_touches_it(fresh: Any) -> None:
    fresh.page.keyboard.press("p")
    wait_for_answer(fresh)
    fresh.page.keyboard.press("f")
    wait_until(fresh.page, "Boolean(RR1.lesson.plane)")
    plane = {
        k: np.array(v)
        for k, v in fresh.ask(
            "Object.fromEntries(Object.entries(RR1.lesson.plane).map(([k, v]) => [k, Array.from(v)]))"
        ).items()
    }
    s, speed, limit = plane["s"], plane["speed"], plane["limit"]
    assert (speed <= limit * (1 + 1e-3) + 1e-6).all()
    assert speed[0] < 0.02
    assert speed[-1] < 0.02
    assert (speed > 0.98 * limit).sum() > 20
    # The area below is the duration's: dt = ds / speed.
    inside = 0.5 * (speed[1:] + speed[:-1]) > 0.05
    assert (np.diff(s)[inside] / (0.5 * (speed[1:] + speed[:-1]))[inside]).sum() == pytest.approx(
        fresh.ask("RR1.duration"), rel=0.1
    )
    assert fresh.page.locator(".phase canvas").is_visible()
    fresh.page.keyboard.press("f")
    assert fresh.page.locator(".phase").is_hidden()


def test_the_phase_plane_covers_neither_plots_nor_the_reach(fresh: Any) -> None:
    fresh.page.keyboard.press("p")
    wait_for_answer(fresh)
    fresh.page.keyboard.press("f")
    fresh.page.click("#plotter")
    fresh.next_frames()
    phase, plots = (fresh.page.locator(part).bounding_box() for part in (".phase", "#plots"))
    left = in_view(fresh, [-1.7, 0.0])[0]
    fresh.page.click("#plotter")
    fresh.page.keyboard.press("f")
    assert phase["y"] + phase["height"] <= plots["y"]
    assert left > phase["x"] + phase["width"]


@pytest.mark.drawn
def test_the_torus_shows_the_image_and_a_click_moves_the_arm(tab: Any, page_file: FilePath) -> None:
    tab.resize(1280, 720)
    tab.open(page_file, LIVE)
    tab.page.keyboard.press("d")
    wait_until(tab.page, "Boolean(RR1.lesson.torus && !RR1.lesson.torus.asked)")
    pixels = np.asarray(Image.open(io.BytesIO(tab.page.locator("canvas.torus").screenshot())).convert("RGB"), int)
    red, blue = ((pixels - np.array(color))[..., [0, 2]] for color in ((181, 83, 74), (74, 122, 166)))
    assert ((np.abs(red) < 40).all(axis=-1) & (pixels[..., 0] > pixels[..., 2] + 50)).sum() > 300
    assert ((np.abs(blue) < 40).all(axis=-1) & (pixels[..., 2] > pixels[..., 0] + 50)).sum() > 300
    box = tab.page.locator("canvas.torus").bounding_box()
    before = np.array(tab.ask("Array.from(RR1.q)"))
    tab.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.75 * box["height"])
    after = np.array(tab.ask("Array.from(RR1.q)"))
    assert np.abs(after - before).max() > 0.05
    # The near side of the torus, on which the eye looks.
    assert abs((after[0] + np.pi - tab.ask("RR1.lesson.torus.turn[0]") + np.pi) % TURN - np.pi) < 0.2
    # A press that the system has taken over no longer turns it.
    turned = tab.ask("RR1.lesson.torus.turn")
    tab.page.mouse.down()
    tab.ask("RR1.lesson.torus.canvas.dispatchEvent(new PointerEvent('pointercancel', { isPrimary: true }))")
    tab.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"])
    assert tab.ask("RR1.lesson.torus.turn") == turned
    tab.page.mouse.up()
    tab.page.keyboard.press("d")
    assert tab.page.locator("canvas.torus").count() == 0
    assert tab.page.locator(".plot > canvas").is_visible()
    assert tab.complaints == []


def test_tool_links_and_manipulability_are_on_the_screen(fresh: Any) -> None:
    fresh.ask("RR1.setQ([0.3, Math.PI / 2])")
    words = fresh.page.locator(".readout").inner_text()
    tool = np.array(fresh.ask("RR1.linkPose('arm/tool').slice(12, 14)"))
    for expected in (f"{tool[0]:.3f} m", f"{tool[1]:.3f} m", "0.700 m²", "1.00 m, 0.70 m"):
        assert expected.replace("-", "−") in words
    twin = fresh.ask("RR1.lesson.chart.twin")
    fresh.page.mouse.move(*on_canvas(fresh, TURN * np.array(twin) - np.pi))
    assert "other elbow" in fresh.page.locator(".tip").inner_text()


def test_the_numbers_cover_neither_the_badge_nor_the_reach(fresh: Any) -> None:
    fresh.page.keyboard.press("p")
    wait_for_answer(fresh)
    fresh.ask("RR1.lesson.arm.look()")
    badge, numbers = (fresh.page.locator(part).bounding_box() for part in ("#badge", ".readout"))
    assert badge["y"] + badge["height"] <= numbers["y"]
    assert in_view(fresh, [0.0, 1.7])[1] > numbers["y"] + numbers["height"]


def test_without_simd_the_page_says_so_and_plays_as_before(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script("WebAssembly.validate = () => false")
    tab.resize(1280, 720)
    tab.open(page_file, READY)
    wait_until(tab.page, "!document.querySelector('.fixed').hidden")
    assert tab.page.locator(".fixed").inner_text() == (
        "Obstacles stand still on this page: this browser has no WebAssembly SIMD."
    )
    assert tab.ask("RR1.lesson.live") is None
    view = tab.ask("RR1.stage.camera.position.toArray()")
    at = in_view(tab, [-1.1, -0.75])
    tab.page.mouse.move(*at)
    tab.page.mouse.down()
    tab.page.mouse.move(at[0] + 80, at[1] + 40, steps=4)
    tab.page.mouse.up()
    wait_until(tab.page, f"RR1.stage.camera.position.x !== {view[0]}")
    assert verdict(tab).startswith("Start and goal lie in the same component")
    tab.page.mouse.click(*on_canvas(tab, [1.0, -2.0]))
    np.testing.assert_allclose(tab.ask("Array.from(RR1.q)"), [1.0, -2.0], atol=0.02)
    assert tab.complaints == []


def test_a_page_without_a_planner_is_as_before(tab: Any, problem: rp.Problem, tmp_path: FilePath) -> None:
    options = rp.ViewOptions(play=False, planner=False)
    file = rp.cspace(problem.scene, problem, resolution=24).save_html(tmp_path / "still.html", options=options)
    assert "wasm-unsafe-eval" not in file.read_text().split("</head>")[0]
    tab.open(file, READY)
    assert tab.page.locator(".fixed").is_hidden()
    assert tab.ask("RR1.lesson.live") is None
    assert tab.complaints == []


def test_the_picture_stays_under_a_finger_while_the_verdict_gets_longer(tab: Any, page_file: FilePath) -> None:
    tab.resize(412, 915)
    tab.open(page_file, LIVE)
    begin = on_canvas(tab, tab.ask("RR1.lesson.live.goals[0]"))
    aim = [1.9, -2.2]
    end = on_canvas(tab, aim)
    drag(tab, begin, end, drop=False)
    tab.ask("document.querySelector('#panel-cspace .verdict').textContent = 'longer '.repeat(60)")
    np.testing.assert_allclose(on_canvas(tab, aim), end)
    np.testing.assert_allclose(tab.ask("RR1.lesson.live.goals[0]"), aim, atol=0.02)
    tab.page.mouse.up()
    assert not tab.ask("document.getElementById('panels').style.height")
    assert tab.complaints == []
