"""Experiments with the simulator and the viewer, compared with those of the thesis that the project is based on."""
