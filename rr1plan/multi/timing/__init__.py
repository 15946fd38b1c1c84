"""Timing on fixed paths: coordination diagrams, safe intervals, schedules, who waits for whom."""
