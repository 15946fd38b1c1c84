"""Certified edges: why sampling a motion is not enough, and what a proof costs."""

import numpy as np

import rr1plan as rp

robot = rp.load_robot("planar2r")
scene = rp.Scene().with_arm("arm", robot)
# A needle that crosses the way of the arm's tip.
scene = scene.with_obstacle("needle", rp.Capsule(0.0005, 0.2), [1.55, 0.6, 0.0])

start, goal = np.array([-0.3, 0.1]), np.array([1.2, 0.1])
checker = rp.CollisionChecker(scene)
motions = rp.MotionChecker(checker)

samples = np.linspace(start, goal, 20)
print("20 samples along the edge are all free:", all(checker.is_free(q) for q in samples))
print("the certificate says the edge is free: ", motions.edge_is_free(start, goal))

contact = motions.first_contact(start, goal)
print("first contact:", contact)

above = scene.with_obstacle("needle", rp.Capsule(0.0005, 0.2), [1.55, 0.6, 0.5])
motions = rp.MotionChecker(above)
print("with the needle lifted:                 ", motions.edge_is_free(start, goal))
print(f"that proof looked at {motions.configurations_checked} configurations")
