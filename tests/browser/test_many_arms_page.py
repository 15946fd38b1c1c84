"""Pages of many arms: levels of detail for slow drawing, colors, conflicts on the time line."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from drawn_links import DRAWN_LINKS, link_boxes, wander
from matplotlib.colors import to_rgb
from PIL import Image

import rr1plan as rp
from rr1plan import save_html
from rr1plan.playback.arm_colors import arm_color
from rr1plan.playback.viewer.page_capture import wait_until
from rr1plan.report import Margin, Report, Violation

pytestmark = pytest.mark.browser


def contact(one: str, other: str, time: float) -> Violation:
    return Violation("collision", (one, other), time, -0.004, 0.0, f"{one} is 4 mm inside {other}")


@pytest.fixture(scope="module")
def grid(rr1: rp.Robot) -> rp.Scene:
    return rp.place_grid(rr1, 5, 6, spacing=0.8)


@pytest.fixture(scope="module")
def page_file(grid: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    first, second, third = list(grid.arms)[:3]
    touching = (
        contact(f"{first}/hand_link", f"{second}/forearm_link", 1.0),
        contact(f"{second}/hand_link", f"{third}/hand_link", 2.5),
    )
    report = Report(touching, {"clearance": Margin(-0.004, "m", touching[0].subject, 1.0)}, ("collision",), {}, 3.0)
    motion = wander(grid)
    problem = rp.Problem(grid, None, {first: motion(3.0)[:6]})
    file = tmp_path_factory.mktemp("many") / "page.html"
    return save_html(file, grid, trajectory=motion, problem=problem, report=report, options=rp.ViewOptions(play=False))


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    opened.ask("RR1.pause(), RR1.point(0, [])")
    yield opened
    assert opened.complaints == []


def picture(tab: Any, level: int | None, **changes: object) -> tuple[np.ndarray, int]:
    """The picture at a quality level with changes, None for the still picture, and its number of triangles."""
    tab.ask(
        """([level, changes]) => {
            document.body.classList.add('bare');
            delete RR1.pace.at;
            if (level !== null) RR1.pace.at = () => ({...RR1.pace.levels[level], pixels: 1, ...changes});
            RR1.redraw();
        }""",
        [level, changes],
    )
    for _ in range(2):
        frames = tab.ask("RR1.redraw(), RR1.frames")
        wait_until(tab.page, f"RR1.frames > {frames} + 2")
    if level is None:
        wait_until(tab.page, "RR1.settled")
    png, triangles = tab.page.screenshot(), tab.ask("RR1.meshcat.renderer.info.render.triangles")
    tab.ask("document.body.classList.remove('bare'), delete RR1.pace.at")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int), int(triangles)


def test_what_is_drawn_of_many_arms_is_where_they_are(calm: Any, grid: rp.Scene) -> None:
    motion = wander(grid)
    for t in (0.4, 2.0):
        calm.ask("t => RR1.seek(t)", t)
        boxes, expected = calm.ask(DRAWN_LINKS, 3), link_boxes(grid, motion(t))
        assert set(boxes) <= set(expected)
        assert len(boxes) > 0.7 * len(expected)
        # What a level leaves out is smaller than its resolution, and nothing sticks out.
        resolution = 0.004
        for name, box in boxes.items():
            low, high = np.array(box)
            assert (low > expected[name][0] - 1e-4).all(), name
            assert (high < expected[name][1] + 1e-4).all(), name
            assert np.abs(np.array(box) - expected[name]).max() < 4 * resolution, name


@pytest.mark.drawn
def test_every_level_draws_less_and_the_picture_stays(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    tab.ask("RR1.setShown('toolpath', false)")
    levels = [None, *range(1, int(tab.ask("RR1.pace.levels.length")))]
    pictures, counts = zip(*(picture(tab, level) for level in levels), strict=True)
    assert list(counts) == sorted(counts, reverse=True)
    assert counts[0] > 4 * counts[-1]
    # Gray levels in blocks of 8 pixels: the arms are where they were, and about as bright.
    blocks = [p[:640, :960].mean(axis=2).reshape(80, 8, 120, 8).mean(axis=(1, 3)) for p in pictures]
    for coarse in blocks[1:]:
        assert np.corrcoef(blocks[0].ravel(), coarse.ravel())[0, 1] > 0.9
    assert tab.complaints == []


@pytest.mark.drawn
def test_smooth_edges_change_only_edges(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    tab.ask("RR1.setShown('toolpath', false)")
    rough, smooth, again = (picture(tab, 3, smooth=on)[0] for on in (False, True, False))
    assert np.array_equal(rough, again)
    changed = np.abs(smooth - rough).max(axis=2) > 2
    assert 0.001 < changed.mean() < 0.1
    # Samples of a pixel show what is visible in it or next to it, so their mean lies between the colors around it.
    around = np.stack([np.roll(rough, (i - 1, j - 1), (0, 1)) for i, j in np.ndindex(3, 3)])
    between = ((smooth >= around.min(axis=0) - 8) & (smooth <= around.max(axis=0) + 8)).all(axis=2)
    assert between[changed].mean() > 0.9
    assert tab.complaints == []


def test_arms_outside_of_the_picture_are_not_drawn(calm: Any) -> None:
    drawn = """(RR1.redraw(), RR1.setQuality(RR1.pace.full),
        Array.from(RR1.world.detail.levels).filter((level) => level >= 0).length)"""
    assert calm.ask(drawn) == 30
    before = calm.ask("RR1.stage.camera.position.toArray()")
    # From beside the arms, away from them.
    calm.ask(
        """RR1.stage.camera.position.set(-6, 0.5, 2), RR1.stage.controls.target.set(-9, 0.5, 4),
        RR1.stage.controls.update()"""
    )
    assert calm.ask(drawn) == 0
    calm.ask("p => { RR1.stage.camera.position.set(...p); RR1.look(); }", before)
    assert calm.ask(drawn) == 30


def test_late_frames_draw_less_and_early_ones_more(calm: Any) -> None:
    run = """frames => {
        const pace = new RR1.pace.constructor(30), found = [];
        let now = 0;
        for (const [count, passed] of frames) {
            for (let i = 0; i < count; i++) pace.at(now += passed, true);
            found.push([pace.level, pace.patience]);
        }
        return found;
    }"""
    begin, last = 3, calm.ask("RR1.pace.levels.length") - 1
    assert calm.ask(run, [[2, 16]]) == [[begin, 400]]
    assert calm.ask(run, [[100, 200]])[0][0] == last
    assert calm.ask(run, [[300, 16]])[0][0] == 0
    # More detail was too slow: the next attempt at more detail comes after twice the time.
    (_, first), (level, second) = calm.ask(run, [[30, 16], [12, 100]])
    assert second == 2 * first
    assert level == begin


def test_very_many_arms_have_no_legend_and_no_ghosts_at_first(calm: Any) -> None:
    assert calm.page.inner_text("#joints summary >> nth=0") == "30 arms"
    assert calm.ask("document.querySelectorAll('#joints > details > details').length") == 30
    assert not calm.ask("RR1.isShown('start')")
    calm.page.click("[data-layer=start]")
    assert calm.ask("RR1.isShown('start')")
    calm.page.click("[data-layer=start]")


def test_a_line_says_how_many_arms_there_are(calm: Any) -> None:
    line = "document.getElementById('hud').textContent"
    wait_until(calm.page, f"{line} === '30 arms'")
    calm.ask("RR1.play()")
    wait_until(calm.page, f"/^30 arms · [.0-9]+ frames.s · [.0-9]+ × real time$/.test({line})")


def test_touching_links_are_red_at_their_time_and_the_time_line_says_so(calm: Any, grid: rp.Scene) -> None:
    names = list(grid.arms)
    red = """() => [...new Set(RR1.world.robots.sets.flatMap(({ items, colors }) => items.filter((_, i) => (
        colors[3 * i] > 0.6 && colors[3 * i + 1] < 0.02 && colors[3 * i + 2] < 0.05
    )).map((item) => item.element)))].sort()"""
    assert calm.ask(red) == []
    calm.ask("RR1.seek(1.05)")
    assert calm.ask(red) == [f"{names[0]}/hand_link", f"{names[1]}/forearm_link"]
    assert calm.page.inner_text("#conflict") == f"{names[0]}/hand_link and {names[1]}/forearm_link"
    calm.ask("RR1.seek(1.8)")
    assert calm.ask(red) == []
    assert calm.page.is_hidden("#conflict")
    titles = calm.ask("Array.from(document.querySelectorAll('#marks button'), (b) => b.title)")
    assert titles == [
        f"{names[0]}/hand_link and {names[1]}/forearm_link at 1.00 s",
        f"{names[1]}/hand_link and {names[2]}/hand_link at 2.50 s",
    ]
    calm.ask("document.querySelectorAll('#marks button')[1].click()")
    assert calm.ask("RR1.time") == 2.5
    assert calm.ask(red) == [f"{names[1]}/hand_link", f"{names[2]}/hand_link"]


WHITE = """<robot name="white">
  <link name="base"><visual><geometry><box size="0.1 0.1 0.1"/></geometry><material name="black"/></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="bar">
    <visual><geometry><box size="0.3 0.1 0.1"/></geometry><material name="white"/></visual>
    <collision><geometry><box size="0.3 0.1 0.1"/></geometry></collision>
  </link>
  <material name="white"><color rgba="1 1 1 1"/></material>
  <material name="black"><color rgba="0.05 0.05 0.05 1"/></material>
</robot>"""


def test_robots_without_colored_parts_have_the_colors_of_arms_too(
    tab: Any, planar2r: rp.Robot, tmp_path: FilePath
) -> None:
    (tmp_path / "white.urdf").write_text(WHITE)
    white = rp.load_robot(tmp_path / "white.urdf")
    scene = rp.Scene().with_arm("one", white).with_arm("two", white, (2.0, 0.0, 0.0))
    tab.open(save_html(tmp_path / "page.html", scene.with_arm("three", planar2r, (4.0, 0.0, 0.0))))
    colored = """element => RR1.world.robots.sets.flatMap(({ items, colors }) => items.flatMap((item, i) => (
        item.element !== element ? [] : [Array.from(colors.slice(3 * i, 3 * i + 3))])))"""
    shown = {name: tab.ask(colored, name) for name in ("one/bar", "two/bar", "one/base", "two/base")}
    # Drawn as intensities of light, which sRGB encodes.
    encoded = np.array([to_rgb(arm_color(k)) for k in range(2)])
    expected = np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)
    np.testing.assert_allclose([*shown["one/bar"], *shown["two/bar"]], expected, atol=1e-3)
    assert shown["one/base"] == shown["two/base"]
    # A robot with colored parts keeps its gray ones.
    own = {tuple(np.round(color, 3)) for link in planar2r.link_names for color in tab.ask(colored, f"three/{link}")}
    assert len(own) > 1
    tab.ask("RR1.setByArm(false)")
    assert tab.ask(colored, "one/bar") == tab.ask(colored, "two/bar")


def test_contacts_of_a_simulation_are_marked_while_they_last(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), [0.3, 0.0, 0.0])
    motion, times = wander(scene), np.linspace(0, 3, 4)
    link, zeros = f"arm/{planar2r.links[1].name}", np.zeros(2)
    contacts = (rp.ReplayContact((link, "box"), 1.0, 2.0, 0.001),)
    record = rp.ReplayRecord(times, motion(times), motion(times))
    replay = rp.Replay("dynamic", motion.joint_names, record, zeros, zeros, zeros, contacts, 1, 0.1, 1.0)
    options = rp.ViewOptions(play=False)
    file = save_html(tmp_path / "page.html", scene, trajectory=motion, replay=replay, options=options)
    tab.open(file)
    for time, touching in ((0.5, []), (1.0, [link, "box"]), (2.0, [link, "box"]), (2.5, [])):
        assert tab.ask("t => (RR1.seek(t), RR1.conflicts.elements())", time) == touching
    assert tab.ask("document.querySelectorAll('#marks button').length") == 1
    assert tab.complaints == []


def test_a_contact_in_a_short_motion_is_not_red_throughout(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), [0.3, 0.0, 0.0])
    motion, link = wander(scene).stretched(0.05), f"arm/{planar2r.links[1].name}"
    end = motion.end_time
    report = rp.Report((rp.Violation("collision", (link, "box"), 0.5 * end, -0.01, 0.0, "contact"),), {}, (), {}, end)
    options = rp.ViewOptions(play=False)
    tab.open(save_html(tmp_path / "page.html", scene, trajectory=motion, report=report, options=options))
    shares = [0.0, 0.3, 0.5, 0.7, 1.0]
    red = [tab.ask("t => (RR1.seek(t), RR1.conflicts.elements().length > 0)", share * end) for share in shares]
    assert red == [False, False, True, False, False]
    assert tab.complaints == []


def test_a_mesh_of_many_triangles_is_drawn_coarsely_from_afar(calm: Any) -> None:
    before, rows = calm.ask(
        """() => {
            const ball = new RR1.THREE.IcosahedronGeometry(0.1, 24), places = new Map(), vertices = [], faces = [];
            const { position } = ball.attributes;
            for (let i = 0; i < position.count; i++) {
                const point = [position.getX(i), position.getY(i), position.getZ(i)];
                const key = point.map((v) => v.toFixed(6)).join();
                if (!places.has(key)) { places.set(key, vertices.length / 3); vertices.push(...point); }
                faces.push(places.get(key));
            }
            const LinkBody = RR1.world.robots.sets[0].body.constructor, pose = new RR1.THREE.Matrix4().toArray();
            const arrays = { vertices: Float32Array.from(vertices), faces: Uint32Array.from(faces) };
            const geometry = new LinkBody([{ shape: { kind: "mesh", arrays }, pose }], []).geometry(5);
            const at = geometry.attributes.position;
            return [faces.length / 3, Array.from(geometry.index.array, (v) => [at.getX(v), at.getY(v), at.getZ(v)])];
        }"""
    )
    triangles = np.reshape(rows, (-1, 3, 3))
    assert len(triangles) < before / 4
    radii = np.linalg.norm(triangles, axis=2)
    assert radii.max() < 0.1 + 1e-6
    assert radii.min() > 0.1 - 0.016
    # The ball stays closed: every edge has its twin the other way.
    corners = [[tuple(np.round(point, 6)) for point in triangle] for triangle in triangles]
    edges = {(a, b) for t in corners for a, b in zip(t, [*t[1:], t[0]], strict=True)}
    assert all((b, a) in edges for a, b in edges)


def test_of_many_arms_the_one_that_was_moved_is_planned_for(tab: Any, rr1: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.place_grid(rr1, 4, 4, spacing=0.8)
    tab.open(save_html(tmp_path / "page.html", scene))
    wait_until(tab.page, "Boolean(RR1.planner)")
    tab.ask("RR1.editing.open(), RR1.editing.select({ kind: 'tool', arm: 6 })")
    assert tab.ask("RR1.editing.judge(RR1.q).title") == "Free"
    column = 6 * rr1.nq
    tab.ask(f"RR1.editing.turn({column}, RR1.q[{column}] + 0.7), RR1.editing.setEnd('goal')")
    answer = tab.ask("RR1.editing.plan().then((a) => [a.certified, a.legs.map((leg) => leg.arm)])")
    assert answer == [True, [6]]
    wait_until(tab.page, "document.getElementById('answer').textContent.includes('clearance')")
    assert "the other arms stand still" in tab.page.inner_text("#answer")
    drawn = "RR1.world.still.filter((row) => row.kind === 'goal').map((row) => row.poses.length / 16)"
    assert tab.ask(drawn) == [len(rr1.link_names)]
    track = tab.ask(
        "(({ breaks, coefficients: c }) => [[...breaks.values], [...c.values], c.shape])(RR1.document.track)"
    )
    motion = rp.Trajectory(scene.joint_names(), track[0], np.reshape(track[1], track[2]))
    assert rp.validate(motion, scene).certified
    moved = motion(motion.end_time) - scene.configuration()
    assert np.flatnonzero(np.abs(moved) > 1e-6).tolist() == [column]
    tab.ask("RR1.editing.reset()")
    assert not tab.ask("RR1.editing.changed")
    assert tab.complaints == []


def test_curves_of_many_arms_open_without_clearances_of_all_pairs(tab: Any, grid: rp.Scene, tmp_path: FilePath) -> None:
    """Those of a hundred arms at two hundred instants would stop the page for twenty seconds."""
    options = rp.ViewOptions(play=False)
    tab.open(save_html(tmp_path / "page.html", grid, trajectory=wander(grid), options=options))
    wait_until(tab.page, "Boolean(RR1.planner)")
    tab.ask("() => { RR1.planner.clearance = () => { throw new Error('measured'); }; RR1.plots.toggle(); }")
    offered = tab.ask("RR1.plots.offered")
    assert "velocity" in offered
    assert "clearance" not in offered
    assert tab.complaints == []


def test_a_long_name_of_an_arm_stays_inside_the_card(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("a_name_without_blanks_" * 12, planar2r).with_arm("other", planar2r, [4.0, 0.0, 0.0])
    tab.open(rp.save_html(tmp_path / "page.html", scene))
    tab.ask("RR1.editing.open()")
    tab.next_frames()
    assert tab.ask("(({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth)(document.getElementById('editing'))")
    assert tab.complaints == []


def test_a_low_window_shows_the_verdict_while_arms_are_moved(tab: Any, tmp_path: FilePath) -> None:
    scene = rp.load_scene("rr1_twelve")
    assert scene.description
    tab.resize(640, 360)
    tab.open(save_html(tmp_path / "page.html", scene, trajectory=wander(scene), options=rp.ViewOptions(play=False)))
    wait_until(tab.page, "Boolean(RR1.planner)")
    tab.ask("RR1.editing.open(true)")
    tab.ask("() => { const q = RR1.editing.start.slice(); q[0] += 0.3; RR1.editing.setEnd('goal', q); }")
    assert tab.ask("RR1.editing.plan().then((answer) => answer.certified)")
    tab.next_frames()
    bottom = "(id) => document.getElementById(id).getBoundingClientRect().bottom"
    assert tab.ask(bottom, "badge") < tab.ask(bottom, "headline") - 4
    assert tab.complaints == []
