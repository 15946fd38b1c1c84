"""Proofs that arms touch nothing: sound, used, and without effect on the results of a simulation."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.playback.simulation import tiled_model
from rr1plan.playback.simulation.arm_dynamics import ArmDynamics
from rr1plan.playback.simulation.contact_proof import ContactProof
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.playback.simulation.stepped_models import Tile
from rr1plan.robot import Geometry, Inertial, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.transforms import pose

FLOOR = rp.HalfSpace((0.0, 0.0, 1.0), -0.02)


def ring(count: int, radius: float) -> rp.Scene:
    """RR1 around a post, close enough to touch each other, the post and the floor."""
    robot = rp.load_robot("rr1")
    turns = 2.0 * np.pi * np.arange(count) / count
    places = (pose([radius * np.cos(t), radius * np.sin(t), 0.0], rpy=[0.0, 0.0, t]) for t in turns)
    arms = {f"a{i}": rp.Arm(robot, place) for i, place in enumerate(places)}
    return rp.Scene(arms=arms).with_obstacle("floor", FLOOR).with_obstacle("post", rp.Cylinder(0.05, 1.2))


def wander(scene: rp.Scene, names: tuple[str, ...], seed: int, seconds: float) -> rp.Trajectory:
    """A motion through random configurations, with a stop at each."""
    rng, limits = np.random.default_rng(seed), scene.limits()
    home = scene.configuration()
    points = home + np.array([[0.0], [0.6], [0.4], [0.8]]) * (
        rng.uniform(limits.lower, limits.upper, (4, len(home))) - home
    )
    own = np.zeros((len(points), len(names)))
    known = scene.joint_names()
    for column, name in enumerate(names):
        own[:, column] = points[:, known.index(name)] if name in known else [0.0, *rng.uniform(0.0, 0.8, 3)]
    rest = np.zeros_like(own)
    return rp.Trajectory.from_samples(names, seconds * np.arange(len(own)), own, rest, rest)


def search_always(sim: rp.Simulation) -> None:
    """Let MuJoCo search for contacts in every state."""
    for tile in sim.tiles:
        tile.proof = None
        tile.refresh()


class Run:
    """Results of a simulation of randomly moving arms and their grippers."""

    def __init__(self, scene: rp.Scene, seed: int, *, proofs: bool, push: float = 0.0) -> None:
        sim = rp.Simulation(scene)
        (tile,) = sim.tiles
        self.proof = tile.proof
        if not proofs:
            search_always(sim)
        if push:
            _ = sim.data  # from now on MuJoCo takes all steps
        names = (*scene.joint_names(), *(f"{arm}/finger_joint" for arm in scene.arms))
        follow = rp.JointTrajectoryController(names, goal_tolerance=np.inf)
        sim.activate(follow)
        follow.send(wander(scene, names, seed, 0.8))
        self.states: list[bytes] = []

        def note(sim: rp.Simulation) -> None:
            self.states.append(sim.positions.tobytes() + sim.velocities.tobytes() + sim.efforts.tobytes())
            if push:
                tile.data.qfrc_applied[1] = push if sim.steps % 200 < 20 else 0.0

        sim.on_step(note)
        sim.step(1000)
        self.contacts, self.deepest = sim.contacts, sim.max_penetration


@pytest.mark.parametrize(("seed", "push"), [(1, 0.0), (2, 0.0), (3, 25.0)])
def test_runs_with_and_without_proofs_are_equal_to_the_byte(seed: int, push: float) -> None:
    scene = ring(4, 0.58)
    fast, slow = (Run(scene, seed, proofs=proofs, push=push) for proofs in (True, False))
    assert fast.states == slow.states
    assert fast.contacts == slow.contacts
    assert fast.deepest == slow.deepest
    assert fast.contacts  # some states have contacts,
    assert fast.proof is not None
    assert 200 < fast.proof.proven < 1000  # and many are proven to have none


def held_and_tilted() -> rp.Scene:
    """The ring with one arm that holds a rod, one that holds a weight, and one that hangs a little askew."""
    scene = ring(4, 0.58)
    arm = scene.arms["a2"]
    scene = scene.with_arm("a2", arm.robot, arm.base @ pose(rpy=[0.1, -0.2, 0.0]))
    for name, owner, mass in (("rod", "a0", None), ("weight", "a1", 0.4)):
        above = scene.arms[owner].base[:3, 3] + [0.0, 0.0, 1.3]
        scene = scene.with_obstacle(name, rp.Capsule(0.01, 0.2), above, mass=mass).attach(name, owner)
    return scene


@pytest.mark.parametrize("threads", [2, 3])
def test_arms_on_threads_move_as_on_one(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    monkeypatch.setattr(tiled_model, "_SHARED", 1)
    workers = set()
    take_steps = ArmDynamics.take_steps

    def noted(arms: ArmDynamics, worker: int, desired: Array, states: Array) -> None:
        workers.add(worker)
        take_steps(arms, worker, desired, states)

    monkeypatch.setattr(ArmDynamics, "take_steps", noted)
    scene = held_and_tilted()
    shared = rp.Simulation(scene, threads=threads)
    whole = rp.Simulation(scene)
    search_always(whole)
    (tile,) = shared.tiles
    taken = 0
    runs: list[tuple[rp.Simulation, list[bytes]]] = [(shared, []), (whole, [])]
    for sim, states in runs:
        follow = rp.JointTrajectoryController(scene.joint_names(), goal_tolerance=np.inf)
        sim.activate(follow)
        for repeat in range(2):
            follow.send(wander(scene, scene.joint_names(), 1, 0.4))
            for _ in range(280):
                taken += sim is shared and tile.proven
                sim.step()
                states.append(sim.positions.tobytes() + sim.velocities.tobytes() + sim.efforts.tobytes())
            if repeat == 0:
                sim.reset()
    assert runs[0][1] == runs[1][1]
    assert shared.contacts == whole.contacts != ()
    assert 40 < taken < 500
    assert workers == set(range(threads))
    # All values of MuJoCo's data belong to the last step.
    for name in ("time", "qpos", "qvel", "qacc", "ctrl", "actuator_force", "qfrc_bias", "xpos", "geom_xpos", "ncon"):
        np.testing.assert_array_equal(getattr(shared.data, name), getattr(whole.data, name))
    assert tile.arms is None


class Steps:
    """Number of steps that simulations take at once from proven states."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.counts: list[int] = []
        advance = Tile.advance

        def counted(tile: Tile, worker: int, desired: Array, states: Array) -> None:
            if tile.proven:
                self.counts.append(len(desired))
            advance(tile, worker, desired, states)

        monkeypatch.setattr(Tile, "advance", counted)


def end_of(sim: rp.Simulation, executions: list[rp.Execution]) -> list[object]:
    """All observable results of a run."""
    outcomes = [(e.status, e.message, e.ended, e.max_error.tobytes()) for e in executions]
    rows = (sim.positions, sim.velocities, sim.efforts, sim.set_points)
    return [sim.steps, sim.contacts, sim.max_penetration, *(row.tobytes() for row in rows), *outcomes]


def arm_follows(sim: rp.Simulation, arm: str, seed: int, seconds: float, path: float = np.inf) -> rp.Execution:
    """Send an arm and its gripper through random configurations, by a controller for this arm."""
    names = (f"{arm}/finger_joint", *sim.scene.joint_names([arm]))
    follow = rp.JointTrajectoryController(names, goal_tolerance=1e-4, goal_time=0.05, path_tolerance=path)
    sim.activate(follow)
    return follow.send(wander(sim.scene, names[::-1], seed, seconds))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("radius", [0.58, 1.2])
def test_several_steps_at_once_end_like_single_steps(
    monkeypatch: pytest.MonkeyPatch, radius: float, threads: int
) -> None:
    monkeypatch.setattr(tiled_model, "_SHARED", 1)
    steps = Steps(monkeypatch)
    fast = rp.Simulation(ring(4, radius), threads=threads)
    slow = rp.Simulation(fast.scene)
    search_always(slow)
    slow.on_step(lambda _: None)  # single steps
    ends = []
    for sim in (fast, slow):
        executions = [arm_follows(sim, f"a{i}", 10 + i, 0.2 + 0.1 * i) for i in range(4)]
        seen = []
        for count in (1, 150, 7, 250, 300):
            sim.step(count)
            seen.append(end_of(sim, executions))
        touched = bool(sim.contacts)
        executions.append(arm_follows_on(sim))
        sim.step(200)
        sim.reset()
        sim.step(40)
        ends.append([*seen, end_of(sim, executions)])
        if sim is fast:
            assert max(steps.counts) == 32
            assert np.mean(steps.counts) > 4
    assert ends[0] == ends[1]
    assert touched  # on the way
    np.testing.assert_array_equal(fast.data.qpos, slow.data.qpos)
    assert fast.data.time == slow.data.time


@pytest.mark.parametrize("count", [1, 2, 4])
def test_several_steps_without_a_proof_end_like_single_steps(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    lengths: list[int] = []
    take_steps = ArmDynamics.take_steps

    def noted(arms: ArmDynamics, worker: int, desired: Array, states: Array) -> None:
        lengths.append(len(desired))
        take_steps(arms, worker, desired, states)

    monkeypatch.setattr(ArmDynamics, "take_steps", noted)
    fast, slow, alone = (rp.Simulation(ring(count, 0.58)) for _ in range(3))
    search_always(fast)
    slow.on_step(lambda _: None)  # single steps
    _ = alone.model  # MuJoCo's steps
    ends, contacts = [], []
    for sim in (fast, slow, alone):
        executions = [arm_follows(sim, f"a{i}", 10 + i, 0.2 + 0.1 * i) for i in range(count)]
        for steps in (1, 150, 7, 250, 300):
            sim.step(steps)
            ends.append(end_of(sim, executions))
        contacts.append(sim.contacts)
        if sim is fast:
            assert max(lengths) == 32
    assert ends[:5] == ends[5:10]
    assert contacts[0]
    first, reference = contacts[0][0], contacts[2][0]
    assert (first.pair, first.first) == (reference.pair, reference.first)


def test_steps_beyond_what_kernels_compute_are_those_of_mujoco(rr1: Robot) -> None:
    sims = [rp.Simulation(rp.Scene(arms={"a": rp.Arm(rr1)})) for _ in range(2)]
    search_always(sims[1])
    _ = sims[1].data
    names = ["a/shoulder_joint"]
    for sim in sims:
        sim.place(names, [999.9], [20.0])
        sim.activate(Kicked(tuple(names), 0.0))
    free = []
    for _ in range(10):
        for sim in sims:
            sim.step(1)
        free.append((sims[0].positions[0] <= 1e3, sims[0].tiles[0].free_arms))
        np.testing.assert_allclose(sims[0].positions, sims[1].positions, rtol=1e-12, atol=1e-12)
    assert set(free) == {(True, 1), (False, 0)}


def arm_follows_on(sim: rp.Simulation) -> rp.Execution:
    """Send the first arm home, whose last motion has ended."""
    follow = sim.controllers[0]
    assert isinstance(follow, rp.JointTrajectoryController)
    ends = np.array([sim.set_points[[sim.joint_names.index(name) for name in follow.joint_names]], np.zeros(7)])
    rest = np.zeros_like(ends)
    return follow.send(rp.Trajectory.from_samples(follow.joint_names, np.array([0.0, 0.5]), ends, rest, rest))


def test_what_needs_the_state_takes_single_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    class Late(rp.JointTrajectoryController):
        """Says that it follows a trajectory, and holds where it is after a while."""

        def update(self, state: rp.JointState) -> rp.SetPoint:
            return super().update(state) if state.time < 0.1 else rp.SetPoint(state.positions)

    steps = Steps(monkeypatch)
    scene = ring(4, 1.2)
    names = scene.joint_names(["a0"])
    for follow, alone in (
        (Late(names), True),
        (rp.JointTrajectoryController(names, path_tolerance=0.1), True),
        (rp.JointTrajectoryController(names), False),
    ):
        sim = rp.Simulation(scene)
        sim.activate(follow)
        execution = follow.send(wander(scene, names, 5, 0.4))
        steps.counts.clear()
        sim.step(100)
        assert (max(steps.counts) == 1) is alone
        assert execution.max_error.max() > 0.0
        if isinstance(follow, Late):
            assert follow.preview(np.zeros(3)) is None
            assert np.abs(sim.set_points - sim.positions)[:6].max() < 0.05
            assert np.abs(follow._path(0.2) - sim.positions[:6]).max() > 0.05
        # A callback sees each step, and real time is kept in each.
        times: list[float] = []
        stop = sim.on_step(lambda sim: times.append(sim.time))  # noqa: B023
        sim.step(5)
        stop()
        assert np.allclose(np.diff(times), sim.dt)


class Foreseen(rp.Controller):
    """Previews a sway, or another motion instead."""

    def __init__(self, names: tuple[str, ...], wrong: object = None) -> None:
        super().__init__(names)
        self.wrong, self.seen = wrong, 0

    def update(self, state: rp.JointState) -> rp.SetPoint:
        self.seen += 1
        return self.at(np.array(state.time))

    def at(self, times: Array) -> rp.SetPoint:
        sway = np.multiply.outer(np.sin(3.0 * times), np.full(len(self.joint_names), 0.1))
        return rp.SetPoint(sway, efforts=np.full_like(sway, 0.01))

    def preview(self, times: Array) -> rp.SetPoint | None:
        if isinstance(self.wrong, Exception):
            raise self.wrong
        if self.wrong is not None:
            return self.wrong  # type: ignore[return-value]
        return self.at(times[:9])

    def passed(self, times: Array, positions: Array) -> None:
        assert positions.shape == (len(times), len(self.joint_names))
        self.seen += len(times)


def test_own_controllers_may_preview(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Steps(monkeypatch)
    scene = ring(4, 1.2)
    names = (*scene.joint_names(), "a1/finger_joint")
    ends = []
    for single in (False, True):
        sim, sway = rp.Simulation(scene), Foreseen(names)
        sim.activate(sway)
        if single:
            sim.on_step(lambda _: None)
        sim.step(100)
        assert sway.seen == 100
        ends.append(end_of(sim, []))
    assert ends[0] == ends[1]
    assert max(steps.counts) == 9


def test_a_controller_that_fails_after_previewed_steps_leaves_a_true_clock() -> None:
    class Fails(Foreseen):
        def passed(self, times: np.ndarray, positions: np.ndarray) -> None:
            raise ValueError("too late")

    scene = ring(4, 1.2)
    sim, other = rp.Simulation(scene), rp.Simulation(scene)
    sim.activate(Fails(scene.joint_names(["a0"])))
    other.activate(Foreseen(scene.joint_names(["a0"])))
    with pytest.raises(rp.ControllerError, match=r"Fails raised ValueError at .*: too late"):
        sim.step(10)
    assert sim.steps > 0
    other.step(sim.steps)
    np.testing.assert_array_equal(sim.positions, other.positions)
    np.testing.assert_array_equal(sim.set_points, other.set_points)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (ValueError("no"), "Foreseen raised ValueError at 0.000 s: no"),
        (3, "Foreseen returned a int at 0.000 s, expected a SetPoint"),
        (rp.SetPoint(np.zeros((2, 5))), "positions of shape"),
        (rp.SetPoint(np.zeros(6)), "positions of shape"),
        (rp.SetPoint(np.zeros((0, 6))), "previewed no set-points"),
        (rp.SetPoint(np.full((2, 6), np.nan)), "positions that are not finite"),
        (rp.SetPoint(np.zeros((2, 6)), np.zeros((1, 6))), "velocities of shape"),
    ],
)
def test_wrong_previews_are_named(wrong: object, message: str) -> None:
    scene = ring(4, 1.2)
    sim = rp.Simulation(scene)
    sim.activate(Foreseen(scene.joint_names(["a0"]), wrong))
    before = sim.positions
    with pytest.raises(rp.ControllerError, match=message):
        sim.step(10)
    np.testing.assert_array_equal(sim.positions, before)
    assert sim.steps == 0


def test_mujoco_takes_the_steps_of_varied_arms() -> None:
    assert rp.Simulation(ring(4, 1.5), variation=rp.ArmVariation(friction=0.01)).tiles[0].arms is None


def test_data_may_be_changed_in_the_middle_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiled_model, "_SHARED", 1)
    runs = []
    for threads in (1, 2):
        sim = rp.Simulation(ring(4, 1.5), threads=threads)
        sim.step(30)
        assert sim.tiles[0].arms is not None
        sim.data.qfrc_applied[1] = 20.0
        assert sim.tiles[0].arms is None
        sim.step(30)
        runs.append((sim.positions.tobytes(), sim.data.time, sim.data.xpos.tobytes()))
        assert sim.tiles[0].proof is not None
        assert sim.tiles[0].proof.proven == 61
    assert runs[0] == runs[1]


@pytest.mark.parametrize("proofs", [True, False])
def test_arms_that_become_unstable_are_reported(proofs: bool) -> None:
    sim = rp.Simulation(ring(4, 1.5), dt=0.1, stiffness=3000.0, threads=2)
    assert sim.tiles[0].arms is not None
    if not proofs:
        search_always(sim)
    names = sim.scene.joint_names()
    drive = rp.ForwardVelocityController(names)
    sim.activate(drive)
    drive.command(np.full(len(names), 0.5))
    with pytest.raises(rp.BackendError, match="unstable"):
        sim.run(duration=200.0)


class Kicked(rp.Controller):
    """Holds its joints while something unforeseen pushes them for a while."""

    def __init__(self, names: tuple[str, ...], push: float) -> None:
        super().__init__(names)
        self.push = push

    def activate(self, joints: rp.JointInfo, state: rp.JointState) -> None:
        super().activate(joints, state)
        self.hold = state.positions.copy()

    def update(self, state: rp.JointState) -> rp.SetPoint:
        return rp.SetPoint(*(row[0] for row in self.preview(np.array([state.time])) if row is not None))

    def preview(self, times: Array) -> rp.SetPoint:
        rows = np.zeros((4, len(times), len(self.hold)))
        rows[0] = self.hold
        rows[3, (times > 0.1) & (times < 0.3), 0] = self.push
        return rp.SetPoint(*rows)


def test_a_kicked_arm_hits_its_neighbor_after_steps_without_a_search(rr1: Robot) -> None:
    # Two pairs of arms that reach for each other, and set-points that never come near a contact.
    places = {f"a{i}": pose([0.0, 0.5 * i, 0.0]) for i in range(4)}
    arms = {name: rp.Arm(rr1, place, np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0])) for name, place in places.items()}
    scene = rp.Scene(arms=arms).with_obstacle("floor", FLOOR)
    assert rp.CollisionChecker(scene).is_free(scene.configuration())
    found = []
    for search in ("proofs", "always", "MuJoCo alone"):
        sim = rp.Simulation(scene)
        proof = sim.tiles[0].proof
        if search == "always":
            search_always(sim)
        elif search == "MuJoCo alone":
            _ = sim.model
        sim.activate(Kicked(scene.joint_names(["a1"]), 1e4))
        sim.step(40)
        assert sim.contacts == ()
        sim.step(160)
        found.append((sim.contacts, sim.max_penetration, sim.positions.tobytes(), sim.velocities.tobytes()))
        if search == "proofs":
            assert proof is not None
            assert 40 <= proof.proven < 190
    assert found[0] == found[1]
    contacts = found[0][0]
    assert {name.split("/")[0] for contact in contacts for name in contact.pair} == {"a1", "a2"}
    first, reference = contacts[0], found[2][0][0]
    assert (first.pair, first.first) == (reference.pair, reference.first)
    assert first.depth == pytest.approx(reference.depth, rel=1e-6)


def test_no_state_that_is_proven_has_a_contact() -> None:
    scene = ring(4, 0.58)
    world, rng = build_mujoco(scene), np.random.default_rng(3)
    proof, data = ContactProof(world), mujoco.MjData(world.model)
    limits = scene.limits()
    planned = [world.joint_names.index(name) for name in scene.joint_names()]
    mimics = [(i, i - 1) for i, name in enumerate(world.joint_names) if name.endswith("opposite_finger_joint")]
    touching = proven = 0
    for _ in range(400):
        q, rates = np.zeros(len(world.joint_names)), rng.normal(size=(2, len(world.joint_names)))
        home = scene.configuration()
        q[planned] = home + rng.uniform(0.0, 0.5) * (rng.uniform(limits.lower, limits.upper) - home)
        for follower, leader in mimics:
            q[follower], rates[:, follower] = q[leader], rates[:, leader]
        for step in range(6):
            # Off the curve by more and more.
            t = 0.002 * step
            state = q + t * rates[0] + 0.5 * t * t * rates[1] + rng.normal(size=len(q)) * 1e-4 * step
            found = proof.covers(state, rates[0], rates[1])
            data.qpos[:] = state
            mujoco.mj_forward(world.model, data)
            proven, touching = proven + found, touching + (data.ncon > 0)
            assert not (found and data.ncon)
    assert proven == proof.proven
    assert proven > 200
    assert touching > 200


def sliding() -> Robot:
    """An arm that turns, slides and turns."""
    rod = Geometry("rod", rp.Capsule(0.02, 0.3), pose([0.15, 0.0, 0.1], rpy=[0.0, 1.2, 0.0]))
    inertial = Inertial(1.0, np.zeros(3), 0.01 * np.eye(3))
    links = (Link("base"), *(Link(name, inertial, collisions=(rod,)) for name in ("turret", "carriage", "hand")))
    joints = (
        Joint("turn", "continuous", "base", "turret", pose([0.1, 0.0, 0.3])),
        Joint("slide", "prismatic", "turret", "carriage", pose([0.2, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]), -0.1, 0.4),
        Joint("roll", "revolute", "carriage", "hand", pose([0.0, 0.1, 0.2]), np.array([0.0, 1.0, 0.0]), -2.0, 2.0),
    )
    limits = Limits(np.array([-3.1, -0.1, -2.0]), np.array([3.1, 0.4, 2.0]), *(np.ones(3) for _ in range(4)))
    return Robot(
        "sliding", links, joints, ("turn", "slide", "roll"), limits, {"home": np.zeros(3)}, {}, frozenset(), "hand"
    )


def test_levers_bound_how_far_joints_move_points(rr1: Robot) -> None:
    rng = np.random.default_rng(4)
    for robot in (rr1, sliding()):
        scene = rp.Scene().with_arm("a", robot)
        if robot is rr1:
            scene = scene.with_obstacle("rod", rp.Capsule(0.01, 0.3), [0.4, 0.0, 0.9]).attach("rod", "a")
        world = build_mujoco(scene)
        model, data = world.model, mujoco.MjData(world.model)
        proof = ContactProof(world)
        reached = np.zeros(model.nv)
        for _ in range(300):
            lower, upper = np.array([[-3.0, 3.0]] * model.nv).T
            for joint in proof._slides:
                lower[joint], upper[joint] = -proof._travel[0], proof._travel[0]
            q, j = rng.uniform(lower, upper), int(rng.integers(model.nv))
            change = float(rng.uniform(-0.2, 0.2))
            centers, turns = [], []
            for value in (q[j], np.clip(q[j] + change, lower[j], upper[j])):
                data.qpos[:] = q
                data.qpos[j] = value
                mujoco.mj_kinematics(model, data)
                centers.append(data.geom_xpos.copy())
                turns.append(data.geom_xmat.reshape(-1, 3, 3).copy())
            out = rng.normal(size=(model.ngeom, 3))
            out *= (model.geom_rbound / np.linalg.norm(out, axis=1))[:, None]
            one, two = (c + np.einsum("nij,nj->ni", R, out) for c, R in zip(centers, turns, strict=True))
            moved = np.linalg.norm(one - two, axis=1).max()
            assert moved <= proof._levers[j] * abs(change) + 1e-12
            reached[j] = max(reached[j], moved / (proof._levers[j] * abs(change)))
        assert reached.max() > 0.5  # and they are not far too long


def test_who_takes_the_model_may_change_it(rr1: Robot) -> None:
    arms = {f"a{i}": rp.Arm(rr1, pose([1.2 * i, 0.0, 0.0])) for i in range(4)}
    sim = rp.Simulation(rp.Scene(arms=arms).with_obstacle("floor", FLOOR))
    (tile,) = sim.tiles
    sim.step(20)
    assert tile.proof is not None
    assert tile.proof.proven == 21
    assert sim.contacts == ()
    # A floor that is higher than in the scene is in contact.
    model, proof = sim.model, sim.tiles[0].proof
    assert proof is None
    assert not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.body("floor").pos[2] = 0.3
    sim.step(1)
    assert {pair for contact in sim.contacts for pair in contact.pair} >= {"floor", "a0/upper_arm_link"}


def test_few_arms_and_loose_bodies_have_no_proofs(rr1: Robot) -> None:
    arms = {f"a{i}": rp.Arm(rr1, pose([1.2 * i, 0.0, 0.0])) for i in range(4)}
    scene = rp.Scene(arms=arms)
    assert rp.Simulation(scene).tiles[0].proof is not None
    assert rp.Simulation(scene.with_obstacle("ball", rp.Sphere(0.1), [0, 0, 3], mass=1.0)).tiles[0].proof is None
    assert rp.Simulation(rp.Scene(arms={"a0": arms["a0"]})).tiles[0].proof is None
