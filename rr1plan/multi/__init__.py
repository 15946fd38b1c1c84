"""Many arms: placing them, and the methods that exist because arms can be planned apart.

Arms that are planned together need nothing from here: a `Problem` that moves several arms is one
problem with more columns, and every planner answers it (see `composite`). Methods that plan arms
apart (prioritized, conflict-based, coordination on fixed paths) get a file each in this folder.
"""

from rr1plan.multi.placement import place_grid, place_ring

__all__ = ["place_grid", "place_ring"]
