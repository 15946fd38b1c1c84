"""Bounding spheres with which MuJoCo decides whether to search a pair of meshes for contacts."""

from __future__ import annotations

import mujoco
import numpy as np

# MuJoCo keeps vertices in single precision, and rotates them.
_ROUNDING = 1e-6


def shrink_bounding_spheres(model: mujoco.MjModel) -> None:
    """Make the bounding spheres of meshes enclose their vertices.

    MuJoCo's enclose the bounding box, which is a quarter larger for the hull of a boat. Contacts are the same, and
    found in less time, because fewer pairs are searched.

    Args:
        model: The model, changed in place.
    """
    ends = model.mesh_vertadr + model.mesh_vertnum
    distances = (1.0 + _ROUNDING) * np.linalg.norm(model.mesh_vert.astype(np.float64), axis=1)
    radii = np.array([distances[i:j].max() for i, j in zip(model.mesh_vertadr, ends, strict=True)])
    meshes = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    model.geom_rbound[meshes] = np.minimum(model.geom_rbound[meshes], radii[model.geom_dataid[meshes]])
