"""Coupled planning of several arms in their composite configuration space.

This needs no function: a `Problem` is composite by definition. Its start and goal have the columns
of all moving arms, its checker tests arms against each other, and every planner of `rr1plan.planners` solves it:

    problem = Problem(scene, goal={"left": ..., "right": ...})
    result = plan(problem)

The method is as complete as the planner, and suitable for two or three arms. The dimension grows with
every arm; decoupled methods for many arms are in other modules of this package.
"""
