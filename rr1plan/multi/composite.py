"""Several arms planned at once, in the joint space of all that move.

There is nothing to call here: a `Problem` is composite from the start. Its start and goal have the columns
of every moving arm, its checker tests arm against arm, and every planner of `rr1plan.planners` answers it:

    problem = Problem(scene, goal={"left": ..., "right": ...})
    result = plan(problem)

This is complete where the planner is, and the right method for two or three arms. The space grows with
every arm, so the methods for many arms, which plan them apart, have their place beside this file.
"""
