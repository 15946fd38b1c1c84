"""Calibration: 20 measured positions give the sign, zero and scale of every joint, and name a belt that slipped.

    python 31_calibration.py

The real arm is simulated by parameters hidden from the estimation; readings are motor steps.
"""

import numpy as np

import rr1plan as rp

rng = np.random.default_rng(3)
robot = rp.load_robot("rr1")
scene = rp.load_scene("rr1_table")
kinematics = rp.Kinematics(robot)
names = robot.joint_names

# The true parameters of the arm: signs, zeros and steps per radian, unknown to the user.
signs = np.array([1, -1, -1, -1, 1, -1])
zeros = np.radians([4.0, -7.5, 2.0, 11.0, -3.0, 8.0])
scales = np.array([802.0, 815.0, 1547.0, 2406.0, 4412.0, 2492.0])

# A pointer of 10 cm across the tool: on the axis of the last joint, that joint would not move the point.
point = [0.10, 0.0, 0.0]
poses = rp.propose_calibration_poses(scene, 20, point=point, rng=0)
print(f"{len(poses)} poses to measure in, all free of collision")


def measured(noise: float) -> tuple[rp.Array, rp.Array]:
    """What a person would write down: the motor counters and the position of the pointer's tip."""
    tools = kinematics.poses_batch(poses)
    tips = tools[:, :3, :3] @ point + tools[:, :3, 3]
    return np.round((poses - zeros) * signs * scales), tips + noise * rng.standard_normal(tips.shape)


# The scales must be known to within 20 %, from gears and microsteps; signs and zeros need not be known.
start = rp.Calibration.assumed(robot, dict(zip(names, scales * rng.uniform(0.85, 1.15, 6), strict=True)), unit="steps")
readings, tips = measured(1e-3)
tips[5] += [0.04, 0.0, 0.01]  # an outlier: the ruler was misread
before = rp.calibrate(robot, readings, tips, start=start, point=point)
print(before)
worst = max(abs(joint.zero - zero) for joint, zero in zip(before.joints.values(), zeros, strict=True))
print(f"zeros are off by at most {np.degrees(worst):.2f} deg")
before.save("31_rr1.toml")

# A belt slips by two degrees; the arm is measured again.
zeros[2] += np.radians(2.0)
after = rp.calibrate(robot, *measured(1e-3), start=rp.load_calibration("31_rr1.toml"), point=point)
moved, *others = after.zero_shifts(before)
print(f"moved: {moved}")
print(f"all others by less than {max(shift.significance for shift in others):.1f} standard deviations")

# Without the pointer the last joint is not observable.
readings, _ = measured(0.0)
on_axis = rp.calibrate(robot, readings, kinematics.poses_batch(poses)[:, :3, 3], start=start)
assert on_axis.fit is not None
print(f"without a pointer, not determined: {dict(on_axis.fit.undetermined)}")

# From now on, counters convert to joint positions and back.
print(f"home is at {np.round(after.readings(robot.home)).astype(int).tolist()} steps")
