"""Coordination diagrams: free cells are free for checkers that share no code with them."""

from __future__ import annotations

import time
from itertools import combinations, product

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths import path_memory
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.path_memory import PathMemory
from rr1plan.multi.paths.placed_path import placed_configuration, placed_configurations
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import are_apart, conflicts, coordination_diagram
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.path import Path

# Two arms side by side whose hands sweep the same room.
_LEFT = np.array(
    [
        [-2.28, -0.2, 1.13, -1.58, 2.17, -1.18],
        [-2.05, -0.24, 0.56, 0.01, 1.72, -0.22],
        [-1.06, -0.01, 1.33, -1.41, 2.3, -1.17],
    ]
)
_RIGHT = np.array([[-1.44, -0.14, -1.28, 2.05, 1.15, -1.53], [-2.35, -0.35, -0.9, -0.39, 1.89, 2.27]])


class _Alone:
    """Certifies all blends."""

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        return True


def _problem(robot: rp.Robot, spacing: float = 0.5) -> rp.Problem:
    scene = rp.Scene()
    for arm, side in (("arm01", -0.5), ("arm02", 0.5)):
        base = rp.transforms.pose((side * spacing, 0.0, 0.0), rpy=(0.0, 0.0, np.pi / 2))
        scene = scene.with_arm(arm, robot, base)
    return rp.Problem(scene, {"arm01": _LEFT[0], "arm02": _RIGHT[0]}, {"arm01": _LEFT[-1], "arm02": _RIGHT[-1]})


def _paths(problem: rp.Problem) -> tuple[AgentPath, AgentPath]:
    made = []
    for arm, points in (("arm01", _LEFT), ("arm02", _RIGHT)):
        agent = Agent(problem, [arm])
        made.append(AgentPath(agent, Path(agent.joint_names, points), _Alone()))
    return made[0], made[1]


def _somewhere(path: AgentPath, row: int, rng: np.random.Generator) -> Array:
    """A configuration in a row of diagrams."""
    if row in (0, path.cells - 1):
        return path.at(0 if row == 0 else path.segments)
    piece, offset, delta = (part[row - 1] for part in path.grid)
    c, s = path.curve.coefficients[piece], offset + rng.random() * delta
    return c[0] + s * (c[1] + s * c[2])


@pytest.fixture(scope="module")
def crossing(rr1: rp.Robot) -> tuple[rp.Problem, AgentPath, AgentPath, Array]:
    problem = _problem(rr1)
    one, two = _paths(problem)
    blocked = coordination_diagram(one, two)
    assert blocked is not None
    return problem, one, two, blocked


def test_what_is_free_in_a_diagram_is_free_for_coal(crossing) -> None:
    problem, one, two, blocked = crossing
    assert blocked.shape == (one.cells, two.cells)
    assert 0.02 < blocked.mean() < 0.6
    checker, rng = CollisionChecker(problem.scene), np.random.default_rng(0)
    touching = 0
    for i, j in product(range(one.cells), range(two.cells)):
        q = np.concatenate([_somewhere(one, i, rng), _somewhere(two, j, rng)])
        if blocked[i, j]:
            touching += not checker.is_free(q)
        else:
            owners = [{problem.scene.owner(c.a), problem.scene.owner(c.b)} for c in checker.contacts(q)]
            assert {"arm01", "arm02"} not in owners
    # Most blocked cells contain a contact.
    assert touching > 0.6 * blocked.sum()


def test_free_cells_are_free_along_straight_edges_of_both_arms(crossing) -> None:
    problem, one, two, blocked = crossing
    scene = problem.scene
    for arm in ("arm01", "arm02"):
        own = [name for name in scene.element_names if scene.owner(name) == arm]
        for a, b in combinations(own, 2):
            scene = scene.allow(a, b)
    checker, rng = CollisionChecker(scene), np.random.default_rng(1)
    for i, j in product(range(1, one.cells - 1, 2), range(1, two.cells - 1, 2)):
        if not blocked[i, j]:
            begin, end = (np.concatenate([_somewhere(one, i, rng), _somewhere(two, j, rng)]) for _ in range(2))
            # On a parabola the straight edge leaves the path.
            if one.curve.coefficients[one.grid.piece[i - 1], 2].any():
                continue
            if two.curve.coefficients[two.grid.piece[j - 1], 2].any():
                continue
            assert checker.edge_is_free(begin, end)


def test_a_diagram_is_that_of_the_other_order_transposed(crossing) -> None:
    _, one, two, blocked = crossing
    other = coordination_diagram(two, one)
    assert other is not None
    # Searches that end early by rounding may depend on the order.
    assert np.mean(blocked != other.T) < 0.01


def test_a_margin_and_padding_block_more(rr1: rp.Robot) -> None:
    problem = _problem(rr1)
    one, two = _paths(problem)
    plain, wide = coordination_diagram(one, two), coordination_diagram(one, two, margin=0.03)
    padded = rp.Problem(problem.scene.with_padding(0.03), problem.start, dict(problem.goal))
    assert plain is not None
    assert wide is not None
    assert wide.sum() > plain.sum()
    assert not (plain & ~wide).any()
    np.testing.assert_array_equal(coordination_diagram(*_paths(padded)), wide)


def test_allowed_contacts_and_distant_arms_block_nothing(rr1: rp.Robot) -> None:
    problem = _problem(rr1)
    allowed = rp.Problem(problem.scene.allow("arm01", "arm02"), problem.start, dict(problem.goal))
    assert coordination_diagram(*_paths(allowed)) is None
    assert coordination_diagram(*_paths(_problem(rr1, 3.0))) is None


def test_configurations_are_apart_where_no_contact_is(rr1: rp.Robot) -> None:
    problem = _problem(rr1)
    agents = [Agent(problem, [arm]) for arm in problem.arms]
    checker, rng = CollisionChecker(problem.scene), np.random.default_rng(3)
    seen = set()
    for _ in range(60):
        q = rng.uniform(np.tile(rr1.limits.lower, 2), np.tile(rr1.limits.upper, 2))
        placed = [placed_configuration(agent.bodies, part) for agent, part in zip(agents, (q[:6], q[6:]), strict=True)]
        apart = are_apart(agents[0], placed[0], agents[1], placed[1])
        owners = [{problem.scene.owner(c.a), problem.scene.owner(c.b)} for c in checker.contacts(q)]
        assert apart == ({"arm01", "arm02"} not in owners)
        seen.add(apart)
    assert seen == {True, False}


@pytest.mark.parametrize("counts", [(1, 1), (3, 2), (4, 5)])
def test_conflicts_of_several_configurations_are_those_of_each_two(rr1: rp.Robot, counts: tuple[int, int]) -> None:
    problem, rng = _problem(rr1), np.random.default_rng(4)
    one, two = (Agent(problem, [arm]) for arm in problem.arms)
    seen = set()
    for _ in range(40):
        mine, theirs = (rng.uniform(rr1.limits.lower, rr1.limits.upper, (count, 6)) for count in counts)
        both = placed_configurations(one.bodies, mine), placed_configurations(two.bodies, theirs)
        found = conflicts(one, both[0], two, both[1], 0.01)
        each = [
            [
                not are_apart(one, placed_configuration(one.bodies, a), two, placed_configuration(two.bodies, b), 0.01)
                for b in theirs
            ]
            for a in mine
        ]
        np.testing.assert_array_equal(found, each)
        seen.update(found.ravel().tolist())
    assert seen == {0, 1}


@pytest.mark.parametrize("share", [0.0, 0.001, 0.05, 1.0])
def test_wanted_cells_are_those_of_the_whole_diagram(crossing, share: float) -> None:
    _, one, two, whole = crossing
    for rng in np.random.default_rng(0).spawn(4):
        wanted = rng.random(whole.shape) < share
        wanted[0, 0] = wanted[-1, -1] = share > 0.0
        part = coordination_diagram(one, two, wanted=wanted)
        part = np.zeros_like(whole) if part is None else part
        np.testing.assert_array_equal(part, np.where(wanted, whole, 0))


def test_once_it_is_stopped_nothing_is_proven_free(crossing) -> None:
    _, one, two, _ = crossing
    free, late = np.zeros(1, np.int64), np.ones(1, np.int64)
    np.testing.assert_array_equal(coordination_diagram(one, two, stop=free), coordination_diagram(one, two))
    stopped = coordination_diagram(one, two, stop=late)
    assert stopped is not None
    assert stopped.shape == (one.cells, two.cells)
    assert stopped.all()


def test_diagrams_that_were_stopped_are_not_kept(crossing) -> None:
    _, one, two, _ = crossing
    watch = Stopwatch(0.0)
    diagrams = DiagramCache(watch=watch)
    in_time = diagrams.diagram(one, two)
    assert in_time is not None
    assert not in_time.all()
    diagrams.keep_only([])
    with watch:
        while not watch.stop[0]:
            time.sleep(1e-3)
    late = diagrams.diagram(one, two)
    assert late is not None
    assert late.all()
    assert late.shape == in_time.shape
    assert len(diagrams) == 0


def test_paths_are_not_placed_after_a_stop(crossing) -> None:
    _, one, two, _ = crossing
    for path in (one, two):
        path.release()
    assert not one.place(np.ones(1, np.int64))
    assert one.place(np.zeros(1, np.int64))
    assert one.place(np.ones(1, np.int64)), "it is placed already"
    # What was stopped is placed completely when it is needed.
    assert not two.place(np.ones(1, np.int64))
    assert coordination_diagram(one, two) is not None


def test_paths_are_released_from_memory_in_the_order_of_their_last_use(
    rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, paths = PathMemory(), [path for _ in range(2) for path in _paths(_problem(rr1))]
    for path in paths:
        assert memory.place(path)
    sizes = [path.placed_bytes for path in paths]
    assert min(sizes) > 10_000
    assert memory.place(paths[0])
    monkeypatch.setattr(path_memory, "_MOST_BYTES", sum(sizes) - 1)
    assert memory.place(paths[3])
    assert [path.placed_bytes > 0 for path in paths] == [True, False, True, True]
    monkeypatch.setattr(path_memory, "_MOST_BYTES", 0)
    assert memory.place(paths[1], paths[2]), "what is used now is kept"
    assert [path.placed_bytes for path in paths] == [0, sizes[1], sizes[2], 0]
    assert not memory.place(paths[0], stop=np.ones(1, np.int64))
    assert paths[0].placed_bytes == 0


def test_plans_do_not_depend_on_the_memory_of_paths(rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = rp.random_grid(rr1, 9, 0.5, 3)
    plan = rp.plan_many_arms(problem, rng=3, budget=rp.Budget(60.0))
    monkeypatch.setattr(path_memory, "_MOST_BYTES", 0)
    again = rp.plan_many_arms(problem, rng=3, budget=rp.Budget(60.0))
    assert plan
    assert again
    assert plan.trajectory.coefficients.tobytes() == again.trajectory.coefficients.tobytes()


def test_a_cancelled_clock_stops_what_takes_long() -> None:
    watch = Stopwatch(np.inf, lambda _: False)
    with watch:
        assert not watch.stop[0]
        assert not watch.goes_on()
    assert watch.stop[0]
    assert watch.cancelled
