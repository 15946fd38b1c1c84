"""Many arms: placement helpers and decoupled planning methods.

Coupled planning needs no additional code: a `Problem` that moves several arms has more columns,
and every planner solves it (see `composite`). Each decoupled method
(prioritized, conflict-based, coordination on fixed paths) belongs in a module of this package.
"""

from rr1plan.scene.placement import place_grid, place_ring

__all__ = ["place_grid", "place_ring"]
