"""The truth value of every result is its verdict, so that `assert rp.validate(...)` works."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.simulation.replay import Replay, ReplayContact, ReplayRecord


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.load_problems("planar2r_path")["to_a_point"]


def test_a_report_is_true_if_it_is_valid(problem: rp.Problem) -> None:
    motion = rp.plan_motion(problem, rng=0)
    assert bool(rp.validate(motion.trajectory, problem.scene, problem)) is True
    assert bool(rp.validate(motion.trajectory.stretched(0.2), problem.scene, problem)) is False
    assert bool(rp.certify_path(motion.path, problem.scene)) is True
    assert bool(rp.Report((), {}, ())) is True


def test_a_motion_plan_is_true_if_it_is_proven_valid(problem: rp.Problem) -> None:
    motion = rp.plan_motion(problem, rng=0)
    assert bool(motion) is True
    hurt = rp.validate(motion.trajectory.stretched(0.2), problem.scene, problem)
    assert bool(replace(motion, _report=hurt)) is False
    cancelled = rp.validate(motion.trajectory, problem.scene, problem, progress=lambda _: False)
    assert bool(replace(motion, _report=cancelled)) is cancelled.certified
    assert bool(replace(motion, _report=rp.Report((), {}, ("velocity",)))) is False
    impossible = rp.plan_motion(next(iter(rp.load_problems("planar2r_no_path").values())), budget=rp.Budget(0.2))
    assert bool(impossible) is False
    assert bool(impossible.result) is False
    assert bool(motion.result) is True
    assert bool(rp.PlanFailure(problem, "ValueError", "broken")) is False


def test_inverse_kinematics_is_true_if_it_found_a_solution(problem: rp.Problem) -> None:
    kinematics = rp.Kinematics(problem.scene)
    assert bool(rp.solve_ik(kinematics, rp.PoseGoal("tool", [0.5, 0.5, 0.0], position_tolerance=0.5), rng=0)) is True
    assert bool(rp.solve_ik(kinematics, rp.PoseGoal("tool", [50.0, 0.0, 0.0]), rng=0)) is False


@pytest.mark.parametrize("contacts", [(), (ReplayContact(("arm/link", "wall"), 0.0, 0.1, 0.001),)])
def test_a_replay_is_true_if_nothing_touched(contacts: tuple[ReplayContact, ...]) -> None:
    one = np.zeros((1, 1))
    record = ReplayRecord(one[0], one, one)
    replay = Replay("dynamic", ("arm/joint",), record, one[0], one[0], one[0], contacts, 1, 0.002, 1.0)
    assert bool(replay) is not bool(contacts)


SLIDE = """<robot name="slide"><link name="a"/><link name="b"/><joint name="j" type="prismatic">
<parent link="a"/><child link="b"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint></robot>"""


def test_a_replay_has_the_units_of_its_joints(tmp_path: Path) -> None:
    names, two = ("arm/slide", "arm/hinge"), np.array([0.001, 0.02])
    record = ReplayRecord(np.zeros(1), two[None], two[None])
    replay = Replay("dynamic", names, record, two, two, two, (), 1, 0.002, 1.0, units=("m", "rad"))
    assert "1.00e-03 m, 2.00e-02 rad" in repr(replay)
    assert "1.00e-03 m at most (arm/slide), 2.00e-02 rad at most (arm/hinge)" in str(replay)
    (tmp_path / "slide.urdf").write_text(SLIDE)
    slide = rp.Scene().with_arm("arm", rp.load_robot(tmp_path / "slide.urdf"))
    rest = rp.Trajectory.rest(slide.joint_names(), [0.0], duration=0.1)
    assert rp.simulate(rest, slide, mode="kinematic").units == ("m",)


def test_a_first_contact_is_none_where_there_is_none(problem: rp.Problem) -> None:
    motions = rp.CollisionChecker(problem.scene)
    assert motions.first_contact(problem.start, problem.start) is None
