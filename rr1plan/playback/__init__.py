"""Simulation in MuJoCo, the 3-D page, figures of configuration spaces and schedules."""
