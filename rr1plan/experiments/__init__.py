"""Experiments on the simulator and the viewer, beside those of the thesis that the project comes from."""
