"""Many arms: each on a separate path, scheduled on one clock and certified in continuous time.

A `Problem` that moves several arms is one problem with more columns, and every planner answers it in the joint space
of all of them (see `composite`). From three arms on `plan_motion` plans a path for each arm instead: `plan_many_arms`.
`search` finds schedules, `timing` says when arms move on fixed paths, `paths` where; `execution` is about plans that
run, and `scenarios` makes seeded problems. Grids and rings of arms are in `rr1plan.scene.placement`.
"""
