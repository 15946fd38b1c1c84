"""Files: a saved motion is validated again when it is loaded, in its own scene or in one that has changed since."""

from pathlib import Path

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)

file = motion.save("14_motion.json")
again = rp.load_motion(file)
print("read back exactly:", again.trajectory.allclose(motion.trajectory, atol=0.0))
print("proven again:", bool(again))

# Is it still valid after a change of the cell?
arm = next(iter(scene.arms))
halfway = motion.trajectory(0.5 * motion.trajectory.duration)
where = scene.with_configuration(arm, halfway).link_poses()[f"{arm}/tool"][:3, 3]
changed = rp.load_motion(file, scene.with_obstacle("late_ball", rp.Sphere(0.03), where))
print(f"there: {changed.report!r}; what differs: {', '.join(changed.changes)}")

# Samples of a motion, also from another program; joined by quintics, because they include accelerations.
table = rp.save_csv("14_trajectory.csv", motion.trajectory.stretched(2.0))
print(table.read_text().splitlines()[0])
print("from samples:", rp.load_motion(table, scene))

text = Path(file).read_text()
Path("14_altered.json").write_text(text.replace("0.1", "0.2", 1))
try:
    rp.load_motion("14_altered.json")
except rp.FormatError as error:
    print("refused:", error)
