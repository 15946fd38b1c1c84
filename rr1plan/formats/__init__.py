"""Files in, values out: robots, meshes, scenes and plans."""
