"""Replay of a motion in MuJoCo."""
