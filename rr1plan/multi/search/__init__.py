"""Searches for schedules of all arms: prioritized, in time windows, conflict-based, and improvement of schedules."""
