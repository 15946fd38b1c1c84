"""Frames per second and time to the first frame: pages of many arms next to stock Meshcat pages of the same scenes.

    python benchmarks/page_frames.py [--arms 1 10 30 100 120] [--seconds 10] [--repeats 2]

RR1 on a grid, all moving, in one headless Chromium without a graphics card, both pages alternately. The stock page is
Meshcat's viewer with its own objects and its own animation: a group of visual shapes for each link, which moves by a
track of positions and one of quaternions, 30 keys a second. (Meshcat's Python package makes an object and two tracks
for each shape, ten times as many, which takes longer.) A frame counts when the renderer has drawn it. `first frame`:
from the request of the page to its second frame. `size`: of the file.
"""

from __future__ import annotations

import argparse
import base64
import json
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from shared import heading, make_parser, number, save, table, track

import rr1plan as rp
from rr1plan.errors import Rr1PlanError
from rr1plan.playback.viewer.page_capture import open_browser

_SPACING = 0.8  # [m]
_PIECES = 6  # of the motion, a second each
_TURN = 0.8  # largest displacement of a joint [rad]
_KEYS = 30.0  # of the stock animation [1/s]
_COUNTS = (1, 10, 30, 100, 120)
_SIZE = (1280, 800)
# Number of frames that a page has drawn.
_FRAMES = {
    "rr1plan": "window.RR1 && RR1.ready ? RR1.frames : 0",
    "meshcat": "window.viewer ? viewer.renderer.info.render.frame : 0",
}
_PATIENCE = 300.0  # [s] for the first frame


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    results = []
    try:
        with tempfile.TemporaryDirectory() as folder, open_browser(_SIZE) as browser:
            for count in track(args.arms, "pages"):
                scene = grid(count)
                motion = wander(scene, args.seed)
                files = {"rr1plan": Path(folder) / "rr1plan.html", "meshcat": Path(folder) / "meshcat.html"}
                rp.save_html(files["rr1plan"], scene, trajectory=motion)
                files["meshcat"].write_text(stock_page(scene, motion), encoding="utf-8")
                for _ in range(args.repeats):
                    for kind, file in files.items():
                        results.append({"arms": count, "page": kind} | measure(browser, kind, file, args.seconds))
    except Rr1PlanError as error:
        print(f"page_frames.py needs a Chromium and playwright: {error}", file=sys.stderr)
        return 1
    facts = {"window": f"{_SIZE[0]} x {_SIZE[1]}, no graphics card", "frames counted for": f"{args.seconds:g} s"}
    save(args.out, "page_frames", {"results": results}, f"{heading('Pages of many arms', facts)}\n\n{_table(results)}")
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(__doc__.splitlines()[0], "page_frames")
    parser.add_argument("--arms", type=int, nargs="+", default=_COUNTS, help="how many arms the page shows")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long frames are counted")
    parser.add_argument("--repeats", type=int, default=2, help="how often; the best of each page counts")
    return parser.parse_args(argv)


def measure(browser: Any, kind: str, file: Path, seconds: float) -> dict[str, float]:
    """Open a page. Returns the time to its first frame [s], frames per second, and size [bytes]."""
    page = browser.new_page()
    try:
        began = perf_counter()
        page.goto(file.as_uri(), wait_until="commit")
        if not _frames_come(page, kind, 2):
            return {"first": float("nan"), "rate": 0.0, "size": file.stat().st_size}
        first = perf_counter() - began
        page.wait_for_timeout(3000)  # until the page has found its pace
        drawn, began = page.evaluate(_FRAMES[kind]), perf_counter()
        page.wait_for_timeout(1e3 * seconds)
        drawn = page.evaluate(_FRAMES[kind]) - drawn
        return {"first": first, "rate": drawn / (perf_counter() - began), "size": file.stat().st_size}
    finally:
        page.close()


def _frames_come(page: Any, kind: str, count: int) -> bool:
    """Wait until a page has drawn some frames. Returns False if it takes too long."""
    end = perf_counter() + _PATIENCE
    while page.evaluate(_FRAMES[kind]) < count:
        if perf_counter() > end:
            return False
        page.wait_for_timeout(20)
    return True


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for count in dict.fromkeys(r["arms"] for r in results):
        own, stock = ([r for r in results if r["arms"] == count and r["page"] == page] for page in _FRAMES)
        rate, other = max(r["rate"] for r in own), max(r["rate"] for r in stock)
        first = [number(min(r["first"] for r in of)) for of in (own, stock)]
        sizes = [f"{of[0]['size'] / 1e6:.1f}" for of in (own, stock)]
        rows.append(
            [count, number(rate), number(other), number(rate / other if other else float("nan")), *first, *sizes]
        )
    header = ["arms", "frames/s", "stock", "ratio", "first frame [s]", "stock [s]", "size [MB]", "stock [MB]"]
    return table(header, rows)


# ---- the scene -----------------------------------------------------------------------------------


def grid(count: int) -> rp.Scene:
    """RR1 on a square grid."""
    robot, side = rp.load_robot("rr1"), int(np.ceil(np.sqrt(count)))
    scene = rp.Scene(name=f"{count} RR1")
    for i in range(count):
        scene = scene.with_arm(f"arm{i:03d}", robot, [_SPACING * (i % side), _SPACING * (i // side), 0.0])
    return scene


def wander(scene: rp.Scene, seed: int) -> rp.Trajectory:
    """From rest to rest between random configurations and back, all arms at once."""
    generator, start = np.random.default_rng(seed), scene.configuration()
    stops = start + generator.uniform(-_TURN, _TURN, (_PIECES + 1, len(start)))
    stops[0] = stops[-1] = start
    steps = np.diff(stops, axis=0)
    coefficients = np.stack([stops[:-1], 0.0 * steps, 3.0 * steps, -2.0 * steps], axis=1)
    return rp.Trajectory(scene.joint_names(), np.arange(_PIECES + 1.0), coefficients)


# ---- the stock page --------------------------------------------------------------------------------


def stock_page(scene: rp.Scene, motion: rp.Trajectory) -> str:
    """A page of Meshcat's viewer only: one group per link, and one animation."""
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise Rr1PlanError("the package meshcat is not installed")
    viewer = (Path(found.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
    times = np.arange(0.0, motion.duration + 0.5 / _KEYS, 1.0 / _KEYS)
    links = [f"{arm}/{link.name}" for arm, placed in scene.arms.items() for link in placed.robot.links if link.visuals]
    poses = np.empty((len(links), len(times), 7))
    for k, t in enumerate(times):
        at = scene.link_poses(scene.split(motion(float(t))))
        for i, name in enumerate(links):
            poses[i, k] = [*at[name][:3, 3], *rp.transforms.quaternion_from_rotation(at[name][:3, :3])]
    turned = (poses[:, 1:, 3:] * poses[:, :-1, 3:]).sum(axis=2) < 0.0  # the same rotation, the shorter way
    poses[:, 1:, 3:] *= np.where(np.cumsum(turned, axis=1) % 2, -1.0, 1.0)[..., None]
    groups = {f"{arm}/{link.name}": _group(link) for arm, placed in scene.arms.items() for link in placed.robot.links}
    data = {
        "links": links,
        "groups": [groups[name] for name in links],
        "keys": len(times),
        "poses": base64.b64encode(poses.astype("<f4").tobytes()).decode("ascii"),
    }
    slots = {"DATA": json.dumps(data), "VIEWER": viewer, "RATE": str(_KEYS)}
    # In one pass: the data may contain any of these words.
    return re.sub("|".join(slots), lambda match: slots[match.group()], _STOCK)


def _group(link: Any) -> dict[str, Any]:
    """The shapes of a link in the format of three.js, as Meshcat takes them."""
    geometries: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    children = []
    for i, g in enumerate(link.visuals):
        color = 0xB0B0B0 if g.color is None else int("".join(f"{round(255 * c):02x}" for c in g.color[:3]), 16)
        materials.append({"uuid": f"m{i}", "type": "MeshLambertMaterial", "color": color})
        for j, (geometry, T) in enumerate(_parts(g.shape)):
            name, matrix = f"g{i}-{j}", (g.pose @ T).T.ravel().tolist()
            geometries.append({"uuid": name, **geometry})
            child = {"uuid": f"o{name}", "type": "Mesh", "geometry": name, "material": f"m{i}", "matrix": matrix}
            children.append(child)
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": geometries,
        "materials": materials,
        "object": {"uuid": "link", "type": "Group", "children": children},
    }


def _parts(shape: rp.Shape) -> list[tuple[dict[str, Any], Any]]:
    """Geometries of a shape as Meshcat's Python package makes them, with poses in its frame."""
    match shape:
        case rp.Box():
            width, height, depth = map(float, shape.size)
            return [({"type": "BoxGeometry", "width": width, "height": height, "depth": depth}, np.eye(4))]
        case rp.Cylinder():
            return [_cylinder(shape.radius, shape.length)]
        case rp.Capsule():
            ends = [rp.transforms.pose([0.0, 0.0, z]) for z in (-0.5 * shape.length, 0.5 * shape.length)]
            return [_cylinder(shape.radius, shape.length), *((_ball(shape.radius), T) for T in ends)]
        case rp.Sphere():
            return [(_ball(shape.radius), np.eye(4))]
    raise Rr1PlanError(f"a link has a {type(shape).__name__}, which this benchmark does not draw")


def _cylinder(radius: float, length: float) -> tuple[dict[str, Any], Any]:
    sizes = {"radiusTop": radius, "radiusBottom": radius, "height": length, "radialSegments": 50}
    # Cylinders of three.js stand along y, those of a robot along z.
    return {"type": "CylinderGeometry", **sizes}, rp.transforms.pose(rpy=[np.pi / 2.0, 0.0, 0.0])


def _ball(radius: float) -> dict[str, Any]:
    return {"type": "SphereGeometry", "radius": radius, "widthSegments": 20, "heightSegments": 20}


_STOCK = """<!DOCTYPE html><meta charset="utf-8">
<style>body { margin: 0 } #pane { width: 100vw; height: 100vh; overflow: hidden }</style>
<div id="pane"></div>
<script type="application/json" id="data">DATA</script><script>VIEWER</script><script>
const data = JSON.parse(document.getElementById("data").textContent);
const bytes = Uint8Array.from(atob(data.poses), (c) => c.charCodeAt(0)), poses = new Float32Array(bytes.buffer);
window.viewer = new MeshCat.Viewer(document.getElementById("pane"));
const animations = [];
data.links.forEach((name, i) => {
  const path = ["meshcat", ...name.split("/")], times = [], positions = [], turns = [];
  viewer.handle_command({ type: "set_object", path: path.join("/"), object: data.groups[i] });
  for (let k = 0; k < data.keys; k++) {
    const [x, y, z, w, a, b, c] = poses.subarray(7 * (i * data.keys + k), 7 * (i * data.keys + k) + 7);
    times.push(k);
    positions.push(x, y, z);
    turns.push(a, b, c, w);
  }
  const track = (name, type, values) => {
    const size = values.length / data.keys;
    return { name, type, keys: times.map((t, k) => ({ time: t, value: values.slice(size * k, size * (k + 1)) })) };
  };
  const tracks = [track(".position", "vector3", positions), track(".quaternion", "quaternion", turns)];
  animations.push({ path: path.join("/"), clip: { fps: RATE, name: "default", tracks } });
});
const camera = "Cameras/default/rotated/<object>";
viewer.handle_command({ type: "set_property", path: camera, property: "position", value: [6, 5, 8] });
viewer.handle_command({ type: "set_animation", animations, options: { play: true, repetitions: 1000 } });
</script>"""


if __name__ == "__main__":
    raise SystemExit(main())
