"""A mirror: joint states of a running arm, compared with its plan and the certified collision-free corridor.

    python 32_mirror.py

The arm is a simulation that broadcasts its joint states over UDP; a person pushes it during the motion.
"""

import socket
import threading

import numpy as np

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, "home", rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
plan = rp.plan_motion(problem, rng=0).trajectory.stretched(3.0)
names = plan.joint_names
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:  # a free port of this machine
    probe.bind(("127.0.0.1", 0))
    address = probe.getsockname()

# How far may the arm deviate from the plan and still be proven free of collision?
corridor = rp.certified_corridor(scene, plan)
print(corridor)


def run_arm() -> None:
    """Simulate the arm, with a push at 0.7 s."""
    sim = rp.Simulation(scene)
    follow = rp.JointTrajectoryController(names, goal_tolerance=0.05)
    sim.activate(follow)
    follow.send(plan)
    shoulder = sim.model.joint(names[0]).dofadr[0]

    def push(now: rp.Simulation) -> None:
        now.data.qfrc_applied[shoulder] = 45.0 if 0.7 < now.time < 0.74 else 0.0

    sim.on_step(push)
    with rp.JointStateBroadcaster(names, address, rate=100.0) as broadcaster:
        broadcaster.attach(sim)
        sim.run(duration=plan.duration + 0.1, speed=1.0)


source = f"udp://{address[0]}:{address[1]}"
mirror = rp.Mirror(scene, plan, corridor=corridor, start=0.0, record="32_run.jsonl", on_event=print)
with mirror, rp.read_states(source, silence=0.5) as stream:
    # mirror.show() opens a page that follows the arm
    arm = threading.Thread(target=run_arm)
    arm.start()
    for item in stream:
        if isinstance(item, rp.StreamError) and not arm.is_alive():
            break  # silence: the arm has arrived
        mirror.receive(item)
    print(mirror.report())
    print(f"MuJoCo has {mirror.data.ncon} contacts in the last state")

# The recording is a stream, too: rr1plan mirror 32_run.jsonl --scene rr1_table
with rp.Mirror(scene, plan, corridor=corridor, start=0.0) as again:
    report = again.run(rp.read_states("32_run.jsonl"))
print(f"again from the file: {report.messages} messages, off by {max(report.max_deviation.values()):.3f} rad at most")

# One configuration: the share of the corridor that it uses, and the pair with the smallest remaining distance.
q = plan(0.5 * plan.duration) + np.array([0.005, 0.0, 0.0, 0.0, 0.0, 0.0])
place = corridor.position(q)
print(f"5 mrad off: {100 * place.use:.0f} % of the corridor, {' and '.join(place.pair)} are next")
