"""Mirrors: streams of joint states from all sources, compared with a plan; faults are named."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.mirror.joint_states import parse_state
from rr1plan.transforms import pose

ARM = tuple(f"rr1/{name}" for name in rp.load_robot("rr1").joint_names)


@pytest.fixture(scope="module")
def scene() -> rp.Scene:
    return rp.load_scene("rr1_table")


@pytest.fixture(scope="module")
def plan(scene: rp.Scene) -> rp.Trajectory:
    motion = rp.plan_motion(rp.Problem(scene, "home", rp.PoseGoal("tool", [-0.30, 0.25, 0.20])), rng=0)
    assert motion.trajectory is not None
    return motion.trajectory.stretched(4.0)


def messages(plan: rp.Trajectory, rate: float = 50.0, start: float = 0.0) -> list[rp.StateMessage]:
    times = np.arange(0.0, plan.duration, 1.0 / rate)
    return [rp.StateMessage(start + t, plan.joint_names, plan(t), received=t + 7.0 + 0.002 * (t > 1.0)) for t in times]


def kinds(mirror: rp.Mirror) -> list[str]:
    return [event.kind for event in mirror.events]


def test_a_stream_without_a_usable_message_is_not_called_safe(scene: rp.Scene, plan: rp.Trajectory) -> None:
    first = plan.joint_names[0]
    names = (f"{first}x", *plan.joint_names[1:])
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run([replace(message, joint_names=names) for message in messages(plan)])
    assert not report
    assert report.messages == 0
    assert "nothing was compared with the plan" in str(report)
    assert "always inside" not in str(report)
    assert f"unknown joint {first + 'x'!r} in the message of 0.000 s. Did you mean {first!r}?" in str(mirror.events[0])


def test_positions_that_are_never_finite_are_not_called_missing(scene: rp.Scene, plan: rp.Trajectory) -> None:
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run([replace(message, positions=np.full(6, np.nan)) for message in messages(plan)])
    said = f"nothing was compared with the plan: no message had finite positions of {', '.join(plan.joint_names)}"
    assert said in str(report)


def test_links_without_a_collision_shape_are_named(scene: rp.Scene, plan: rp.Trajectory) -> None:
    robot = scene.arms["rr1"].robot
    hand = robot.link("hand_link")
    bare = replace(hand, visuals=hand.collisions, collisions=())
    bare_robot = replace(robot, links=tuple(bare if link is hand else link for link in robot.links))
    with rp.Mirror(scene.with_robot("rr1", bare_robot), plan) as mirror:
        report = mirror.run(messages(plan, rate=5.0))
    assert report.unchecked_links == ("rr1/hand_link",)
    assert "always inside the certified corridor\nnot checked, because they have no collision shape: rr1/hand_link" in (
        str(report)
    )
    with rp.Mirror(scene, plan) as mirror:
        assert mirror.report().unchecked_links == ()


def test_a_good_stream_stays_inside(scene: rp.Scene, plan: rp.Trajectory) -> None:
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run(messages(plan, start=1000.0))
    assert report
    assert report.messages == len(messages(plan))
    assert report.rate == pytest.approx(50.0, rel=0.01)
    assert report.delays[1] == pytest.approx(0.002)
    assert max(report.max_deviation.values()) < 1e-9
    assert mirror.state is not None
    assert mirror.state.proven_free
    assert mirror.events == []
    assert "always inside the certified corridor" in str(report)
    # MuJoCo is in the latest state, including fingers.
    names = [mirror.model.joint(i).name for i in range(mirror.model.njnt)]
    at = dict(zip(names, mirror.data.qpos.tolist(), strict=True))
    np.testing.assert_allclose([at[name] for name in ARM], mirror.state.q)


def test_leaving_the_corridor_is_an_alarm_and_coming_back_is_told(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream, told = messages(plan), []
    for i in range(20):
        k = len(stream) // 2 + i
        off = stream[k].positions + np.eye(6)[0] * 0.08 * math.sin(math.pi * i / 20)
        stream[k] = rp.StateMessage(stream[k].time, plan.joint_names, off, received=stream[k].received)
    with rp.Mirror(scene, plan, on_event=told.append) as mirror:
        report = mirror.run(stream)
    assert told == mirror.events
    assert [kind for kind in kinds(mirror) if kind != "contact"] == ["outside", "inside"]
    ((begin, end),) = report.outside
    assert begin == mirror.events[0].time
    assert stream[len(stream) // 2].time <= begin <= end <= stream[len(stream) // 2 + 19].time
    assert report.max_deviation["rr1/shoulder_joint"] == pytest.approx(0.08, abs=1e-6)
    assert not report
    assert "outside the certified corridor from" in str(report)


@pytest.mark.parametrize(("unit", "is_hinted"), [(math.degrees(1.0), True), (1.2, False)])
def test_positions_in_degrees_are_recognized(
    scene: rp.Scene, plan: rp.Trajectory, unit: float, is_hinted: bool
) -> None:
    with rp.Mirror(scene, plan) as mirror:
        mirror.run(rp.StateMessage(m.time, m.joint_names, unit * m.positions, m.received) for m in messages(plan))
    assert mirror.events[0].kind == "outside"
    assert ("are these degrees?" in mirror.events[0].message) == is_hinted


def test_nothing_is_proven_while_a_locked_joint_is_elsewhere(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = [
        rp.StateMessage(m.time, (*ARM, "rr1/finger_joint"), [*m.positions, 0.9 * (10 <= k < 20)], received=m.received)
        for k, m in enumerate(messages(plan))
    ]
    with rp.Mirror(scene, plan) as mirror:
        states = [mirror.receive(message) for message in stream]
        fingers = mirror.data.joint("rr1/finger_joint").qpos
        assert fingers == 0.0
        mirror.receive(rp.StateMessage(99.0, stream[15].joint_names, stream[15].positions))
        assert fingers == 0.9
        report = mirror.report()
    assert [k for k, state in enumerate(states) if state and not state.proven_free] == list(range(10, 20))
    assert states[10] is not None
    # With the finger that mimics it.
    assert states[10].moved == ("rr1/finger_joint", "rr1/opposite_finger_joint")
    assert kinds(mirror)[:2] == ["outside", "inside"]
    assert "it assumes rr1/finger_joint, rr1/opposite_finger_joint elsewhere" in mirror.events[0].message
    assert not report
    assert len(report.outside) == 2
    assert "always inside" not in str(report)


def test_a_small_deviation_of_a_locked_joint_uses_up_distances(scene: rp.Scene, plan: rp.Trajectory) -> None:
    """Such as that of a step counter: half a step."""
    uses = []
    with rp.Mirror(scene, plan) as mirror:
        for k, finger in enumerate((0.0, 5e-4)):
            state = mirror.receive(rp.StateMessage(0.01 * k, (*ARM, "rr1/finger_joint"), [*plan(0.0), finger]))
            assert state is not None
            assert state.corridor is not None
            assert state.proven_free
            assert state.moved == ()
            uses.append(state.corridor.use)
    assert 0.0 == uses[0] < uses[1] < 0.1
    assert mirror.corridor is not None
    tight = mirror.corridor.distances[0].min()
    assert mirror.corridor.position(plan(0.0), displacement=0.49 * tight).use < 1.0
    assert mirror.corridor.position(plan(0.0), displacement=10.0).use > 1.0
    with pytest.raises(rp.InputError, match="displacement is -1"):
        mirror.corridor.position(plan(0.0), displacement=-1.0)


def test_nothing_is_proven_while_an_arm_outside_the_plan_moves() -> None:
    """Into the planned arm here."""
    robot = rp.load_robot("rr1")
    scene = rp.Scene().with_arm("a", robot).with_arm("b", robot, [0.5, 0.0, 0.0])
    here, there = scene.joint_names(["a"]), scene.joint_names(["b"])
    plan = rp.Trajectory.rest(here, scene.configuration(["a"]), duration=1.0)
    checker, rng = rp.CollisionChecker(scene), np.random.default_rng(0)
    rows = rng.uniform(robot.limits.lower, robot.limits.upper, (500, 6))
    joint = (*here, *there)
    ours = plan(0.0)
    q = next(
        row
        for row in rows
        if any({c.a[:2], c.b[:2]} == {"a/", "b/"} and c.depth > 1e-3 for c in checker.contacts([*ours, *row]))
    )
    with rp.Mirror(scene, plan, start=0.0) as mirror:
        first = mirror.receive(rp.StateMessage(0.0, joint, [*ours, *scene.configuration(["b"])]))
        assert first is not None
        assert first.proven_free
        state = mirror.receive(rp.StateMessage(0.5, joint, [*ours, *q]))
    assert state is not None
    assert state.contacts
    assert set(state.moved) == set(there)
    assert not state.proven_free
    report = mirror.report()
    assert not report
    assert report.contacts == dict.fromkeys(state.contacts, 1)
    first_pair = " and ".join(state.contacts[0])
    assert f"{first_pair} touch in 1 message" in str(report)


def test_contacts_alone_make_a_report_false(scene: rp.Scene) -> None:
    checker, rng = rp.CollisionChecker(scene), np.random.default_rng(1)
    rows = rng.uniform(checker.limits.lower, checker.limits.upper, (100, 6))
    q = next(row for row in rows if any(contact.depth > 1e-3 for contact in checker.contacts(row)))
    with rp.Mirror(scene) as mirror:
        report = mirror.run([rp.StateMessage(0.0, ARM, scene.configuration())])
        assert report
        report = mirror.run([rp.StateMessage(9.0, ARM, q)])
    assert report.faults == {}
    assert not report
    assert "touch in 1 message" in str(report)


def test_two_links_that_touch_are_one_pair(scene: rp.Scene) -> None:
    """MuJoCo orders the shapes of a contact by their types, which differ within a link."""
    with rp.Mirror(scene) as mirror:
        state = mirror.receive(rp.StateMessage(0.0, ARM, [0.8, 0.17, -1.363, -1.655, 0.175, -0.276]))
    assert state is not None
    assert ("rr1/shoulder_link", "rr1/wrist_link") in state.contacts
    assert len({frozenset(pair) for pair in state.contacts}) == len(state.contacts)


def test_contacts_are_those_of_mujoco(scene: rp.Scene) -> None:
    with rp.Mirror(scene) as mirror:
        checker, rng = rp.CollisionChecker(scene), np.random.default_rng(1)
        limits, touching = checker.limits, 0
        for k in range(60):
            q = rng.uniform(limits.lower, limits.upper)
            state = mirror.receive(rp.StateMessage(float(k), ARM, q))
            assert state is not None
            deep = {tuple(sorted((c.a, c.b))) for c in checker.contacts(q) if c.depth > 1e-4}
            assert deep <= {tuple(sorted(pair)) for pair in state.contacts}
            assert not state.contacts or not checker.is_free(q)
            touching += bool(deep)
        assert 5 < touching < 60
        assert state.deviation is None
        assert state.corridor is None


def test_a_position_beyond_all_turns_is_a_fault_and_not_an_angle() -> None:
    # As a float, 1e300 rad is every angle at once: no corridor holds it.
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    plan = rp.Trajectory.rest(scene.joint_names(), scene.configuration(), duration=1.0)
    with rp.Mirror(scene, plan) as mirror:
        assert mirror.receive(rp.StateMessage(0.0, plan.joint_names, [1e300, 0.0])) is None
        assert mirror.corridor is not None
        with pytest.raises(rp.InputError, match="q holds 1e"):
            mirror.corridor.position([1e300, 0.0])
        # Nothing is there that the arm could touch, so that it is free everywhere.
        state = mirror.receive(rp.StateMessage(0.1, plan.joint_names, [2.0, 0.0]))
        assert state is not None
        assert state.proven_free
        assert state.corridor == (0.0, 0.0, ())
        assert mirror.report().faults == {"finite": 1}


def test_a_closed_mirror_receives_nothing(scene: rp.Scene, plan: rp.Trajectory, tmp_path: Path) -> None:
    first, second, *_ = messages(plan)
    mirror = rp.Mirror(scene, plan, record=tmp_path / "run.jsonl")
    mirror.receive(first)
    mirror.close()
    mirror.close()
    with pytest.raises(rp.InputError, match="the mirror is closed"):
        mirror.receive(second)
    assert len(list(rp.read_states(tmp_path / "run.jsonl"))) == 1


def test_faults_are_named_and_the_stream_goes_on(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan)
    q = stream[3].positions
    bad = {
        "order": rp.StateMessage(stream[0].time, plan.joint_names, q),
        "finite": rp.StateMessage(9.0, plan.joint_names, np.where(np.arange(6) == 2, np.nan, q)),
        "joints": rp.StateMessage(9.0, ("panda/joint1",), [0.0]),
        "silence": rp.StreamError("silence", "no message for 1 s"),
    }
    with rp.Mirror(scene, plan) as mirror:
        for good, item in zip(stream[:4], bad.values(), strict=True):
            assert mirror.receive(good) is not None
            assert mirror.receive(item) is None
        jump = rp.StateMessage(stream[6].time, plan.joint_names, q + 1.5)
        assert mirror.receive(jump) is not None
        report = mirror.report()
    assert report.faults == {"order": 1, "finite": 1, "joints": 1, "silence": 1, "jump": 1}
    said = [event.message for event in mirror.events if event.kind not in ("outside", "contact")]
    assert said[0] == "the message of 0.000 s came after that of 0.000 s"
    assert "'rr1/elbow_joint' is nan, not a finite position" in said[1]
    assert "unknown joint 'panda/joint1'" in said[2]
    assert "moved by 1.5" in said[4]


def restarted(stream: list[rp.StateMessage], k: int, gone: float, begin: float = 0.0) -> list[rp.StateMessage]:
    """The stream of a sender that counts its time anew from message k on, after a time without messages [s]."""
    first = stream[k].time - begin
    return [
        m if i < k else rp.StateMessage(m.time - first, m.joint_names, m.positions, received=m.received + gone)
        for i, m in enumerate(stream)
    ]


def test_a_restart_of_the_sender_is_named_and_its_clock_goes_on(
    scene: rp.Scene, plan: rp.Trajectory, tmp_path: Path
) -> None:
    stream = messages(plan, start=1000.0)
    k = len(stream) // 2
    with rp.Mirror(scene, plan, record=tmp_path / "run.jsonl") as mirror:
        report = mirror.run(restarted(stream, k, gone=0.0))
        states = mirror.state
    assert report.faults == {"order": 2, "restart": 1}
    assert report.messages == len(stream) - 2
    assert [event.kind for event in mirror.events] == ["order", "restart"]
    newest = stream[k - 1].time
    assert (
        mirror.events[1].message
        == f"the sender's clock went back from {newest:.3f} s to 0.000 s: it goes on from there"
    )
    # Its time and that of the plan go on, as if nothing had happened.
    assert states is not None
    assert states.time == pytest.approx(stream[-1].time, abs=0.003)
    assert max(report.max_deviation.values()) < 0.01
    assert not report.outside
    assert report.delays[1] < 0.005
    assert not report
    # The recording has the sender's own times, and is mirrored in the same way.
    with rp.Mirror(scene, plan) as again:
        assert str(again.run(rp.read_states(tmp_path / "run.jsonl"))) == str(report)
        assert [str(event) for event in again.events] == [str(event) for event in mirror.events]


@pytest.mark.parametrize("both", [False, True])
def test_delays_go_on_where_the_clock_of_the_receiver_was_set_back(
    scene: rp.Scene, plan: rp.Trajectory, both: bool
) -> None:
    """Recordings before and after a restart of the receiving machine, joined, or its wall clock set back."""
    stream = messages(plan, start=1000.0)
    k = len(stream) // 2
    later = restarted(stream, k, gone=0.0)[k:] if both else stream[k:]
    later = [rp.StateMessage(m.time, m.joint_names, m.positions, received=m.received - 1e5) for m in later]
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run([*stream[:k], *later])
    assert report.faults == ({"order": 2, "restart": 1} if both else {})
    assert report.rate == pytest.approx(50.0, rel=0.1)
    assert report.delays[1] < 0.05


def test_time_without_messages_counts_in_a_restart(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan)
    k = len(stream) // 2
    with rp.Mirror(scene, plan) as mirror:
        mirror.run(restarted(stream, k, gone=3.0, begin=0.05))
        assert mirror.state is not None
        assert mirror.state.time == pytest.approx(stream[-1].time + 3.0, abs=0.003)
        # A second restart, without times of arrival: a file that is read at once.
        last = mirror.state.time
        for t in (0.0, 0.02, 0.04, 0.06):
            mirror.receive(rp.StateMessage(t, plan.joint_names, stream[-1].positions))
        assert mirror.state.time > last
        assert mirror.report().faults == {"order": 4, "restart": 2}


def test_messages_of_several_senders_are_merged(scene: rp.Scene, plan: rp.Trajectory) -> None:
    finger = f"rr1/{next(iter(scene.arms['rr1'].robot.locked_joints))}"
    closed = scene.arms["rr1"].robot.locked_joints[finger.removeprefix("rr1/")]
    stream = []
    for k, message in enumerate(messages(plan)):
        first = rp.StateMessage(message.time, plan.joint_names[:4], message.positions[:4], message.received)
        # The other sender measures earlier; its messages arrive later.
        t = message.time - 0.005
        other = rp.StateMessage(t, plan.joint_names[4:], plan(t)[4:], message.received + 0.003)
        stream += [first, other] if k % 2 == 0 else [first]
        stream.append(rp.StateMessage(t - 0.004, (finger,), [closed], message.received + 0.004))
    with rp.Mirror(scene, plan, start=0.0) as mirror:
        states = [state for state in map(mirror.receive, stream) if state is not None]
        report = mirror.report()
    assert mirror.events == []
    assert report
    assert report.messages == len(states) == sum(k % 2 == 0 for k in range(len(messages(plan))))
    assert max(report.max_deviation.values()) < 1e-9
    assert report.unmeasured == ()


@pytest.mark.parametrize("ahead", [1e6, -1e6])
def test_senders_may_have_different_clocks(ahead: float, scene: rp.Scene, plan: rp.Trajectory) -> None:
    """One that counts from its start, and one that counts from 1970."""
    names, stream = plan.joint_names, []
    for m in messages(plan):
        stream.append(rp.StateMessage(m.time, names[:4], m.positions[:4], m.received))
        stream.append(rp.StateMessage(m.time + ahead, names[4:], m.positions[4:], m.received))
    with rp.Mirror(scene, plan, start=0.0) as mirror:
        report = mirror.run(stream)
    assert [event.kind for event in mirror.events] == ["clock"]
    assert "a further sender's clock" in mirror.events[0].message
    assert report.messages == len(stream) // 2
    assert max(report.max_deviation.values()) < 1e-8
    assert not report.outside


def test_a_joint_without_messages_is_named(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan)
    partial = [rp.StateMessage(m.time, m.joint_names[:5], m.positions[:5], m.received) for m in stream]
    with rp.Mirror(scene, plan) as mirror:
        assert all(mirror.receive(message) is None for message in partial[:10])
        assert not mirror.report()
        assert "nothing was compared with the plan: no message had rr1/hand_joint" in str(mirror.report())
        mirror.run(partial[10:])
        assert "no joint 'rr1/hand_joint' for 1." in mirror.events[0].message
    with rp.Mirror(scene, plan) as mirror:  # it stops during the motion
        assert not mirror.run([*stream[:20], *partial[20:]])
        assert {event.kind for event in mirror.events} == {"joints"}


def test_joints_without_the_name_of_their_arm_are_those_of_the_only_arm_that_has_them() -> None:
    two = rp.Scene({"a": rp.Arm(rp.load_robot("rr1")), "b": rp.Arm(rp.load_robot("planar2r"), pose((2.0, 0.0, 0.0)))})
    q = two.configuration() + 0.1
    for names in ([n.split("/")[1] for n in two.joint_names()], [n.replace("/", "_") for n in two.joint_names()]):
        with rp.Mirror(two) as mirror:
            state = mirror.receive(rp.StateMessage(0.0, names, q))
        assert state is not None
        np.testing.assert_array_equal(state.q, q)
        assert mirror.events == []
    same = rp.Scene({"a": rp.Arm(rp.load_robot("planar2r")), "b": two.arms["b"]})
    with rp.Mirror(same) as mirror:
        assert mirror.receive(rp.StateMessage(0.0, ["joint1"], [0.1])) is None
    assert mirror.events[0].message.startswith("several arms have a joint 'joint1' in the message of 0.000 s: a/joint1")


@pytest.mark.parametrize(("q", "moved"), [((2.0, 0.1), "'arm/joint1' moved by 2 rad"), ((0.0, 0.7), "by 0.6 m")])
def test_a_jump_has_the_unit_of_the_joint(q: tuple[float, float], moved: str) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RP"))
    with rp.Mirror(scene) as mirror:
        mirror.receive(rp.StateMessage(0.0, scene.joint_names(), [0.0, 0.1]))
        mirror.receive(rp.StateMessage(0.01, scene.joint_names(), q))
    (jump,) = (event.message for event in mirror.events if event.kind == "jump")
    assert f"{moved} in 0.01 s" in jump


def test_joints_that_the_scene_does_not_have_are_faults_and_the_others_are_read(scene: rp.Scene) -> None:
    q = scene.configuration() + 0.1
    with rp.Mirror(scene) as mirror:
        state = mirror.receive(rp.StateMessage(0.0, [*ARM, "wheel"], [*q, math.nan]))
        report = mirror.report()
    assert state is not None
    np.testing.assert_array_equal(state.q, q)
    assert (report.messages, dict(report.faults)) == (1, {"joints": 1})


def test_an_endless_joint_may_be_reported_within_a_turn() -> None:
    endless, limited = (rp.planar_arm("RR", limits=[limits, None]) for limits in (None, [-6.0, 6.0]))
    for robot, faults in ((endless, {}), (limited, {"jump": 1})):
        scene = rp.Scene().with_arm("arm", robot, q=[3.0, 0.5])
        motion = rp.retime(rp.Path(scene.joint_names(), [[3.0, 0.5], [3.4, 0.5]]), scene)
        with rp.Mirror(scene, motion) as mirror:
            for time in np.linspace(0.0, motion.duration, 20).tolist():
                angles = motion(time)
                mirror.receive(rp.StateMessage(time, motion.joint_names, np.arctan2(np.sin(angles), np.cos(angles))))
            report = mirror.report()
        assert dict(report.faults) == faults
        assert report.outside == ()


def test_a_clock_that_jumps_ahead_is_a_fault_and_goes_on(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan)
    k = len(stream) // 2
    ahead = [replace(m, time=m.time + 1000.0 * (i >= k)) for i, m in enumerate(stream)]
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run(ahead)
        assert mirror.state is not None
        assert mirror.state.time == pytest.approx(stream[-1].time, abs=0.01)
    assert report.faults == {"clock": 1}
    assert not report
    assert max(report.max_deviation.values()) < 0.01
    said = f"went from {stream[k - 1].time:.3f} s to {stream[k].time + 1000.0:.3f} s in 0.02"
    assert said in mirror.events[0].message
    # Messages that arrive together after 5 s are no jump.
    held = [replace(m, received=m.received + 5.0 if i < k else stream[k].received + 5.0) for i, m in enumerate(stream)]
    with rp.Mirror(scene, plan) as mirror:
        assert mirror.run([*stream[:5], *held[5:]])


def test_rates_are_those_of_the_sender_where_arrivals_are_unknown(scene: rp.Scene, plan: rp.Trajectory) -> None:
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run([replace(message, received=None) for message in messages(plan)])
    assert report.rate == pytest.approx(50.0)
    assert report.delays == (0.0, 0.0)


def test_intervals_without_messages_in_a_file_are_faults(plan: rp.Trajectory, tmp_path: Path) -> None:
    lines = [{"time": t, "name": ["a"], "position": [0.0]} for t in (0.0, 0.5, 3.0)]
    lines.append(lines[-1] | {"time": 1000.0, "received": 3.5})
    (tmp_path / "s.jsonl").write_text("\n".join(map(json.dumps, lines)))
    items = list(rp.read_states(tmp_path / "s.jsonl"))
    assert [type(item) is rp.StreamError for item in items] == [False, False, True, False, False]
    assert items[2].message == "no message for 2.5 s, from 0.500 s to 3.000 s"
    assert len(list(rp.read_states(tmp_path / "s.jsonl", silence=3.0))) == 4


def test_a_clock_that_jumps_ahead_right_after_a_restart_goes_on(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan, start=1000.0)
    sent = restarted(stream, 20, gone=0.0)
    sent[22:] = [replace(m, time=m.time + 900.0) for m in sent[22:]]
    with rp.Mirror(scene, plan) as mirror:
        mirror.run(sent)
        assert mirror.state is not None
        assert mirror.state.time == pytest.approx(stream[-1].time, abs=0.003)


def test_late_and_repeated_messages_are_no_restart(scene: rp.Scene, plan: rp.Trajectory) -> None:
    stream = messages(plan)
    with rp.Mirror(scene, plan) as mirror:
        for k in range(20, 40, 4):
            mirror.receive(stream[k])
            for late in (k - 3, k - 2, k - 2, k - 1):  # two in a row, and two more
                assert mirror.receive(stream[late]) is None
        for _ in range(10):  # a clock that stands still
            assert mirror.receive(stream[36]) is None
        assert mirror.report().faults == {"order": 30}
        assert mirror.receive(stream[37]) is not None


def test_a_recording_reads_back_as_the_same_stream(scene: rp.Scene, plan: rp.Trajectory, tmp_path: Path) -> None:
    stream = messages(plan)
    with rp.Mirror(scene, plan, record=tmp_path / "run.jsonl") as mirror:
        first = mirror.run(stream)
    again = list(rp.read_states(tmp_path / "run.jsonl"))
    assert all(isinstance(item, rp.StateMessage) for item in again)
    for before, after in zip(stream, again, strict=True):
        assert isinstance(after, rp.StateMessage)
        assert (after.time, after.joint_names, after.received) == (before.time, before.joint_names, before.received)
        np.testing.assert_array_equal(after.positions, before.positions)
    with rp.Mirror(scene, plan) as other:
        assert str(other.run(again)) == str(first)


def test_a_broadcaster_is_mirrored_over_a_socket(scene: rp.Scene, plan: rp.Trajectory) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    stream = rp.read_states(f"udp://127.0.0.1:{port}", silence=0.2)
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(plan.joint_names)
    sim.activate(follow)
    follow.send(plan)

    def send() -> None:
        with rp.JointStateBroadcaster(plan.joint_names, ("127.0.0.1", port), rate=100.0) as broadcaster:
            broadcaster.attach(sim)
            sim.run(duration=0.5)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b'{"time": 1.0, "name"', ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    with stream, rp.Mirror(scene, plan, start=0.0) as mirror:
        thread.start()
        for item in stream:
            mirror.receive(item)
            # On a busy machine there may be silence before, too.
            if isinstance(item, rp.StreamError) and item.fault == "silence" and not thread.is_alive():
                break
        report = mirror.report()
    assert report.messages == 50
    assert report.faults["format"] == 1
    assert set(report.faults) == {"format", "silence"}
    assert max(report.max_deviation.values()) < 1e-3
    assert not report.outside


def test_a_stream_that_is_left_early_is_closed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for _ in range(2):  # the port is free again
        with rp.read_states(f"udp://127.0.0.1:{port}", silence=0.01) as stream:
            assert isinstance(next(stream), rp.StreamError)
        assert list(stream) == []
    with rp.read_states(f"udp://127.0.0.1:{port}"):
        pass


def test_messages_wait_while_their_receiver_is_busy() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind(("127.0.0.1", 0))
        port = sender.getsockname()[1]
    with (
        rp.read_states(f"udp://127.0.0.1:{port}") as stream,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        for number in range(400):
            sender.sendto(b'{"time": %d, "name": ["a"], "position": [0.0]}' % number, ("127.0.0.1", port))
        for number in range(400):
            message = next(stream)
            assert isinstance(message, rp.StateMessage)
            assert message.time == number


def test_ctrl_c_does_not_end_a_stream_that_waits_for_a_message(scene: rp.Scene) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    interrupting = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    line = json.dumps({"time": 0.0, "name": scene.joint_names(), "position": scene.configuration().tolist()})
    with (
        rp.read_states(f"udp://127.0.0.1:{port}", silence=0.2) as stream,
        rp.Mirror(scene, on_event=lambda event: interrupting.ident or interrupting.start()) as mirror,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        assert mirror.run(stream).messages == 0
        sender.sendto(line.encode(), ("127.0.0.1", port))
        assert next(item for item in stream if isinstance(item, rp.StateMessage)).time == 0.0


def test_another_thread_ends_a_stream_that_waits_for_a_message() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    stream = rp.read_states(f"udp://127.0.0.1:{port}", silence=1e30)
    closing = threading.Timer(0.05, stream.close)
    closing.start()
    assert list(stream) == []
    closing.join()


def test_a_port_is_free_when_another_thread_has_closed_its_stream() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for _ in range(3):
        stream = rp.read_states(f"udp://127.0.0.1:{port}", silence=1e30)
        items: list[object] = []
        waiting = threading.Thread(target=items.extend, args=(stream,))
        waiting.start()
        time.sleep(0.02)  # until the thread waits for a message
        stream.close()
        rp.read_states(f"udp://127.0.0.1:{port}").close()
        waiting.join()
        assert items == []


def test_a_forked_process_that_closes_a_stream_does_not_end_it() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with rp.read_states(f"udp://127.0.0.1:{port}", silence=1e30) as stream:
        items: list[object] = []
        waiting = threading.Thread(target=lambda: items.append(next(stream)))
        waiting.start()
        time.sleep(0.02)  # until the thread waits for a message
        child = os.fork()
        if child == 0:
            stream.close()
            os._exit(0)
        os.waitpid(child, 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b'{"time": 1, "name": ["a"], "position": [0.0]}', ("127.0.0.1", port))
        waiting.join()
        assert [type(item) for item in items] == [rp.StateMessage]


def test_a_first_message_with_an_absurd_time_does_not_stop_the_clock(scene: rp.Scene, plan: rp.Trajectory) -> None:
    times = [1e300, *(100.0 + 0.01 * np.arange(20))]
    position = plan(0.0).tolist()
    lines = [json.dumps({"time": time, "name": plan.joint_names, "position": position}) for time in times]
    with rp.Mirror(scene, plan) as mirror:
        report = mirror.run(map(parse_state, lines))
    assert (report.messages, dict(report.faults)) == (20, {"format": 1})


def test_a_bag_is_a_stream(plan: rp.Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    bag = rp.save_rosbag(tmp_path / "bag", plan)
    stream = list(rp.read_states(bag))
    assert len(stream) > 20
    assert all(isinstance(item, rp.StateMessage) for item in stream)
    # Names without the arm, as ROS has them.
    with rp.Mirror(rp.load_scene("rr1_table"), plan) as mirror:
        assert mirror.run(stream)
    with pytest.raises(rp.UnknownNameError, match="unknown topic '/other'"):
        rp.read_states(bag, topic="/other")  # before any message is read
    (tmp_path / "empty").mkdir()
    with pytest.raises(rp.FormatError, match=r"there is no metadata\.yaml"):
        rp.read_states(tmp_path / "empty")


def test_a_bag_of_two_arms_is_a_stream(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    robot = rp.load_robot("planar2r")
    two = rp.Scene({"left": rp.Arm(robot), "right": rp.Arm(robot, pose((5.0, 0.0, 0.0)))})
    q = two.configuration()
    motion = rp.retime(rp.Path(two.joint_names(), [q, q + 0.2]), two)
    with rp.Mirror(two, motion) as mirror:
        report = mirror.run(rp.read_states(rp.save_rosbag(tmp_path / "bag", motion)))
    assert report
    assert max(report.max_deviation.values()) < 1e-6


def test_messages_of_a_bag_without_stamps_have_the_times_at_which_they_were_recorded(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind, none = get_typestore(Stores.ROS2_JAZZY), "sensor_msgs/msg/JointState", np.zeros(0)
    for name, stamps, times in (("none", (0, 0, 0), (7.0, 8.0, 9.0)), ("simulated", (0, 1, 2), (0.0, 1.0, 2.0))):
        with Writer(tmp_path / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connection = writer.add_connection("/joint_states", kind, typestore=store)
            for k, stamp in enumerate(stamps):
                header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](stamp, 0), "")
                message = store.types[kind](header, ["joint1"], np.zeros(1), none, none)
                writer.write(connection, (7 + k) * 1_000_000_000, store.serialize_cdr(message, kind))
        found = [item for item in rp.read_states(tmp_path / name, silence=5.0) if isinstance(item, rp.StateMessage)]
        assert tuple(item.time for item in found) == times


def test_a_message_of_a_bag_without_positions_does_not_end_the_stream(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind, none = get_typestore(Stores.ROS2_JAZZY), "sensor_msgs/msg/JointState", np.zeros(0)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for k, positions in enumerate((np.zeros(1), none, np.ones(1))):
            header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](k, 0), "")
            message = store.types[kind](header, ["joint1"], positions, np.zeros(1), none)
            writer.write(connection, k, store.serialize_cdr(message, kind))
    first, fault, last = rp.read_states(tmp_path / "bag", silence=5.0)
    assert isinstance(fault, rp.StreamError)
    assert fault.fault == "format"
    assert "the message of 1.000 s is not a joint state: positions has shape (0,)" in fault.message
    assert (first.time, last.time) == (0.0, 2.0)
    assert last.positions.tolist() == [1.0]


def test_damaged_lines_are_named_and_others_are_read(tmp_path: Path) -> None:
    good = json.dumps({"time": 1.0, "name": ["a", "b"], "position": [0.0, 1.0]})
    lines = [good, good[:20], "[1, 2]", '{"time": 1}', good.replace("1.0]", "1.0, 2.0]"), good.replace('"b"', '"a"')]
    (tmp_path / "s.jsonl").write_text("\n".join([*lines, "", good.replace("0.0", "NaN")]))
    found = list(rp.read_states(tmp_path / "s.jsonl"))
    assert [isinstance(item, rp.StateMessage) for item in found] == [True, False, False, False, False, False, True]
    errors = [item.message for item in found if isinstance(item, rp.StreamError)]
    assert all("is not a joint state" in message and len(message) < 400 for message in errors)
    assert "no 'name'" in errors[2]
    assert "expected (2,)" in errors[3]


def test_bytes_that_are_not_text_damage_their_line_only(tmp_path: Path) -> None:
    good = json.dumps({"time": 1.0, "name": ["a"], "position": [0.0]}).encode()
    (tmp_path / "s.jsonl").write_bytes(b"\n".join([good, good[:30] + b"\xff\xfe", good]))
    found = list(rp.read_states(tmp_path / "s.jsonl"))
    assert [isinstance(item, rp.StateMessage) for item in found] == [True, False, True]


def test_sources_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    for source, words in {
        "tcp://127.0.0.1:9000": "expected udp://HOST:PORT",
        "udp://127.0.0.1:no": "expected udp://HOST:PORT",
        "udp://192.0.2.1:9000": "cannot listen to",
        "udp://a\0b:9000": "cannot listen to 'udp://a",
        str(tmp_path / "none.jsonl"): "there is no such file",
    }.items():
        with pytest.raises(rp.InputError, match=words):
            rp.read_states(source)
    (tmp_path / "run.jsonl").touch()
    for source in ("udp://127.0.0.1:9000", tmp_path / "run.jsonl"):
        with pytest.raises(rp.InputError, match=f"topic is '/states', but {source} is not a bag"):
            rp.read_states(source, topic="/states")
    with pytest.raises(rp.InputError, match="no arm to mirror"):
        rp.Mirror(rp.Scene())


def test_the_page_gets_states_and_the_panel(scene: rp.Scene, plan: rp.Trajectory) -> None:
    with rp.Mirror(scene, plan) as mirror:
        viewer = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        report = mirror.run(messages(plan)[:20])
        assert report.messages == 20
        assert not viewer.closed
        with pytest.raises(rp.UnknownNameError, match="unknown panel 'other'"):
            viewer.update_panel("other", {})
        with pytest.raises(rp.InputError, match="cannot hold this data"):
            viewer.update_panel("mirror", {"state": math.nan})
    assert viewer.closed


def test_samples_of_a_trajectory_are_not_read_as_joint_states(tmp_path: Path) -> None:
    file = rp.save_csv(tmp_path / "run.csv", rp.Trajectory.rest(("arm/joint1",), [0.5], duration=1.0))
    with pytest.raises(rp.InputError, match=r"run\.csv is a CSV file, expected JSON lines"):
        rp.read_states(file)
