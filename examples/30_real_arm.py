"""To RR1's control box: a motion as rest-to-rest commands, certified step by step, executed by an emulated box."""

import pathlib

import rr1plan as rp

# Example values: measure the steps per radian of your arm; the rest depends on its firmware.
pathlib.Path("30_arm.toml").write_text("""
format = "rr1plan calibration"
version = 1
robot = "rr1"
source = "made up"
units = { position = "rad", reading = "steps" }

[joints]
shoulder_joint = { sign = 1, zero = 0.0, zero_std = 0.001, scale = 802.1, scale_std = 0.5 }
upper_arm_joint = { sign = -1, zero = 0.0, zero_std = 0.001, scale = 802.1, scale_std = 0.5 }
elbow_joint = { sign = -1, zero = 0.0, zero_std = 0.001, scale = 1547.0, scale_std = 0.8 }
forearm_joint = { sign = -1, zero = 0.0, zero_std = 0.001, scale = 2406.4, scale_std = 1.0 }
wrist_joint = { sign = 1, zero = 0.0, zero_std = 0.001, scale = 4411.8, scale_std = 2.0 }
hand_joint = { sign = -1, zero = 0.0, zero_std = 0.001, scale = 2492.4, scale_std = 1.0 }

[control_box]
tick = 0.000602

[control_box.channels]
S1 = { joint = "shoulder_joint", fast_period = 6, ramp_steps = 128 }
S2 = { joint = "upper_arm_joint", fast_period = 4, ramp_steps = 128 }
E1 = { joint = "elbow_joint", fast_period = 2, ramp_steps = 128 }
E2 = { joint = "forearm_joint", fast_period = 3, ramp_steps = 128 }
W1 = { joint = "wrist_joint", fast_period = 2, ramp_steps = 128 }
W2 = { joint = "hand_joint", fast_period = 4, ramp_steps = 64 }
""")
calibration, box = rp.load_calibration("30_arm.toml"), rp.load_control_box("30_arm.toml")

scene = rp.load_scene("rr1_table")
scene = scene.with_robot("rr1", scene.arms["rr1"].robot.with_limits("hardware"))
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, margin=0.004, rng=0)

plan = rp.plan_commands(motion, calibration, box)
print(plan)
print(f"planned {motion.trajectory.duration:.1f} s, the arm takes {plan.trajectory.duration:.1f} s")
print(f"{len(plan.path)} configurations between single steps are certified")

# A dry run. For the real arm: rp.open_serial_port("/dev/ttyACM0") in place of the emulated line.
channels = ("S1", "S2", "E1", "E2", "W1", "W2")
start = dict(zip(channels, plan.start[:6], strict=True))
end = rp.send_commands(plan, rp.EmulatedSerialLine(box, start))
print(f"executed: {end.state}, counters {end.position[:6]}")

# If the arm is at another configuration, nothing is sent.
try:
    rp.send_commands(plan, rp.EmulatedSerialLine(box, start | {"W1": 0}))
except rp.HardwareError as error:
    print(f"refused: {error}")

# For ROS: a file for `ros2 topic pub`, checked by the rules of joint_trajectory_controller.
file = rp.save_joint_trajectory("30_motion.yaml", motion.trajectory, dt=0.05)
print(f"objections of a controller: {list(rp.check_joint_trajectory(file))}")
