"""User-defined planners: accepted by instance or by name, checked against the contract, and rejected with a reason."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import planners

FOUND = rp.PlanStatus.FOUND


class ViaPoint(rp.Planner):
    """A path over one random waypoint: as simple as a planner can be that keeps the contract."""

    name = "via_point"

    def plan(
        self,
        problem: rp.Problem,
        *,
        budget: rp.Budget | None = None,
        rng: rp.Seed = None,
        progress: rp.ProgressCallback | None = None,
    ) -> rp.PlanResult:
        generator = np.random.default_rng(rng)
        limits = problem.scene.limits(problem.arms)
        lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
        checker = rp.CollisionChecker(problem.scene, problem.arms, margin=problem.margin)
        (goal,) = problem.goal[problem.arms[0]]
        assert isinstance(goal, rp.JointGoal)
        most = (budget or rp.Budget()).iterations or 10_000
        for iteration in range(most):
            if progress is not None and progress(rp.Progress(self.name, 0.0, iteration / most)) is False:
                return rp.PlanResult(rp.PlanStatus.CANCELLED, None, "cancelled")
            points = [problem.start, generator.uniform(lower, upper), goal.q]
            if checker.path_is_free(points):
                return rp.PlanResult(FOUND, rp.Path(problem.joint_names, points), iterations=iteration + 1)
        return rp.PlanResult(rp.PlanStatus.TIMEOUT, None, "no path over one waypoint", iterations=most)


class Answering(rp.Planner):
    """Returns a given result."""

    name = "answering"

    def __init__(self, answer: Callable[[rp.Problem], Any]) -> None:
        self.answer = answer

    def plan(self, problem: rp.Problem, **_: Any) -> rp.PlanResult:
        return self.answer(problem)


class InThisThread(Executor):
    def submit(self, function: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args, **options))
        return future


@pytest.fixture
def problem() -> rp.Problem:
    """A box between start and goal: the straight line is blocked, a way around it is not far."""
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    return rp.Problem(scene.with_obstacle("box", rp.Sphere(0.1), [1.7, 0.0, 0.0]), [-0.8, 0.0], [0.8, 0.0])


@pytest.fixture
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planners, "_registered", {})
    rp.register_planner("mine", ViaPoint, description="over one waypoint")


# ---- the contract -----------------------------------------------------------------------------


def test_its_path_is_taken_and_what_it_left_out_is_filled_in(problem: rp.Problem) -> None:
    result = rp.plan(problem, planner=ViaPoint(), rng=3)
    assert result.found
    assert result.planner == "via_point"
    assert result.seconds > 0.0
    again = rp.plan(problem, planner=ViaPoint(), rng=3)
    np.testing.assert_array_equal(again.path_or_raise().waypoints, result.path_or_raise().waypoints)


def test_the_whole_line_takes_it(problem: rp.Problem) -> None:
    motion = rp.plan_motion(problem, planner=ViaPoint(), rng=3)
    assert motion
    assert motion.result.planner == "via_point"


def test_a_planner_that_keeps_its_shape_is_not_shortened(problem: rp.Problem) -> None:
    class Kept(ViaPoint):
        keeps_shape = True

    motion = rp.plan_motion(problem, planner=Kept(), rng=3)
    np.testing.assert_array_equal(motion.path.waypoints, motion.result.path_or_raise().waypoints)
    assert "shorten" not in motion.seconds


def test_batches_take_it(problem: rp.Problem) -> None:
    (answer,) = rp.plan_many([problem], planner=ViaPoint(), executor=InThisThread(), workers=1, rng=0)
    assert answer.valid
    with pytest.raises(rp.InputError, match="'answering' cannot be sent to other processes"):
        rp.plan_many([problem], planner=Answering(lambda _: None))


def test_no_path_is_an_answer_too(problem: rp.Problem) -> None:
    result = rp.plan(problem, planner=ViaPoint(), budget=rp.Budget(iterations=1), rng=2)
    assert (result.found, result.status) == (False, rp.PlanStatus.TIMEOUT)
    cancelled = rp.plan(problem, planner=ViaPoint(), progress=lambda _: False)
    assert cancelled.status is rp.PlanStatus.CANCELLED


# ---- by name ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("_registered")
def test_a_registered_planner_has_a_name_like_any_other(problem: rp.Problem) -> None:
    assert rp.planner_names()[-1] == "mine"
    assert planners.planner_table()[-1].description == "over one waypoint"
    assert rp.plan(problem, planner="mine", rng=0).found
    assert rp.plan_motion(problem, planner="mine", rng=0).valid
    (answer,) = rp.plan_many([problem], planner="mine", executor=InThisThread(), workers=1, rng=0, full=False)
    assert answer.found


@pytest.mark.usefixtures("_registered")
@pytest.mark.parametrize(
    ("name", "factory", "said"),
    [
        ("mine", ViaPoint, "the name is taken"),
        ("rrt_connect", ViaPoint, "the name is taken"),
        ("many_arms", ViaPoint, "the name is taken"),
        ("", ViaPoint, "no name"),
        ("a b\n", ViaPoint, "no white space or control characters"),
        ("a\x1b", ViaPoint, "no white space or control characters"),
        ("other", "ViaPoint", "factory is 'ViaPoint'"),
    ],
)
def test_a_name_is_registered_once(name: str, factory: Any, said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.register_planner(name, factory)


@pytest.mark.usefixtures("_registered")
@pytest.mark.parametrize(
    ("factory", "said"),
    [(lambda: 3, "returned 3, expected a Planner"), (lambda: 1 / 0, "raised ZeroDivisionError: division by zero")],
)
def test_a_factory_that_makes_no_planner_is_named(factory: Any, said: str, problem: rp.Problem) -> None:
    rp.register_planner("broken", factory)
    with pytest.raises(rp.PlannerError, match=f"the factory of planner 'broken' {said}"):
        rp.plan(problem, planner="broken")


# ---- nonsense ---------------------------------------------------------------------------------


def found(problem: rp.Problem, *points: Any, names: tuple[str, ...] | None = None) -> rp.PlanResult:
    return rp.PlanResult(FOUND, rp.Path(problem.joint_names if names is None else names, np.array(points)))


NONSENSE: dict[str, tuple[Callable[[rp.Problem], Any], str]] = {
    "nothing": (lambda p: None, "returned None, expected a PlanResult"),
    "waypoints": (lambda p: [p.start], "expected a PlanResult"),
    "status of text": (lambda p: rp.PlanResult("found", None), "status 'found', expected a PlanStatus"),
    "found without a path": (lambda p: rp.PlanResult(FOUND, None), "with path None, expected a Path"),
    "waypoints for a path": (lambda p: rp.PlanResult(FOUND, np.array([p.start])), "expected a Path"),
    "timeout with a path": (
        lambda p: rp.PlanResult(rp.PlanStatus.TIMEOUT, rp.Path(p.joint_names, p.start[None])),
        "returned a path with status 'timeout'",
    ),
    "reason of None": (lambda p: rp.PlanResult(rp.PlanStatus.TIMEOUT, None, None), "reason is None, expected text"),
    "seed of text": (lambda p: replace(found(p, p.start), seed="7"), "seed is '7', expected a whole number"),
    "negative time": (lambda p: replace(found(p, p.start), seconds=-1.0), "seconds is -1.0, expected a number >= 0"),
    "time of text": (lambda p: replace(found(p, p.start), seconds="1"), "seconds is not a number: '1'"),
    "tree of lists": (lambda p: replace(found(p, p.start), tree=[[0.0]]), "tree is of type list, expected SearchTree"),
    "other joints": (lambda p: found(p, [0.0, 0.0], names=("arm/a", "arm/b")), "a path of joints arm/a, arm/b"),
    "another start": (lambda p: found(p, [0.0, 0.5], [0.8, 0.0]), "begins 0.8 rad .* from the problem's start"),
    "another goal": (lambda p: found(p, p.start, [0.8, 0.5]), "does not end at a goal of arm 'arm': .* 0.5 rad"),
    "through the box": (
        lambda p: found(p, p.start, [0.8, 0.0]),
        "edge to waypoint 1 is not certified free: .*box.* touch",
    ),
    "not a number": (
        lambda p: rp.PlanResult(FOUND, rp.Path.trusted(p.joint_names, np.array([p.start, [np.nan, 0.0]]))),
        "not finite",
    ),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_is_refused_in_words(name: str, problem: rp.Problem) -> None:
    answer, said = NONSENSE[name]
    for ask in (rp.plan, rp.plan_motion):
        with pytest.raises(rp.PlannerError, match=f"^planner 'answering' .*{said}"):
            ask(problem, planner=Answering(answer))


def test_a_path_beyond_the_limits_is_refused() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r_limited"))
    limits = scene.limits()
    problem = rp.Problem(scene, "home", "home")
    far = Answering(lambda p: found(p, p.start, limits.upper + 0.1, p.start))
    with pytest.raises(rp.PlannerError, match=r"leaves the limits of arm 'arm': joint .* outside"):
        rp.plan(problem, planner=far)


@pytest.mark.parametrize(
    ("goal", "q", "said"),
    [
        (rp.PoseGoal("tool", [1.0, 1.0, 0.0]), [0.0, 0.0], "its frame ends .* m from it"),
        (rp.RegionGoal("tool", [1.0, 1.0, -1.0], [1.5, 1.5, 1.0]), [0.0, 0.0], "its frame ends .* m from it"),
        (rp.PoseGoal("tool", [1.7, 0.0, 0.0], [0, 0, 0, 1]), [0.0, 0.0], "its frame ends turned by 3.14 rad"),
    ],
)
def test_goals_in_space_are_checked(goal: rp.Goal, q: list[float], said: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    with pytest.raises(rp.PlannerError, match=said):
        rp.plan(rp.Problem(scene, [0.1, 0.1], goal), planner=Answering(lambda p: found(p, p.start, q)))


def test_a_goal_in_space_that_is_reached_is_taken() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    T = rp.Kinematics(scene).pose([0.4, 0.3])
    for goal in (rp.PoseGoal("tool", T), rp.RegionGoal("tool", T[:3, 3], T[:3, 3])):
        problem = rp.Problem(scene, [0.1, 0.1], goal)
        assert rp.plan(problem, planner=Answering(lambda p: found(p, p.start, [0.4, 0.3]))).found


def test_what_it_raises_is_told_and_our_own_errors_pass(problem: rp.Problem) -> None:
    def fail(_: rp.Problem) -> None:
        raise ZeroDivisionError("no samples")

    with pytest.raises(rp.PlannerError, match="planner 'answering' raised ZeroDivisionError") as caught:
        rp.plan(problem, planner=Answering(fail))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)

    def refuse(_: rp.Problem) -> None:
        raise rp.InputError("one arm only")

    with pytest.raises(rp.InputError, match=r"^one arm only$"):
        rp.plan(problem, planner=Answering(refuse))


def test_a_result_without_a_planner_names_none() -> None:
    path = rp.Path(["arm/joint1"], [[0.0], [1.0]])
    assert repr(rp.PlanResult(rp.PlanStatus.FOUND, path)) == "PlanResult(found: 2 waypoints, length 1.00)"
    with pytest.raises(rp.errors.NoPlanError, match=r"^timeout: none$"):
        rp.PlanResult(rp.PlanStatus.TIMEOUT, None, "none").path_or_raise()


def test_a_planner_without_a_name_or_a_base_is_refused(problem: rp.Problem) -> None:
    class Nameless(ViaPoint):
        name = None

    with pytest.raises(rp.InputError, match="a Nameless without a name"):
        rp.plan(problem, planner=Nameless())
    for wrong in (ViaPoint, 3, None):
        with pytest.raises(rp.InputError, match="expected a name of planner_names"):
            rp.plan(problem, planner=wrong)
    with pytest.raises(rp.errors.UnknownNameError, match="plan_motion takes 'many_arms', which makes a motion"):
        rp.plan(problem, planner="many_arms")
