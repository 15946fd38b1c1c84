"""Execution of plans: temporal plan graphs, executions with delays, new goals during the motion."""
