"""Many arms: each on a separate path, scheduled on one clock and certified in continuous time.

A `Problem` that moves several arms is one problem with more columns, and every planner solves it in the composite
configuration space. That is as complete as the planner, but the dimension grows with every arm. For three or more arms,
`plan_motion` plans a separate path for each arm instead: `plan_many_arms`. `search` finds schedules, `timing` computes
when arms move on fixed paths, `paths` has the paths; `execution` is about running plans, and `scenarios` generates
seeded problems. Grids and rings of arms are in `rr1plan.scene.placement`.
"""
