"""Calls from Python to kernels in C: parsing of declarations, passing of memory, loading of libraries.

The kernels of the planners (`rr1plan/kernels`) and of the referee (`rr1plan/validation/kernels`) share this binding,
but no sources.
"""
