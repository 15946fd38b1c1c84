"""From path to motion: shortcuts, blends, the phase plane, and what a jerk limit costs."""

import numpy as np

import rr1plan as rp

problem = rp.load_problems("planar2r_path")["over_the_seam"]
scene = problem.scene
raw = rp.Path(problem.joint_names, rp.grow_rrt_connect(problem, step=0.4, rng=3).path)
short = rp.shorten(raw, scene, iterations=100, rng=1)
print(f"planned {raw.length:.2f} rad, shortened {short.length:.2f} rad")

for blend in (0.0, 0.03, 0.1, 0.4):
    plane = rp.phase_plane(short, scene, max_blend=blend)
    print(f"blends up to {blend:.2f} rad: {plane.duration:.3f} s, {len(plane.switches)} switching points")

plane = rp.phase_plane(short, scene)
timed = rp.retime(short, scene, max_blend=0.4)
print(f"phase plane {plane.duration:.3f} s, retime {timed.duration:.3f} s")
for scale in (0.25, 0.5, 1.0):
    faster, harder = (rp.phase_plane(short, scene, **{f"{of}_scale": scale}) for of in ("velocity", "acceleration"))
    print(f"{100 * scale:.0f} % of the velocity {faster.duration:.2f} s, of the acceleration {harder.duration:.2f} s")

one = rp.seven_phases(1.2, velocity=2.0, acceleration=8.0, jerk=80.0)
print(f"one joint: {one.duration:.3f} s, phases of {np.round(one.durations, 3)} s")
for jerk in (10.0, 80.0, 640.0):
    print(f"jerk limit {jerk:5.0f} rad/s³: {rp.seven_phases(1.2, 2.0, 8.0, jerk).duration:.3f} s")

lesson = rp.lesson("motion")
print(lesson.save_html("06_motion.html"))
print(lesson.save_svg("06_motion.svg"))
