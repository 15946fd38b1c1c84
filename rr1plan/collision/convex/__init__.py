"""Convex solids by themselves: hulls, support tables, bounding spheres; and triangle meshes in trees."""
