"""Searches for schedules of all arms: prioritized, on windows, by conflicts, and improvement."""
