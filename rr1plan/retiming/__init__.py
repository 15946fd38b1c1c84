"""Time parameterization: from a path to a trajectory under joint limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rr1plan.retiming.methods import retime, retiming_names, retiming_table

if TYPE_CHECKING:
    from rr1plan.retiming.ruckig_retiming import point_to_point as point_to_point

__all__ = ["point_to_point", "retime", "retiming_names", "retiming_table"]


def __getattr__(name: str) -> Any:
    # Ruckig is imported lazily.
    if name == "point_to_point":
        from rr1plan.retiming.ruckig_retiming import point_to_point

        return point_to_point
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
