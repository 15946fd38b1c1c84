"""A potential field over the configuration space of a 2R arm: descents, basins, best-first search and the wave."""

import numpy as np

import rr1plan as rp
from rr1plan.lessons.potential_field import (
    attraction,
    basins,
    descend,
    field_grid,
    fill_minima,
    obstacle_distance,
    reached_share,
    repulsion,
    wave,
)

scene = rp.load_scene("planar2r_path")
start, goal = [-0.9, -2.6], [2.0, 2.7]
grid = field_grid(scene)
print(grid)

attractive, distance = attraction(grid, goal), obstacle_distance(grid)
for gain in (0.0, 0.03, 0.3):
    values = attractive + repulsion(distance, gain, 0.4)
    cells, minima = descend(grid, values, start), np.unique(basins(grid, values)[grid.free])
    ends = "at the goal" if tuple(cells[-1]) == grid.cell(goal) else "in a local minimum"
    share = 100 * reached_share(grid, values, goal)
    print(f"gain {gain:4.2f}: the descent ends {ends}, {len(minima)} minima, {share:.0f} % reach the goal")

values = attractive + repulsion(distance, 0.03, 0.4)
filled = fill_minima(grid, values, start, goal)
print(f"best-first search: {filled.visited} cells visited, {len(filled.cells)} on the way")

steps = wave(grid, goal)
print(f"wave: {steps[grid.cell(start)]:.0f} steps, {100 * reached_share(grid, steps, goal):.0f} % reach the goal")

# The way is free on the grid; a checker proves that it is free between the centers of the cells, too.
path = grid.centers()[tuple(descend(grid, steps, start).T)]
checker = rp.CollisionChecker(scene)
turns = np.round(np.diff(path, axis=0) / (2 * np.pi)).cumsum(axis=0)
print("proven free:", checker.path_is_free(np.vstack([path[:1], path[1:] - 2 * np.pi * turns])))

lesson = rp.lesson("potential_fields")
print(lesson.save_html("10_potential_fields.html"))
print(lesson.save_svg("10_potential_fields.svg"))
