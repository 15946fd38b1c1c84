"""How Python calls kernels in C: sources read for their declarations, memory handed over, libraries loaded.

The kernels of the planners (`rr1plan/kernels`) and the referee's own (`rr1plan/validation/kernels`) share this, and no
source.
"""
