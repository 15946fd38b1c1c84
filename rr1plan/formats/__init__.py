"""Readers and writers of robots, meshes, scenes and plans."""
