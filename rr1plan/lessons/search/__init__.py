"""Planners to read in a lecture; each records every step."""
