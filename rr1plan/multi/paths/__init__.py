"""Paths of agents: in segments, with their bodies, found by the planners of single arms."""
