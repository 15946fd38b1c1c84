"""Files: a motion is saved with its scene's fingerprint, and an altered file is refused by name."""

from pathlib import Path

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)

file = motion.save("14_motion.json")
again = rp.load_motion(file)
print("read back exactly:", again.trajectory.allclose(motion.trajectory, atol=0.0))

table = rp.save_csv("14_trajectory.csv", motion.trajectory)
print(table.read_text().splitlines()[0])

text = Path(file).read_text()
Path("14_altered.json").write_text(text.replace("0.1", "0.2", 1))
try:
    rp.load_motion("14_altered.json")
except rp.FormatError as error:
    print("refused:", error)
