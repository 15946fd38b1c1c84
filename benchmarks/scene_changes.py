"""Time to the first result after a change of the scene: an obstacle moved, ten new boxes, a new scene.

    python benchmarks/scene_changes.py [PROBLEMS.json.gz --robot panda.urdf] [--every 5]

`moved`: an obstacle of a checker is moved (`CollisionChecker.move_obstacle`) and a configuration checked. `boxes`: ten
boxes stand elsewhere in a new `Scene`, a checker comes from the pool, and a configuration and an edge are checked; with
a margin of 2 mm too, as planners use. `new scene`: the stages of the first `plan_motion` in each of a file's scenes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, spread, table

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.robot import Geometry
from rr1plan.scene import Obstacle
from rr1plan.scene.motion_bench import problem_set_joints, read_problem_set
from rr1plan.transforms import pose

_SCENE = "rr1_table"
_BOXES = 10
_MARGIN = 0.002  # [m]
_UNTIMED = 10  # first rounds, in which things are loaded
# Target of the median [s].
_GOALS = {"moved": 50e-6, "boxes": 200e-6, "set up": 350e-6}


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "scene_changes")
    parser.add_argument("file", type=Path, nargs="?", help="MotionBenchMaker problems (.json or .json.gz)")
    parser.add_argument("--robot", type=Path, help="their robot's URDF")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem")
    parser.add_argument("--rounds", type=int, default=300, help="how often a scene is changed")
    args = parser.parse_args(argv)
    if args.file is not None and args.robot is None:
        parser.error("a file of problems needs --robot, the URDF of their robot")
    pin_to_core(args.core)
    rng = np.random.default_rng(args.seed)
    times = {
        "moved": _time_moves(args.rounds, rng),
        "boxes": _time_boxes(args.rounds, 0.0, rng),
        "boxes, with a margin": _time_boxes(args.rounds, _MARGIN, rng),
    }
    if args.file is not None:
        times |= _time_scenes(args.file, args.robot, args.every, args.seed)
    results = {name: spread(seconds) for name, seconds in times.items()}
    rows = []
    for name, seconds in times.items():
        goal = _GOALS.get(name.split(",")[0])
        low, median, high = np.quantile(seconds, (0.1, 0.5, 0.9))
        rows.append([name, *(number(1e6 * t) for t in (low, median, high)), "" if goal is None else number(1e6 * goal)])
    facts = {"scene": _SCENE, "rounds": args.rounds, "seed": args.seed}
    header = ["first answer after [us]", "10 %", "median", "90 %", "goal"]
    save(
        args.out,
        "scene_changes",
        {"results": results, "goals": _GOALS},
        "\n\n".join([heading("Scenes that change", facts), table(header, rows)]),
    )
    return 0


def _place(rng: np.random.Generator) -> Array:
    return pose(rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 0.8]), rpy=[0.0, 0.0, rng.uniform(-3.0, 3.0)])


def _boxes(rng: np.random.Generator) -> Iterator[tuple[str, Obstacle]]:
    for i in range(_BOXES):
        shape = rp.Box(tuple(rng.uniform(0.03, 0.15, 3).tolist()))
        yield f"box {i}", Obstacle((Geometry("box", shape),), _place(rng))


def _ends(scene: rp.Scene) -> tuple[Array, Array]:
    begin = scene.configuration()
    return begin, begin + 0.3


def _time_moves(rounds: int, rng: np.random.Generator) -> list[float]:
    scene = rp.load_scene(_SCENE)
    scene = rp.Scene(scene.arms, {**scene.obstacles, **dict(_boxes(rng))})
    checker, (q, _) = CollisionChecker(scene), _ends(scene)
    times = []
    for _ in range(rounds + _UNTIMED):
        there = _place(rng)
        begin = time.perf_counter()
        checker.move_obstacle("box 3", there)
        checker.is_free(q)
        times.append(time.perf_counter() - begin)
    return times[_UNTIMED:]


def _time_boxes(rounds: int, margin: float, rng: np.random.Generator) -> list[float]:
    first = rp.load_scene(_SCENE)
    q0, q1 = _ends(first)
    times = []
    for _ in range(rounds + _UNTIMED):
        scene = rp.Scene(first.arms, {**first.obstacles, **dict(_boxes(rng))})
        begin = time.perf_counter()
        with checker_from_pool(scene, margin=margin) as checker:
            checker.is_free(q0)
            checker.edge_is_free(q0, q1)
        times.append(time.perf_counter() - begin)
    return times[_UNTIMED:]


def _time_scenes(file: Path, urdf: Path, every: int, seed: int) -> dict[str, list[float]]:
    """The stages of the first result in each scene; the first few scenes are not counted."""
    robot = rp.load_robot(urdf, joints=problem_set_joints(file))
    problems = list(read_problem_set(file, robot).values())[::every]
    stages: dict[str, list[float]] = {}
    for i, problem in enumerate(problems):
        motion = rp.plan_motion(problem, rng=seed)
        for stage, seconds in motion.seconds.items():
            if i >= min(_UNTIMED, len(problems) // 2) and stage != "imports":
                stages.setdefault(stage, []).append(seconds)
    return stages


if __name__ == "__main__":
    sys.exit(main())
