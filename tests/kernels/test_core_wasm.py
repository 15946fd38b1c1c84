"""`core.wasm` and its binding in JavaScript, in Node and in a page: all results equal those of the native kernels."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kernels.recorded_calls import Recorder

import rr1plan as rp
from rr1plan.binding.c_sources import KernelSources
from rr1plan.binding.compiled_library import KernelLibrary
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError, InstallationError
from rr1plan.kernels import wasm_core
from rr1plan.kernels.planner_kernels import LIBRARY, SOURCES, constants, load_library
from rr1plan.model import ik_descent, ik_search
from rr1plan.planners import RrtConnect, roadmap_graph, shortcut
from rr1plan.planners.planning_query import Query
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.playback.cspace.cspace_raster import CSpaceRaster
from rr1plan.playback.viewer.page_capture import open_browser
from rr1plan.retiming import path_blends, path_speed
from rr1plan.transforms import pose

ANSWERS = Path(__file__).with_name("core_answers.js").read_text(encoding="utf-8")
COUNTED = Budget(seconds=float("inf"), iterations=20_000)
# Arrays of bytes and float64 pass as base64, so that every bit arrives.
BOOTSTRAP = """async ([binding, answers, module, name, given]) => {
  const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const decode = (key, value) =>
    value?.bytes !== undefined ? bytesOf(value.bytes)
    : value?.doubles !== undefined ? new Float64Array(bytesOf(value.doubles).buffer) : value;
  const encode = (key, value) => {
    if (!(value instanceof Float64Array)) return value;
    const bytes = new Uint8Array(value.buffer, value.byteOffset, value.byteLength);
    return { doubles: btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join("")) };
  };
  const load = (text) => import("data:text/javascript;base64," + text);
  const core = await (await load(binding)).load(bytesOf(module));
  return JSON.stringify((await load(answers))[name](core, ...JSON.parse(given, decode)), encode);
}"""
NODE = f"""
let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(await ({BOOTSTRAP})(JSON.parse(text)));
"""

Ask = Callable[..., Any]


@pytest.fixture(scope="module", params=["node", pytest.param("chromium", marks=pytest.mark.browser)])
def ask(request: pytest.FixtureRequest) -> Iterator[Ask]:
    """Calls a function of `core_answers.js` with a fresh core."""
    if request.param == "node":
        node = shutil.which("node")
        if node is None:
            pytest.skip("no Node on this machine")
        command = [node, "--input-type=module", "--eval", NODE]

        def run(message: list[str]) -> str:
            done = subprocess.run(command, input=json.dumps(message), capture_output=True, text=True, check=False)
            assert done.returncode == 0, re.sub(r"base64,\S+", "", done.stderr)
            return done.stdout

        yield lambda name, *given: _ask(run, name, *given)
        return
    with open_browser((200, 200)) as context:
        page = context.new_page()
        yield lambda name, *given: _ask(lambda message: page.evaluate(BOOTSTRAP, message), name, *given)


def _ask(run: Callable[[list[str]], str], name: str, *given: Any) -> Any:
    def encode(value: Any) -> dict[str, str]:
        key, data = ("bytes", value) if isinstance(value, bytes) else ("doubles", np.ascontiguousarray(value).tobytes())
        return {key: base64.b64encode(data).decode()}

    def decode(value: dict[str, Any]) -> Any:
        return np.frombuffer(base64.b64decode(value["doubles"])) if "doubles" in value else value

    texts = (base64.b64encode(text.encode()).decode() for text in (wasm_core.core_script(), ANSWERS))
    module = base64.b64encode(wasm_core.core_module()).decode()
    return json.loads(run([*texts, module, name, json.dumps(given, default=encode)]), object_hook=decode)


def scenes() -> dict[str, rp.Scene]:
    """All kinds of bodies and obstacles, padding, something held, a cloud of points, two arms."""
    cloud = rp.PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (60, 3)), 0.03)
    mixed = rp.load_scene("rr1_cluttered").with_obstacle("rod", rp.Capsule(0.01, 0.1))
    touch = rp.load_robot("rr1").link_names[-4:]
    mixed = mixed.attach("rod", next(iter(mixed.arms)), touch=touch, pose=pose([0.0, 0.0, 0.05]))
    mixed = mixed.with_obstacle("ground", rp.HalfSpace((0, 0, 1), -0.3)).with_obstacle("cloud", cloud)
    named = {name: rp.load_scene(name) for name in ("rr1_cluttered", "rr1_shelf", "rr1_pair", "planar2r_path")}
    return {"mixed": mixed.with_padding(0.005), **named}


SCENES = scenes()


def native(checker: CollisionChecker, kernel: str, *given: Any) -> tuple[float, float, float]:
    """Status, fraction and pair."""
    context = checker._kernel.context
    status = getattr(load_library(), kernel)(*context, *given)
    result = SOURCES.classes["Scratch"].from_address(context[1]).result
    return status, result.fraction, result.pair


def random_edges(nq: int, count: int) -> np.ndarray:
    """Begins and ends of edges, from none to long, shape (count, 2, nq)."""
    rng = np.random.default_rng(4)
    begins = rng.uniform(-2.0, 2.0, (count, nq))
    steps = rng.normal(size=(count, nq)) * rng.choice([0.0, 0.05, 0.3, 1.0], (count, 1))
    return np.stack([begins, begins + steps], axis=1)


def test_every_field_is_where_the_compiler_has_it(ask: Ask) -> None:
    compiled, declared = ask("layouts")
    assert compiled == declared
    assert len(compiled) > 100


@pytest.mark.parametrize("kernel", ["rr1_sine_cosine", "rr1_sine_cosine_lanes"])
def test_sines_are_those_of_the_native_kernels(ask: Ask, kernel: str) -> None:
    angles = np.random.default_rng(2).normal(size=1600) * 10.0 ** np.arange(-10, 6).repeat(100)
    angles = np.clip(angles, -1e5, 1e5)
    if kernel == "rr1_sine_cosine":
        angles[:100] *= 10.0 ** np.linspace(1, 300, 100)
    expected = np.empty((2, len(angles)))
    getattr(load_library(), kernel)(angles, len(angles), *expected)
    assert np.array(ask("sines", kernel, angles)).tobytes() == expected.tobytes()


@pytest.mark.parametrize("name", ["planar2r_path", "planar2r_no_path"])
def test_rasters_of_moved_obstacles_are_those_of_the_native_kernels(ask: Ask, name: str) -> None:
    scene, centers = rp.load_scene(name), -np.pi + (np.arange(120) + 0.5) * (2.0 * np.pi / 120)
    checker = CollisionChecker(scene)
    poses = {"red": pose([0.5, -0.4, 0.0]), "green": pose([0.2, 1.1, 0.02], rpy=[0.0, 0.2, 0.3])}
    moves = [(checker.object_numbers[obstacle], T.ravel()) for obstacle, T in poses.items()]
    moved = scene
    for obstacle, T in poses.items():
        moved = moved.with_obstacle_at(obstacle, T)
    before, after = (CSpaceRaster(CollisionChecker(s), [0.1, 0.2], (0, 1), (centers, centers)) for s in (scene, moved))
    given = checker.memory_image(), before.memory_image(), list(before.ranges.values())
    for whole in (False, True):
        half = np.full(2, 0.5 * (centers[1] - centers[0]) if whole else 0.0)
        found = ask("raster", *given, half, moves)
        for cells, layer in zip(found, before.ranges, strict=True):
            assert np.array_equal(cells, after.image(layer, whole=whole).ravel())
        assert sum(cells.sum() for cells in found) > 500


@pytest.mark.parametrize("name", SCENES)
def test_edges_have_the_same_answers_to_the_last_bit(ask: Ask, name: str) -> None:
    checker = CollisionChecker(SCENES[name])
    ends = random_edges(checker.nq, 1200)
    expected = np.array([native(checker, "rr1_certify_edge", *edge) for edge in ends], float)
    assert np.array_equal(ask("edges", checker.memory_image(), ends), expected.ravel())
    # Results vary.
    assert 20 < np.count_nonzero(expected[:, 0] == constants()["EDGE_FREE"]) < 1180


def test_obstacles_are_moved_in_a_page_too(ask: Ask) -> None:
    checker, rng = CollisionChecker(SCENES["mixed"]), np.random.default_rng(6)
    image, ends, moves = checker.memory_image(), random_edges(checker.nq, 300), []
    before = [native(checker, "rr1_certify_edge", *edge) for edge in ends]
    for name, obstacle in list(checker.scene.obstacles.items()):
        there = pose(obstacle.pose[:3, 3] + rng.normal(size=3) * 0.1, quaternion=rng.normal(size=4))
        there = pose([0.0, 0.0, 0.05]) if name == "ground" else there
        checker.move_obstacle(name, there)
        moves.append([checker.object_numbers[name], there.ravel()])
    expected = [native(checker, "rr1_certify_edge", *edge) for edge in ends]
    assert np.array_equal(ask("edges", image, ends, moves), np.array(expected, float).ravel())
    assert expected != before


@pytest.mark.parametrize("name", SCENES)
def test_parabolas_have_the_same_answers_to_the_last_bit(ask: Ask, name: str) -> None:
    checker = CollisionChecker(SCENES[name])
    rng = np.random.default_rng(5)
    curves = rng.uniform(-1.5, 1.5, (300, 3, checker.nq)) * np.array([[1.0], [0.3], [0.1]])
    expected = np.array([native(checker, "rr1_certify_parabola", curve, 3, 1.0) for curve in curves], float)
    assert np.array_equal(ask("parabolas", checker.memory_image(), curves), expected.ravel())


@pytest.mark.parametrize(
    ("scene", "name"), [("rr1_shelf", "lower_level"), ("rr1_pair", "change_places"), ("planar2r_path", "over_the_seam")]
)
@pytest.mark.parametrize("seed", [0, 7, 2**60 + 1])
def test_a_seed_gives_the_same_path_to_the_last_bit(ask: Ask, scene: str, name: str, seed: int) -> None:
    problem = rp.load_problems(scene)[name]
    step = 0.4
    path = RrtConnect(range=step).plan(problem, budget=COUNTED, rng=seed).path_or_raise()
    shorter = shorten(path, problem.scene, rng=seed + 1, iterations=40)
    assert len(path.waypoints) > 2
    with Query("rrt_connect", problem, COUNTED, seed, None) as query:
        assert query.early_exit() is None
        space = query.space
        asked = {
            "start": problem.start,
            "goals": query.goals,
            "lower": space.lower,
            "extent": space.extent,
            "step": step,
            "domain": 0.3 * space.diagonal,
            "seed": str(query.seed),
            "iterations": 40,
            "patience": 30,
            "shortcut_seed": str(seed + 1),
        }
    image = CollisionChecker(problem.scene, problem.arms).memory_image()
    found, found_shorter = ask("plan", image, asked)
    assert found.tobytes() == path.waypoints.tobytes()
    assert found_shorter.tobytes() == shorter.waypoints.tobytes()


# ---- all other kernels, by the calls that the package makes ----------------------------------------


def same_answers(ask: Ask, recorder: Recorder, image: bytes = b"") -> Counter[str]:
    """Repeat all recorded calls, with bitwise equal results. Returns the number of calls of each kernel."""
    found = ask("replay", image, recorder.questions())
    assert len(found) == len(recorder.calls)
    for call, (result, *parts) in zip(recorder.calls, found, strict=True):
        kernel = call.question["kernel"]
        native = [np.array([np.nan if call.answer[0] is None else call.answer[0]], float).tobytes()]
        native += [part if isinstance(part, bytes) else np.array(part, float).tobytes() for part in call.answer[1:]]
        for expected, part in zip(native[1:], parts, strict=True):
            assert part.tobytes()[: len(expected)] == expected, kernel
        assert result.tobytes() == native[0] or call.answer[0] is None, kernel
    return Counter(call.question["kernel"] for call in recorder.calls)


@pytest.mark.parametrize("name", ["rr1", "planar2r", "planar2r_limited"])
def test_inverse_kinematics_has_the_same_solutions_to_the_last_bit(
    ask: Ask, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    robot, recorder = rp.load_robot(name), Recorder()
    rng = np.random.default_rng(3)
    monkeypatch.setattr(ik_search, "load_library", lambda: recorder)
    monkeypatch.setattr(ik_descent, "load_library", lambda: recorder)
    kinematics, solutions = rp.Kinematics(rp.Scene().with_arm("arm", robot)), 0
    for _ in range(8):
        q = rng.uniform(np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0))
        T = robot.link_poses(q)[robot.tool]
        for goal in (rp.PoseGoal("tool", T), rp.PoseGoal("tool", T[:3, 3])):
            solutions += len(rp.solve_ik(kinematics, goal, attempts=40, rng=1).solutions)
    # Out of reach: IK returns the nearest configuration.
    rp.solve_ik(kinematics, rp.PoseGoal("tool", [3.0, 0.0, 0.0]), attempts=20, rng=1)
    called = same_answers(ask, recorder)
    assert solutions >= 8
    assert called["rr1_search_ik"] >= 16


@pytest.mark.parametrize(
    ("scene", "name"), [("rr1_shelf", "lower_level"), ("rr1_pair", "change_places"), ("planar2r_path", "over_the_seam")]
)
def test_a_roadmap_has_the_same_vertices_and_ways_to_the_last_bit(
    ask: Ask, monkeypatch: pytest.MonkeyPatch, scene: str, name: str
) -> None:
    problem = rp.load_problems(scene)[name]
    checker = CollisionChecker(problem.scene, problem.arms)
    image, recorder = checker.memory_image(), Recorder(checker._kernel.context)
    monkeypatch.setattr(roadmap_graph, "load_library", lambda: recorder)
    roadmap = roadmap_graph.Graph(problem.scene, problem.arms)
    with Query("roadmap", problem, COUNTED, 0, None) as query:
        assert query.early_exit() is None
        goals = np.array(query.goals)
    roadmap.sample(150, checker, lambda: True)
    way = roadmap.find_path(problem.start, goals, checker, lambda: True)
    roadmap.learn(np.array([problem.start, 0.5 * (problem.start + goals[0]), goals[0]]))
    assert roadmap.find_path(problem.start, goals, checker, lambda: True) is not None or way is None
    called = same_answers(ask, recorder, image)
    kernels = ("sample_roadmap", "attach_ends", "find_roadmap_path", "learn_path", "truncate_roadmap")
    assert all(called[f"rr1_{kernel}"] for kernel in kernels)


@pytest.mark.parametrize("scene", ["rr1_cluttered", "rr1_pair", "planar2r_path"])
def test_shortcuts_are_the_same_to_the_last_bit(ask: Ask, monkeypatch: pytest.MonkeyPatch, scene: str) -> None:
    checker = CollisionChecker(SCENES[scene])
    rng = np.random.default_rng(6)
    points = [checker.scene.configuration()]
    while len(points) < 30:
        q = points[-1] + rng.normal(scale=0.3, size=checker.nq)
        if checker.within_limits(q) and checker.edge_is_free(points[-1], q):
            points.append(q)
    fresh = CollisionChecker(SCENES[scene])
    image, recorder = fresh.memory_image(), Recorder(fresh._kernel.context)
    monkeypatch.setattr(shortcut, "load_library", lambda: recorder)
    path = rp.Path(checker.joint_names, np.array(points))
    shorter = shorten(path, fresh.scene, checker=fresh, rng=5, iterations=80)
    assert shorter.length < path.length
    assert same_answers(ask, recorder, image)["rr1_shorten"]


@pytest.mark.parametrize("name", ["rr1", "planar2r"])
def test_path_parameterization_is_the_same_to_the_last_bit(
    ask: Ask, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    robot, recorder = rp.load_robot(name), Recorder()
    for module in (path_blends, path_speed):
        monkeypatch.setattr(module, "load_library", lambda: recorder)
    joints = tuple(f"arm/{joint}" for joint in robot.joint_names)
    scene = rp.Scene().with_arm("arm", robot)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        low, high = np.maximum(robot.limits.lower, -2.0), np.minimum(robot.limits.upper, 2.0)
        points = rng.uniform(low, high, (2 + seed, robot.nq))
        # A waypoint on a line, one that turns back, and a corner of next to nothing.
        points = np.vstack([points, 0.5 * (points[-1] + points[0]), points[0], points[-1], points[-1] + 1e-7])
        rp.retime(rp.Path(joints, points), scene, max_blend=(0.0, 0.1, 0.5)[seed % 3])
    called = same_answers(ask, recorder)
    assert called["rr1_time_polyline"] >= 6
    assert called["rr1_largest_blends"] >= 6


def test_wrong_calls_are_named(ask: Ask) -> None:
    messages = ask("errors", CollisionChecker(SCENES["planar2r_path"]).memory_image())
    assert messages == {
        "function": "core.wasm has no function rr1_nothing",
        "count": "rr1_certify_edge takes 4 arguments (SceneTables*, Scratch*, double*, double*), got 2",
        "struct": "argument rr1_certify_edge, 1: Scratch is no SceneTables",
        "missing": "argument rr1_certify_edge, 4: undefined is no double",
        "number": "Float32Array is not an array of double",
        "array": "argument rr1_draw_uniform, 1: int64_t is no uint64_t",
        "rows": "Array is not an array of SceneTables",
        "field": "Cannot add property capacities, object is not extensible",
        "pointer": "Trees.path: float is no double",
        "kind": "core.wasm has no type Nothing",
        "image": "this is no memory image",
        "stale": "the memory image was made for another core.wasm",
    }


def test_memory_is_used_again(ask: Ask) -> None:
    assert ask("memory") == [1, True, True]


# ---- in Python -------------------------------------------------------------------------------------


def test_equal_scenes_have_equal_images_whatever_their_checker_has_done() -> None:
    used = CollisionChecker(SCENES["planar2r_path"])
    for q0, q1 in random_edges(2, 50):
        used.edge_is_free(q0, q1)
    assert used.memory_image() == CollisionChecker(rp.load_scene("planar2r_path")).memory_image()


def test_a_scene_in_which_nothing_can_move_has_no_image(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("one", planar2r).with_arm("two", planar2r, [5.0, 0.0, 0.0])
    scene = scene.with_arm("three", planar2r, [5.0, 0.1, 0.0])
    with pytest.raises(InputError, match=r"no edge is free: .* and .* are in contact, and neither moves"):
        CollisionChecker(scene, ["one"]).memory_image()


def test_the_module_is_small() -> None:
    assert len(wasm_core.core_module()) < 400_000


def test_a_module_that_is_missing_or_of_other_headers_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(LIBRARY.sources.unit.parent, tmp_path / "kernels")
    unit = tmp_path / "kernels" / "kernels.c"
    header = unit.with_name("trees.h")
    header.write_text(header.read_text().replace("int64_t samples;", "int64_t samples, added;"))
    monkeypatch.setattr(wasm_core, "SOURCES", KernelSources(unit))
    monkeypatch.setattr(wasm_core, "LIBRARY", KernelLibrary(wasm_core.SOURCES))
    with pytest.raises(InstallationError, match=r"core\.wasm was built from other headers; build them with"):
        wasm_core.core_module()
    (tmp_path / "kernels" / "built" / "core.wasm").unlink()
    with pytest.raises(InstallationError, match=r"no .*core\.wasm; with ziglang installed, build them with"):
        wasm_core.core_module()
