"""The arrays that the collision kernels read, made from geometries."""
