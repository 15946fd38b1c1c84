"""Calibration: from the readings of encoders or motors to joint positions, estimated from measured tool positions."""
