"""Threads that share a checker wait for each other: no answer depends on what other threads do."""

from __future__ import annotations

import copy
import pickle
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker, TimedChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.kernels.random_state import random_state
from rr1plan.planners.shortcut import shorten
from rr1plan.planners.tree_search import Trees
from rr1plan.playback.cspace.cspace_raster import CSpaceRaster

_THREADS = 4
Question = Callable[[Any], Any]


@pytest.fixture(autouse=True)
def _frequent_switches() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def plain(answer: Any) -> Any:
    """An answer as a value that can be compared."""
    if isinstance(answer, np.ndarray):
        return answer.tobytes()
    if is_dataclass(answer):
        return plain([getattr(answer, field.name) for field in fields(answer)])
    return tuple(map(plain, answer)) if isinstance(answer, tuple | list) else answer


def ask_on_threads(shared: Any, questions: list[Question], rounds: int = 1) -> list[list[Any]]:
    """The answers of one object to all questions, for each round of each thread; threads ask in different orders."""
    begin = threading.Barrier(_THREADS)

    def ask(thread: int) -> list[list[Any]]:
        order = np.random.default_rng(thread).permutation(len(questions)).tolist()
        begin.wait()
        found = [{i: plain(questions[i](shared)) for i in order} for _ in range(rounds)]
        return [[answers[i] for i in range(len(questions))] for answers in found]

    with ThreadPoolExecutor(_THREADS) as pool:
        return [answers for found in pool.map(ask, range(_THREADS)) for answers in found]


def furnished() -> rp.Scene:
    """An arm in a cell, and a stationary arm."""
    scene = rp.load_scene("rr1_pair")
    return scene.with_obstacle("box", rp.Box((0.1, 0.1, 0.3)), [-0.2, 0.3, 0.3])


def configurations(checker: CollisionChecker, count: int) -> np.ndarray:
    """Random ones around that of the scene, some in contact."""
    home, limits = checker.scene.configuration(checker.arms), checker.limits
    steps = np.random.default_rng(5).uniform(-1.2, 1.2, (count, checker.nq))
    return np.clip(home + steps, limits.lower, limits.upper)


def grow_trees(q0: np.ndarray, q1: np.ndarray, seed: int, checker: CollisionChecker) -> Any:
    """Vertices of the trees between two configurations, by one long call of the compiled planner."""
    trees = Trees(q0, q1[None])
    low, high = checker.limits.lower, checker.limits.upper
    trees.restart(low, high - low, 0.5, 2.0, np.inf)
    found = trees.grow(random_state(seed), 60, checker)
    return found, trees.edges, trees.explored(joined=False).vertices


def shortened(points: np.ndarray, seed: int, checker: CollisionChecker) -> Any:
    path = rp.Path(checker.joint_names, points)
    return shorten(path, checker.scene, checker=checker, rng=seed, iterations=40).waypoints


def motion_questions(checker: CollisionChecker) -> list[Question]:
    """Questions of every kind, those that take scratch memory for long among them."""
    points = configurations(checker, 40)
    questions: list[Question] = []
    for q0, q1 in pairwise(points):
        near = q0 + 0.2 * (q1 - q0)
        curves = [np.array([q0, near - q0, *([0.1 * (q1 - q0)] * (terms - 2))]) for terms in (2, 3, 4)]
        questions += [lambda c, q=q0: c.is_free(q), lambda c, q=q0, to=near: c.edge_is_free(q, to)]
        questions += [lambda c, curve=curve: c.polynomial_is_free(curve, 1.0) for curve in curves]
        questions += [lambda c, q=q0: c.clearance(q), lambda c, q=q0: c.moving_clearance(q, 0.1)]
        questions += [lambda c, q=q0, to=near: c.first_contact(q, to), lambda c, q=q0: c.is_free_slowly(q)]
        questions += [lambda c, q=q0: c.is_free_ignoring(q, frozenset({"right"}))]
    questions += [lambda c: c.are_free(points), lambda c: c.edges_are_free(points[:-1], points[1:])]
    for i in range(0, len(points), 8):
        questions += [lambda c, q=points[i]: c.contacts(q), lambda c, q=points[i]: c.distances(q)]
        questions += [lambda c, q=points[i]: c.nearest(q), lambda c, q=points[i]: c.solid_points(q, 3)]
    free = [q for q in points if checker.is_free(q)]
    questions += [partial(grow_trees, free[0], free[1], seed) for seed in range(12)]
    line = free[0] + np.linspace(0.0, 0.01, 30)[:, None] * np.random.default_rng(1).normal(size=(30, checker.nq))
    questions += [partial(shortened, line, seed) for seed in range(6)]
    return questions


@pytest.mark.parametrize("arms", [None, ["left"]])
def test_answers_are_those_of_a_checker_of_one_thread(arms: list[str] | None) -> None:
    alone = CollisionChecker(furnished(), arms)
    questions = motion_questions(alone)
    expected = [plain(question(alone)) for question in questions]
    assert {True, False} <= {answer for answer in expected if isinstance(answer, bool)}
    # The first thread builds the tables.
    shared = CollisionChecker(furnished(), arms)
    for answers in ask_on_threads(shared, questions, 2):
        assert answers == expected


def test_obstacles_are_moved_between_questions_of_other_threads() -> None:
    scene = furnished()
    places = [scene.obstacles["box"].pose, rp.transforms.pose([-0.2, -0.2, 0.3])]
    both = [CollisionChecker(scene.with_obstacle_at("box", place)) for place in places]
    points = configurations(both[0], 100)
    asked: list[Question] = [lambda c, q=q: (c.is_free(q), c.is_free_slowly(q), len(c.contacts(q))) for q in points]
    asked += [lambda c, q=q: c.edge_is_free(q, q + 0.05) for q in points]
    answers = [[plain(question(checker)) for question in asked] for checker in both]
    same = [i for i, (one, two) in enumerate(zip(*answers, strict=True)) if one == two]
    assert 10 < len(same) < len(asked) - 10
    shared, done = CollisionChecker(scene), threading.Event()

    def move() -> int:
        moves = 0
        while not done.is_set() or moves % 2:
            shared.move_obstacle("box", places[(moves + 1) % 2])
            shared.keep_margin(0.0)
            moves += 1
        return moves

    with ThreadPoolExecutor(1) as pool:
        mover = pool.submit(move)
        try:
            found = ask_on_threads(shared, [asked[i] for i in same])
        finally:
            done.set()
        assert mover.result() >= 4
    assert all(thread == [answers[0][i] for i in same] for thread in found)
    assert [plain(question(shared)) for question in asked] == answers[0]


def test_edges_among_moving_arms() -> None:
    scene, rng = furnished(), np.random.default_rng(2)
    left = CollisionChecker(scene, ["left"])
    motion = rp.Trajectory.from_samples(
        scene.joint_names(["right"]), [0.0, 1.0, 2.0], rng.uniform(-1.5, 1.5, (3, 6)), np.zeros((3, 6))
    )
    questions: list[Question] = []
    for q in configurations(left, 60):
        questions += [lambda t, q=q: t.edge_is_free(q, q + 0.2, 0.3, 1.4)]
        questions += [lambda t, q=q: t.first_contact(q, q + 0.2, 0.3, 1.4)]
    alone, shared = TimedChecker(left, {"right": motion}), TimedChecker(left, {"right": motion})
    expected = [plain(question(alone)) for question in questions]
    assert {True, False} <= {answer for answer in expected if isinstance(answer, bool)}
    for answers in ask_on_threads(shared, questions, 2):
        assert answers == expected


def test_pictures_of_a_configuration_space() -> None:
    problem = rp.load_problems("planar2r_path")["over_the_seam"]
    checker = CollisionChecker(problem.scene)
    axis = np.linspace(-3.0, 3.0, 80)

    def raster() -> CSpaceRaster:
        return CSpaceRaster(checker, problem.start, (0, 1), (axis, axis))

    layers = [layer for layer in raster().ranges if raster().image(layer).any()]
    assert layers
    questions: list[Question] = [lambda r, layer=layer: r.image(layer) for layer in layers]
    expected = [plain(question(raster())) for question in questions]
    for answers in ask_on_threads(raster(), questions, 4):
        assert answers == expected


def test_forward_kinematics_and_dynamics() -> None:
    scene = rp.load_scene("rr1_pair")
    alone, shared = rp.Kinematics(scene), rp.Kinematics(scene)
    questions: list[Question] = []
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (50, alone.nq)):
        questions += [lambda k, q=q: k.pose(q, "left/tool"), lambda k, q=q: k.jacobian(q, "right/tool")]
        questions += [lambda k, q=q: tuple(k.poses(q, ["left/tool", "right/tool"]).values())]
        questions += [lambda k, q=q: k.poses_batch([q, -q], "left/tool"), lambda k, q=q: k.gravity(q)]
        questions += [lambda k, q=q: k.mass_matrix(q), lambda k, q=q: k.manipulability(q, "left/tool")]
    expected = [plain(question(alone)) for question in questions]
    for answers in ask_on_threads(shared, questions, 3):
        assert answers == expected


def test_threads_that_take_over_checkers_of_scenes_with_equal_tables() -> None:
    scenes = [furnished().with_obstacle_at("box", [-0.3 + 0.06 * k, 0.3, 0.3]) for k in range(10)]
    points = configurations(CollisionChecker(scenes[0]), 12)

    def answers(checker: CollisionChecker) -> Any:
        return [(checker.is_free(q), checker.edge_is_free(q, to)) for q, to in pairwise(points)]

    def ask(scene: rp.Scene, _: None) -> Any:
        with checker_from_pool(scene) as checker:
            assert checker.scene is scene
            return answers(checker)

    expected = [plain(answers(CollisionChecker(scene))) for scene in scenes]
    assert len(set(expected)) > 1
    for found in ask_on_threads(None, [partial(ask, scene) for scene in scenes], 4):
        assert found == expected


# ---- every method --------------------------------------------------------------------------------

_Q = np.zeros(12)
_CURVE = np.zeros((2, 12))
# Public methods and properties that use memory which others write.
LOCKED: dict[str, Question] = {
    "are_free": lambda c: c.are_free([_Q, _Q]),
    "change_to": lambda c: c.change_to(c.geometry, c.scene),
    "clearance": lambda c: c.clearance(_Q),
    "contacts": lambda c: c.contacts(_Q),
    "distances": lambda c: c.distances(_Q),
    "edge_is_free": lambda c: c.edge_is_free(_Q, _Q),
    "edge_is_free_slowly": lambda c: c.edge_is_free_slowly(_Q, _Q),
    "edges_are_free": lambda c: c.edges_are_free([_Q, _Q], [_Q, _Q]),
    "first_contact": lambda c: c.first_contact(_Q, _Q),
    "first_contact_on": lambda c: c.first_contact_on(_CURVE, 1.0),
    "is_free": lambda c: c.is_free(_Q),
    "is_free_ignoring": lambda c: c.is_free_ignoring(_Q, frozenset({"left"})),
    "is_free_slowly": lambda c: c.is_free_slowly(_Q),
    "keep_margin": lambda c: c.keep_margin(0.001),
    "memory_image": lambda c: c.memory_image(),
    "move_obstacle": lambda c: c.move_obstacle("box", [-0.2, 0.3, 0.3]),
    "moving_clearance": lambda c: c.moving_clearance(_Q),
    "nearest": lambda c: c.nearest(_Q),
    "path_is_free": lambda c: c.path_is_free([_Q, _Q]),
    "polynomial_is_free": lambda c: c.polynomial_is_free(_CURVE, 1.0),
    "solid_distances": lambda c: c.solid_distances(_Q),
    "solid_points": lambda c: c.solid_points(_Q, 0),
    "static_contacts": lambda c: c.static_contacts,
    "run_edge_kernel": lambda c: grow_trees(_Q, _Q + 0.1, 0, c),
    "run_exact_kernel": lambda c: c.run_exact_kernel(lambda *_: None),
}
# Those that are computed once, under the lock; those that read counters, the present scene, or what does not change.
COMPUTED_ONCE = {
    *("exact_kernel", "fixed", "joint_names", "limits", "model", "object_numbers", "omitted_clearance", "pairs"),
    *("static_is_free", "tables", "warm_up"),
}
CONSTANT = {
    "checked",
    "complete",
    "counters",
    "geometry",
    "is_warm",
    "limit_violations",
    "scene",
    "solids",
    "within_limits",
}


def test_the_lists_of_methods_are_complete() -> None:
    assert {name for name in dir(CollisionChecker) if not name.startswith("_")} == {*LOCKED, *COMPUTED_ONCE, *CONSTANT}


@pytest.mark.parametrize("name", [*LOCKED, *sorted(COMPUTED_ONCE)])
def test_every_method_waits_while_another_thread_uses_the_checker(name: str) -> None:
    def ask(question: Question) -> None:
        began.set()
        question(checker)
        ended.set()

    if name in COMPUTED_ONCE:
        question = CollisionChecker.warm_up if name == "warm_up" else lambda c: getattr(c, name)
    else:
        question = LOCKED[name]
    checker, began, ended = CollisionChecker(furnished()), threading.Event(), threading.Event()
    other = threading.Thread(target=ask, args=(question,), daemon=True)
    with checker._lock:
        for computed in COMPUTED_ONCE:
            vars(checker).pop(computed, None)
        other.start()
        began.wait()
        assert not ended.wait(0.02)
    other.join()
    assert ended.is_set()


def test_copies_have_their_own_lock() -> None:
    checker = CollisionChecker(furnished(), margin=0.001)
    with checker._lock:
        for other in (pickle.loads(pickle.dumps(checker)), copy.deepcopy(checker), copy.copy(checker)):
            with ThreadPoolExecutor(1) as pool:
                assert pool.submit(other.is_free, _Q).result() == checker.is_free(_Q)
            assert other.margin == checker.margin
