"""Kernels in C: the certified edge, compiled when the package is built, called through ctypes.

`structs.py` reads the layouts of tables from the headers, `library.py` loads the library made for this processor.
"""
