"""From a problem to a certified, replayed, visible motion: the whole pipeline in five steps.

RR1 stands on a table among boxes and has to bring its tool behind a crate.
"""

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)
print(motion)

replay = rp.simulate(motion.trajectory, scene)
print(replay)

# motion.show().wait() opens the same page live, until it is closed; this one plays offline, in any browser.
print(motion.save_html("01_first_motion.html"), motion.save("01_first_motion.json"))
