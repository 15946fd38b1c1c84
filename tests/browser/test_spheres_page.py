"""The spheres that contain links, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import save_html, show
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

LAYERS = ("linkspheres", "bodyspheres", "spheres")
# Where each sphere of a layer is drawn, how large it is, and what for.
DRAWN = """layer => RR1.world.spheres.layers.get(layer).sets.flatMap(({drawn, items}) => items.map((item, i) => {
    const m = new RR1.THREE.Matrix4();
    drawn.getMatrixAt(i, m);
    return [item.element, ...m.elements.slice(12, 15), m.elements[0], m.elements[1], m.elements[2], item.radius];
}))"""
CHIPS = "[...document.querySelectorAll('#toggles .chip')].map(c => [c.dataset.layer, c.getAttribute('aria-pressed')])"


@pytest.fixture(scope="module")
def scene(rr1: rp.Robot, planar2r: rp.Robot) -> rp.Scene:
    scene = rp.Scene(name="two").with_arm("left", rr1, rp.transforms.pose([0.4, 0.1, 0.02], rpy=[0.1, -0.2, 1.0]))
    scene = scene.with_arm("right", planar2r, [-0.5, 0.0, 0.0])
    scene = scene.with_obstacle("ball", rp.Sphere(0.08), [0.0, 0.4, 0.3])
    return scene.with_obstacle("held", rp.Box((0.03, 0.03, 0.06)), [0.1, 0.1, 0.4]).attach("held", "left")


def straight(scene: rp.Scene) -> rp.Trajectory:
    start = scene.configuration()
    coefficients = np.stack([start, np.full(len(start), 0.2)])[None]
    return rp.Trajectory(scene.joint_names(), np.array([0.0, 2.0]), coefficients)


@pytest.fixture(scope="module")
def page_file(scene: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    file = tmp_path_factory.mktemp("page") / "page.html"
    return save_html(file, scene, trajectory=straight(scene), options=rp.ViewOptions(spheres=True, play=False))


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    """The page in its initial state, paused."""
    opened.ask("RR1.pause(), RR1.seek(0)")
    yield opened
    opened.ask("['linkspheres', 'bodyspheres'].forEach(l => RR1.setShown(l, false)), RR1.setShown('spheres', true)")
    assert opened.complaints == []


def in_the_world(scene: rp.Scene, q: np.ndarray, level: int) -> list[tuple[str, np.ndarray, float]]:
    poses = scene.link_poses(scene.split(q))
    for name, held in scene.attachments.items():
        poses[name] = poses[f"{held.arm}/{held.link}"] @ held.pose
    return [
        (name, poses[name][:3, :3] @ center + poses[name][:3, 3], radius)
        for name, cover in rp.cover_with_spheres(scene).items()
        for center, radius in zip(*cover.at(level), strict=True)
    ]


@pytest.mark.parametrize("level", [0, 1, 2])
def test_spheres_are_drawn_where_their_links_are_and_move_with_them(calm: Any, scene: rp.Scene, level: int) -> None:
    calm.ask("l => RR1.setShown(l, true)", LAYERS[level])
    for t in (0.0, 1.3):
        calm.ask("t => RR1.seek(t)", t)
        rows = calm.ask(DRAWN, LAYERS[level])
        expected = in_the_world(scene, straight(scene)(t), level)
        order = sorted(rows, key=lambda r: (r[0], *np.round(r[1:4], 3)))
        wanted = sorted(expected, key=lambda r: (r[0], *np.round(r[1], 3)))
        assert [r[0] for r in order] == [w[0] for w in wanted]
        np.testing.assert_allclose([r[1:4] for r in order], [w[1] for w in wanted], atol=2e-4)
        np.testing.assert_allclose([r[7] for r in order], [w[2] for w in wanted], rtol=1e-12)


def test_what_is_drawn_contains_the_sphere_and_little_more(calm: Any) -> None:
    """Flat faces lie outside the true sphere, not inside it."""
    faces = calm.ask("""() => {
        const {drawn} = RR1.world.spheres.layers.get('spheres').sets[0];
        return [Array.from(drawn.geometry.attributes.position.array), Array.from(drawn.geometry.index.array)];
    }""")
    points, index = np.reshape(faces[0], (-1, 3)), np.reshape(faces[1], (-1, 3))
    a, b, c = (points[index[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    planes = np.einsum("ij,ij->i", normals, a)[sizes > 1e-9] / sizes[sizes > 1e-9]
    wider = np.array([np.linalg.norm(r[4:7]) / r[7] for r in calm.ask(DRAWN, "spheres")])
    assert (wider * planes.min() > 1.0 - 1e-6).all()
    assert (wider < 1.02).all()


@pytest.mark.drawn
def test_chips_turn_each_level_on_and_off_and_the_robot_is_seen_through_them(tab: Any, page_file: FilePath) -> None:
    tab.open(page_file)
    chips = dict(tab.ask(CHIPS))
    assert {name: chips[name] for name in LAYERS} == {"spheres": "true", "linkspheres": "false", "bodyspheres": "false"}
    shown = tab.bare_picture()
    tab.page.click("[data-layer=spheres]")
    assert dict(tab.ask(CHIPS))["spheres"] == "false"
    without = tab.bare_picture()
    tab.page.click("[data-layer=linkspheres]")
    coarse = tab.bare_picture()
    for one, two in ((shown, without), (without, coarse), (shown, coarse)):
        assert (np.abs(one - two).max(axis=2) > 12).sum() > 4000
    red, green, blue = shown[..., 0], shown[..., 1], shown[..., 2]
    assert ((red > 120) & (green < 0.75 * red) & (blue < 0.65 * red)).sum() > 1000


def test_the_headline_counts_them(calm: Any, scene: rp.Scene) -> None:
    covers = [c for c in rp.cover_with_spheres(scene).values() if len(c.radii)]
    count = sum(len(c.at(2)[1]) for c in covers)
    facts = calm.page.inner_text("#facts")
    assert f"{count} contain {len(covers)} links and held objects" in facts


def test_robots_of_one_body_a_link_have_no_layer_of_bodies(tab: Any, planar2r: rp.Robot, tmp_path: FilePath) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    tab.open(save_html(tmp_path / "page.html", scene, options=rp.ViewOptions(spheres=True)))
    assert [name for name, _ in tab.ask(CHIPS) if name in LAYERS] == ["spheres", "linkspheres"]
    assert tab.complaints == []


def test_a_page_without_them_has_no_chips_for_them(tab: Any, scene: rp.Scene, tmp_path: FilePath) -> None:
    tab.open(save_html(tmp_path / "page.html", scene))
    assert not {name for name, _ in tab.ask(CHIPS)} & set(LAYERS)
    assert "contain" not in tab.page.inner_text("#facts")
    assert tab.complaints == []


def test_live_pages_show_them_follow_updates_and_drop_them_with_the_next_scene(tab: Any, scene: rp.Scene) -> None:
    with show(scene, options=rp.ViewOptions(spheres=True, quiet=True)) as viewer:
        tab.open(viewer.url)
        before = tab.ask(DRAWN, "spheres")
        q = scene.configuration() + 0.2
        viewer.update(q)
        wait_until(tab.page, f"Math.abs(RR1.q[0] - {q[0]}) < 1e-9")
        rows = sorted(tab.ask(DRAWN, "spheres"), key=lambda r: (r[0], *np.round(r[1:4], 3)))
        wanted = sorted(in_the_world(scene, q, 2), key=lambda r: (r[0], *np.round(r[1], 3)))
        np.testing.assert_allclose([r[1:4] for r in rows], [w[1] for w in wanted], atol=2e-4)
        assert np.abs(np.array([r[1:4] for r in rows]) - [r[1:4] for r in before]).max() > 0.01
        viewer.load(scene)
        wait_until(tab.page, "!RR1.hasLayer('spheres')")
        viewer.load(scene, options=rp.ViewOptions(spheres=True))
        wait_until(tab.page, "RR1.hasLayer('spheres')")
    assert tab.complaints == []
