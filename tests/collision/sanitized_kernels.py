"""Kernels of a library with sanitizers, compared with the shipped library; run by `test_edge_kernel.py`.

Scenes of edges hold all kinds of bodies and obstacles, meshes that are not convex among them, padding, something held,
and two arms.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import rr1plan as rp

sys.path.insert(0, str(Path(__file__).parents[1]))
from concave_meshes import mug, soup

from rr1plan.collision import CollisionChecker, TimedChecker
from rr1plan.collision.edge_kernel import EdgeKernel, ExactKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.kernels.planner_kernels import LIBRARY, load_library
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.arm_replanning import replanned, search_in_time
from rr1plan.multi.paths.nominal_clock import Track
from rr1plan.multi.paths.paced_polyline import PacedPolyline
from rr1plan.planners import Roadmap, RrtConnect
from rr1plan.planners.shortcut import shorten
from rr1plan.planning import Budget
from rr1plan.retiming.path_blends import round_corners
from rr1plan.transforms import pose

COUNTED = Budget(seconds=float("inf"), iterations=20_000)


def scenes():
    cloud = rp.PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (60, 3)), 0.03)
    rod = rp.Scene().with_arm("arm", rp.load_robot("rr1")).with_obstacle("rod", rp.Capsule(0.01, 0.4))
    scene = rod.attach("rod", "arm", touch=rp.load_robot("rr1").link_names[-3:], pose=pose([0.0, 0.0, 0.05]))
    scene = scene.with_obstacle("ground", rp.HalfSpace((0, 0, 1), -0.3)).with_obstacle("cloud", cloud)
    hull = rp.load_scene("rr1_cluttered").obstacles
    for name, obstacle in hull.items():
        scene = scene.with_obstacle(name, obstacle.geometries[0].shape, obstacle.pose)
    scene = scene.with_obstacle("mug", mug(16, 6), [0.3, -0.3, 0.4]).with_obstacle("scraps", soup(), [0.0, 0.4, 0.6])
    yield scene.with_padding(0.005)
    yield rp.load_scene("rr1_pair")
    yield rp.load_scene("planar2r_path")


def edges():
    """Results for edges and curves."""
    for scene in scenes():
        checker = CollisionChecker(scene)
        tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)
        kernel = EdgeKernel(tables, ExactKernel(checker.tables, checker.nq), checker.nq)
        rng = np.random.default_rng(1)
        for i, q in enumerate(rng.uniform(-2.0, 2.0, (60, checker.nq))):
            step = rng.normal(size=checker.nq) * rng.choice([0.0, 0.1, 0.6])
            curve = np.array([q, step, rng.normal(size=checker.nq) * 0.1])
            yield kernel.certify_edge(q, q + step)
            yield kernel.certify_parabola(curve, 1.0)
            if i % 6 == 0:
                yield kernel.certify_curve(curve, 1.0)


def timed_edges():
    """Results for edges among moving arms: polynomials of several degrees, and one motion of a single instant."""
    scene = rp.load_scene("rr1_twelve")
    arms, rng = list(scene.arms), np.random.default_rng(2)
    checker = CollisionChecker(scene, arms[:2])
    motions = {}
    for k, arm in enumerate(arms[2:]):
        times = np.cumsum(rng.uniform(0.05, 0.6, k % 4 + 1))
        q = scene.arms[arm].q + rng.normal(size=(len(times), 6))
        rates = [np.zeros_like(q)] * (k % 3)
        motions[arm] = rp.Trajectory.from_samples(scene.joint_names([arm]), times, q, *rates)
    timed = TimedChecker(checker, motions)
    start = np.concatenate([scene.arms[arm].q for arm in arms[:2]])
    for begin in np.linspace(-0.5, 2.0, 12).tolist():
        end = start + rng.normal(size=12)
        yield timed.edge_is_free(start, end, begin, begin + 1.0)
        contact = timed.first_contact(start, end, begin, begin + 1.0)
        yield None if contact is None else (contact.time, contact.pair)
        own = rp.Trajectory.from_samples(
            checker.joint_names, [0.0, 1.0], [start, end], np.ones((2, 12)), np.ones((2, 12))
        )
        yield timed.trajectory_is_free(own, begin, begin + 1.0)


def plans():
    """Paths, shortened paths, motions along them, and roadmaps."""
    for scene, name in (
        ("rr1_shelf", "lower_level"),
        ("rr1_pair", "both_reach_out"),
        ("planar2r_path", "over_the_seam"),
    ):
        problem = rp.load_problems(scene)[name]
        path = RrtConnect().plan(problem, budget=COUNTED, rng=3).path_or_raise()
        yield path.waypoints.tobytes()
        shorter = shorten(path, problem.scene, rng=1, iterations=40)
        yield shorter.waypoints.tobytes()
        for part in (path, shorter):
            motion = rp.retime(part, problem.scene)
            yield motion.sample(0.01)[1].tobytes()
        point = path.waypoints[:1].copy()
        yield rp.retime(rp.Path(path.joint_names, point), problem.scene).duration
        yield len(round_corners(point, np.zeros(1))[0])
    problem = rp.load_problems("planar2r_path")["over_the_seam"]
    roadmap = Roadmap(problem.scene, samples=400)
    for _ in range(2):
        yield roadmap.plan(problem, budget=COUNTED, rng=0).path_or_raise().waypoints.tobytes()


def other_motions():
    """Motions of one of two arms among those of the other one."""
    problem = rp.load_problems("rr1_pair")["both_reach_out"]
    path = RrtConnect().plan(problem, budget=COUNTED, rng=3).path_or_raise()
    checker = CollisionChecker(problem.scene, problem.arms)
    agent, rng = Agent(problem, problem.arms), np.random.default_rng(4)
    polyline = PacedPolyline(path.waypoints, agent.limits, list(agent.columns.values()))
    for _ in range(12):
        made = replanned(polyline, checker, rng)
        yield None if made is None else made.tobytes()
    ends, left_out = path.waypoints[[0, -1]], np.ones(checker.nq, np.uint8)
    own = agent.columns[agent.arms[0]]
    left_out[own] = 0
    for flags in (None, left_out):
        track = Track(np.array([0.0, 3.0]), ends)
        found = search_in_time(checker, track, own, agent.limits, rng, samples=60, left_out=flags)
        yield None if found is None else found.points.tobytes()


def solutions():
    """Inverse kinematics of positions, poses and regions."""
    scene = rp.load_scene("rr1_table")
    kinematics = rp.Kinematics(scene)
    for at in ([0.3, 0.1, 0.4], [0.2, -0.3, 0.3]):
        for turn in (None, [1.0, 0.0, 0.0, 0.0]):
            yield rp.solve_ik(kinematics, rp.PoseGoal("tool", at, turn), rng=0, attempts=60).solutions.tobytes()
        region = rp.RegionGoal("tool", np.array(at) - 0.05, np.array(at) + 0.05)
        yield rp.solve_ik(kinematics, region, rng=0, attempts=60).solutions.tobytes()


def answers():
    return [*edges(), *timed_edges(), *plans(), *other_motions(), *solutions()]


def main() -> int:
    expected = answers()
    LIBRARY.fastest = LIBRARY.load(Path(sys.argv[1]))
    assert load_library() is LIBRARY.fastest
    found = answers()
    if found != expected:
        return 1
    sys.stdout.write(f"same answers to {len(found)} questions\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
