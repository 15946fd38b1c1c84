"""Kernels in C for planning: collision, planners, inverse kinematics, retiming; compiled when the package is built."""
