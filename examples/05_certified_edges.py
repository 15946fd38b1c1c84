"""Certified edges: every sample of a motion can be free although the motion is not, and what a proof costs.

Among moving arms an edge also has a time interval, and whether it is free depends on that interval.
"""

import numpy as np

import rr1plan as rp

robot = rp.load_robot("planar2r")
scene = rp.Scene().with_arm("arm", robot)
# A needle near the tip's path: the forearm is 8 cm wide there and moves by 13 cm from one sample to the next.
needle = rp.Capsule(0.0005, 0.2)
scene = scene.with_obstacle("needle", needle, [1.31, 0.99, 0.0])

start, goal = np.array([-0.3, 0.1]), np.array([1.2, 0.1])
checker = rp.CollisionChecker(scene)

samples = np.linspace(start, goal, 20)
print("20 samples along the edge are all free:", checker.are_free(samples).all())
print("the certificate says the edge is free: ", checker.edge_is_free(start, goal))

contact = checker.first_contact(start, goal)
between = contact.fraction * (len(samples) - 1)
print(f"first contact: {' and '.join(contact.pair)}, between samples {int(between)} and {int(between) + 1}")

above = scene.with_obstacle("needle", needle, [1.31, 0.99, 0.5])
checker = rp.CollisionChecker(above)
print("with the needle lifted:                 ", checker.edge_is_free(start, goal))
print(f"that proof looked at {checker.counters.configurations} configurations")

# Two of these arms face each other. The second reaches across the middle and back, from 1 s to 3 s.
cell = rp.place_ring(robot, 2, radius=0.9)
one, two = cell.arms
across = rp.Trajectory.from_samples(cell.joint_names([two]), [1.0, 2.0, 3.0], [[1.5, 0.0], [0.0, 0.0], [1.5, 0.0]])
timed = rp.TimedChecker(rp.CollisionChecker(cell, [one]), {two: across})
for begin in (0.0, 1.5, 2.8):
    free = timed.edge_is_free([-1.4, 0.0], [1.4, 0.0], begin, begin + 1.0)
    print(f"an edge from {begin} s to {begin + 1.0} s is free among moving arms: {free}")
contact = timed.first_contact([-1.4, 0.0], [1.4, 0.0], 1.5, 2.5)
print(f"first contact at {contact.time:.4f} s: {' and '.join(contact.pair)}")
