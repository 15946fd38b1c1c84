"""Step by step: a simulation commanded while it runs, by controllers that behave like those of ros2_control."""

import numpy as np

import rr1plan as rp

scene = rp.load_scene("rr1_table")
motion = rp.plan_motion(rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20])), rng=0)

sim = rp.Simulation(scene)  # steps of 2 ms
arm = rp.JointTrajectoryController(motion.trajectory.joint_names)
sim.activate(arm)
execution = arm.send(motion.trajectory)
sim.run(duration=motion.trajectory.duration + 0.2)
print(f"{execution}, code {execution.code}, at most {execution.max_error.max():.1e} rad off")
print(f"contacts: {len(sim.contacts)}")

# The same way back from samples, canceled half way.
times, q = motion.trajectory.sample(0.02)
qd = motion.trajectory(times, 1)
back = arm.send(rp.Trajectory.from_samples(motion.trajectory.joint_names, times, q[::-1], -qd[::-1]))
sim.run(duration=0.5 * motion.trajectory.duration)
arm.cancel()
sim.run(duration=0.5)
print(f"the way back: {back}; now {np.abs(sim.velocities).max():.0e} rad/s")


hand, begin = ["rr1/hand_joint"], sim.state(["rr1/hand_joint"])


class Wave(rp.Controller):
    """A controller of your own has one method."""

    def update(self, state: rp.JointState) -> rp.SetPoint:
        """Swing around the position at the beginning."""
        phase = 4.0 * (state.time - begin.time)
        return rp.SetPoint(begin.positions + 0.15 * (1.0 - np.cos(phase)), 0.6 * np.array([np.sin(phase)]))


sim.activate(Wave(hand), replace=True)  # the arm's other joints hold their set-points
with rp.JointStateBroadcaster(hand, "24_states.jsonl", rate=100.0) as states:
    states.attach(sim)
    sim.run(duration=2.0)
print(f"{sim}, {sim.real_time_factor:.0f} times real time")
sim.reset()
print(f"again at {sim.time:g} s, {np.abs(sim.configuration() - scene.configuration()).max():g} rad from the start")
