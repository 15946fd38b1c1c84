"""Plans that run: temporal plan graphs, executions with delays, new goals on the way."""
