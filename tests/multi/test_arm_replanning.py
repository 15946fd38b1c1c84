"""Other motions of one arm among all others: free, within limits, no slower, and the others unchanged."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from blocked_arms import goal_configuration, planar_ring, sequential_moves

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.errors import RetimingError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths import agent_path
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.arm_replanning import replanned
from rr1plan.multi.paths.hop_timing import HopTiming
from rr1plan.multi.paths.paced_polyline import PacedPolyline
from rr1plan.multi.paths.path_refinement import PathRefiner
from rr1plan.path import Path
from rr1plan.retiming.path_blends import clean


def _apart(planar2r: rp.Robot) -> rp.Problem:
    """Three arms that cannot meet."""
    scene = rp.Scene()
    for k in range(3):
        scene = scene.with_arm(f"arm{k}", planar2r, (5.0 * k, 0.0, 0.0))
    start, goal = np.zeros(2), np.array([1.0, 0.5])
    return rp.Problem(scene, dict.fromkeys(scene.arms, start), dict.fromkeys(scene.arms, goal))


def _in_turn(problem: rp.Problem) -> Array:
    """Waypoints on which one arm after the other moves straight to its goal."""
    goal = goal_configuration(problem)
    rows = [problem.start]
    for columns in Agent(problem, problem.arms).columns.values():
        rows.append(rows[-1].copy())
        rows[-1][columns] = goal[columns]
    return np.stack(rows)


def _polyline(points: Array, problem: rp.Problem) -> PacedPolyline:
    agent = Agent(problem, problem.arms)
    return PacedPolyline(points, agent.limits, list(agent.columns.values()))


def _duration(points: Array, problem: rp.Problem) -> float:
    """Duration at the velocity limits, each edge as long as its slowest joint needs [s]."""
    return float((np.abs(np.diff(points, axis=0)) / Agent(problem, problem.arms).limits.velocity).max(axis=1).sum())


def _is_free(checker: CollisionChecker, points: Array) -> bool:
    """Whether the certificate on Coal's distances holds for all pairs."""
    return all(checker.edge_is_free_slowly(a, b) for a, b in pairwise(clean(points)))


def _unchanged_arms(before: Array, after: Array, problem: rp.Problem) -> int:
    """Number of arms whose own polyline is the same as before, whenever they move along it."""
    count = 0
    for columns in Agent(problem, problem.arms).columns.values():
        old, new = clean(before[:, columns]), clean(after[:, columns])
        count += old.shape == new.shape and bool(np.allclose(old, new, atol=1e-9))
    return count


@pytest.mark.parametrize("robot", ["planar2r", "rr1"])
def test_replanned_paths_are_free_and_no_slower(request: pytest.FixtureRequest, robot: str) -> None:
    given: rp.Robot = request.getfixturevalue(robot)
    problem = planar_ring(given, 4) if robot == "planar2r" else rp.ring_swap(given, 4, 0.5015, rng=3)
    points, limits = clean(next(sequential_moves(problem, 0).paths())), Agent(problem, problem.arms).limits
    checker, rng, found = CollisionChecker(problem.scene, problem.arms), np.random.default_rng(1), 0
    for _ in range(60):
        made = replanned(_polyline(points, problem), checker, rng)
        if made is None:
            continue
        found += 1
        np.testing.assert_array_equal(made[[0, -1]], points[[0, -1]])
        assert (made >= limits.lower).all()
        assert (made <= limits.upper).all()
        assert _duration(made, problem) <= _duration(points, problem) * (1.0 + 1e-9)
        assert _unchanged_arms(points, made, problem) >= len(problem.arms) - 1
        assert _is_free(checker, made)
    assert found >= 5


def test_an_arm_moves_while_the_others_do(planar2r: rp.Robot) -> None:
    problem = _apart(planar2r)
    points, checker = _in_turn(problem), CollisionChecker(problem.scene, problem.arms)
    made = replanned(_polyline(points, problem), checker, np.random.default_rng(0))
    assert made is not None
    # The others need two thirds of the time; the new motion takes a random time between that and nine tenths.
    assert _duration(made, problem) <= 0.9 * _duration(points, problem)
    assert _unchanged_arms(points, made, problem) == 3


def test_an_arm_waits_until_another_one_has_passed(planar2r: rp.Robot) -> None:
    # Each sweeps the start of the other: "left" first turns away, then "right" goes through where it was.
    scene = rp.Scene().with_arm("left", planar2r, (-1.2, 0.0, 0.0)).with_arm("right", planar2r, (1.2, 0.0, 0.0))
    problem = rp.Problem(
        scene, {"left": [0.0, 0.0], "right": [np.pi - 1.2, 0.0]}, {"left": [1.4, 0.0], "right": [np.pi + 0.6, 0.0]}
    )
    points, checker, rng = _in_turn(problem), CollisionChecker(scene, problem.arms), np.random.default_rng(0)
    assert _is_free(checker, points)
    assert not checker.edge_is_free(points[0], points[-1])
    tried = [replanned(_polyline(points, problem), checker, rng) for _ in range(40)]
    faster = [made for made in tried if made is not None]
    assert faster
    assert all(_is_free(checker, made) for made in faster)
    assert min(_duration(made, problem) for made in faster) < 0.95 * _duration(points, problem)


def test_an_arm_that_moves_alone_is_not_replanned(planar2r: rp.Robot) -> None:
    apart = _apart(planar2r)
    goals = {arm: [1.0, 0.5] if arm == "arm1" else [0.0, 0.0] for arm in apart.arms}
    problem = rp.Problem(apart.scene, dict.fromkeys(apart.arms, np.zeros(2)), goals)
    polyline = _polyline(np.stack([problem.start, goal_configuration(problem)]), problem)
    checker = CollisionChecker(problem.scene, problem.arms)
    assert all(replanned(polyline, checker, np.random.default_rng(seed)) is None for seed in range(20))


def test_the_same_random_numbers_give_the_same_motion(planar2r: rp.Robot) -> None:
    problem = planar_ring(planar2r, 4)
    polyline = _polyline(clean(next(sequential_moves(problem, 1).paths())), problem)
    answers = []
    for _ in range(2):
        checker, rng = CollisionChecker(problem.scene, problem.arms), np.random.default_rng(7)
        made = [replanned(polyline, checker, rng) for _ in range(10)]
        answers.append([None if one is None else one.tobytes() for one in made])
    assert answers[0] == answers[1]
    assert any(answers[0])


def test_refined_motions_overlap_where_arms_moved_in_turn(planar2r: rp.Robot) -> None:
    problem = _apart(planar2r)
    agent = Agent(problem, problem.arms)
    checker = CollisionChecker(problem.scene, problem.arms)
    path = AgentPath(agent, Path(agent.joint_names, _in_turn(problem)), checker)
    refined = PathRefiner(checker, np.random.default_rng(0)).refine(path, lambda: True)
    straight = np.stack([problem.start, goal_configuration(problem)])
    alone = AgentPath(agent, Path(agent.joint_names, straight), checker)
    assert path.fastest > 2.0 * alone.fastest
    assert refined.fastest < 1.1 * alone.fastest


def test_a_refined_path_that_exceeds_torque_limits_is_left_out(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rp.Scene().with_arm("one", rr1, (-2.0, 0.0, 0.0)).with_arm("two", rr1, (2.0, 0.0, 0.0))
    problem = rp.Problem(scene, dict.fromkeys(scene.arms, np.zeros(6)), dict.fromkeys(scene.arms, np.full(6, 0.3)))
    agent, checker = Agent(problem, problem.arms, HopTiming(torque_limits=True)), CollisionChecker(scene, problem.arms)
    path = AgentPath(agent, Path(agent.joint_names, _in_turn(problem)), checker)
    assert path.fastest > 0.0

    def too_strong(*_: object) -> float:
        raise RetimingError("torque limits: still exceeded")

    monkeypatch.setattr(agent_path, "torque_stretch", too_strong)
    assert PathRefiner(checker, np.random.default_rng(0)).refine(path, lambda: True) is path
