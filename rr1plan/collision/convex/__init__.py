"""Single convex solids: hulls, support tables, bounding spheres; and trees of mesh triangles."""
