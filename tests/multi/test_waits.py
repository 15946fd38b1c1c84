"""Who waits for whom, and positions of two arms in their coordination diagram."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.multi.search.space_time import SpaceTimeSearch
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.multi.timing.waits import pair_timing, undelayed, waits_of


@pytest.fixture(scope="module")
def motion() -> rp.MotionPlan:
    """Eight arms on a grid, of which one waits and two were planned in their joint space."""
    problem = rp.random_grid(rp.load_robot("rr1"), 8, 0.6, 2)
    with pytest.MonkeyPatch.context() as patch:
        # Arms that are planned in space and time rarely wait: they move slowly instead.
        patch.setattr(SpaceTimeSearch, "solve", lambda _: None)
        found = rp.plan_motion(problem, planner="many_arms", rng=0, budget=rp.Budget(60))
    assert found.valid
    return found


def in_contact(schedules: list[Schedule], problem: rp.Problem, step: float = 0.005) -> set[frozenset[str]]:
    """Pairs of arms that Coal finds nearer than 2 mm at instants; the planner keeps at least that distance."""
    trajectory = rp.Trajectory.merge(*(schedule.trajectory() for schedule in schedules))
    arms = tuple(dict.fromkeys(name.split("/")[0] for name in trajectory.joint_names))
    order = [trajectory.joint_names.index(name) for name in problem.scene.joint_names(arms)]
    checker = rp.CollisionChecker(problem.scene.with_margin(2e-3), arms)
    pairs: set[frozenset[str]] = set()
    for time in np.arange(trajectory.start_time, trajectory.end_time, step):
        for contact in checker.contacts(trajectory(time)[order]):
            owners = {problem.scene.owner(contact.a), problem.scene.owner(contact.b)}
            if len(owners) == 2 and None not in owners:
                pairs.add(frozenset(str(owner) for owner in owners))
    return pairs


def test_an_arm_that_does_not_wait_touches_one_that_it_waits_for(motion: rp.MotionPlan) -> None:
    """The slow way: without its wait, an arm gets too close to one of the arms that the wait names."""
    assert motion.many_arms is not None
    schedules = motion.many_arms.separated.schedules
    for wait in waits_of(schedules):
        own = next(s for s in schedules if wait.arm in s.arms)
        others = [s for s in schedules if set(wait.others) & set(s.arms)]
        if not others or len(own.arms) > 1 or wait.begin > 0.0:
            continue
        earlier = Schedule(own.path, tuple(Leg(leg.departure - wait.end, leg.begin, leg.end) for leg in own.legs))
        met = in_contact([earlier, *others], motion.problem)
        assert any(frozenset((wait.arm, other)) in met for other in wait.others), wait


def test_waits_are_the_rests_of_schedules(motion: rp.MotionPlan) -> None:
    assert motion.many_arms is not None
    schedules = motion.many_arms.separated.schedules
    waits = waits_of(schedules)
    assert waits
    for schedule in schedules:
        own = [wait for wait in waits if wait.arm == schedule.arms[0]]
        assert sum(w.end - w.begin for w in own) == pytest.approx(schedule.waiting, abs=1e-9)
        assert all(wait.arm not in wait.others for wait in own)
        assert undelayed(schedules)[schedule.arms[0]] <= schedule.arrival + 1e-9


def test_the_curve_of_a_plan_stays_out_of_blocked_cells(motion: rp.MotionPlan) -> None:
    assert motion.many_arms is not None
    schedules = motion.many_arms.separated.schedules
    crowded = 0
    for i, one in enumerate(schedules):
        for two in schedules[i + 1 :]:
            timing = pair_timing(one, two)
            crowded += bool(timing.blocked.any())
            assert timing.blocked.shape == tuple(len(lengths) + 1 for lengths in timing.lengths)
            np.testing.assert_allclose(timing.places[0], 0.0)
            np.testing.assert_allclose(timing.places[-1], [len(lengths) - 1 for lengths in timing.lengths])
            # Between two events both are inside one segment or at rest at an end of it.
            middle = 0.5 * (timing.places[1:] + timing.places[:-1])
            cells = np.floor(middle).astype(int) + 1
            moves = np.abs(np.diff(timing.places, axis=0)) > 1e-12
            both = moves.all(axis=1)
            assert not timing.blocked[cells[both, 0], cells[both, 1]].any()
    assert crowded


def test_places_are_where_the_trajectory_is(motion: rp.MotionPlan) -> None:
    assert motion.many_arms is not None
    one, two = motion.many_arms.separated.schedules[:2]
    timing = pair_timing(one, two)
    for side, schedule in enumerate((one, two)):
        trajectory = schedule.trajectory()
        at = timing.places[:, side]
        whole = np.abs(at - np.round(at)) < 1e-9
        for time, place in zip(timing.times[whole], at[whole], strict=True):
            q = trajectory(min(time, trajectory.end_time))
            np.testing.assert_allclose(q, schedule.path.at(round(place)), atol=1e-6)


def test_a_plan_says_which_pairs_have_no_diagram(motion: rp.MotionPlan) -> None:
    with pytest.raises(rp.UnknownNameError, match="moving arm"):
        motion.coordination_diagram("arm01", "arm99")
    with pytest.raises(rp.InputError, match="named twice"):
        motion.coordination_diagram("arm01", "arm01")
    problem = rp.load_problems("rr1_pair")["change_places"]
    alone = rp.plan_motion(problem, rng=0)
    with pytest.raises(rp.InputError, match="planner='many_arms'"):
        alone.coordination_diagram("left", "right")
    assert alone.timeline().arms == ("left", "right")
    stuck = rp.plan_motion(rp.Problem(problem.scene, None, {"left": rp.PoseGoal("tool", (5.0, 0.0, 0.0))}), rng=0)
    with pytest.raises(rp.NoPlanError):
        stuck.timeline()
