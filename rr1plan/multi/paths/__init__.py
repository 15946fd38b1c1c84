"""Paths of agents, found by the planners of single arms: their segments, and their placed bodies."""
