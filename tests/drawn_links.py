"""Bounding boxes of links as the page draws them and as Python computes them."""

from __future__ import annotations

import numpy as np

import rr1plan as rp

# Boxes around the drawn shapes of each link at a level of detail, from the vertices sent to the graphics card.
DRAWN_LINKS = """level => {
    const found = {}, matrix = new RR1.THREE.Matrix4(), corner = new RR1.THREE.Vector3();
    RR1.world.detail.levels.fill(level);
    RR1.world.detail.version += 1;
    RR1.world.place();
    for (const { meshes, items } of RR1.world.robots.sets) {
        for (const mesh of meshes.filter((m) => m && m.visible)) {
            for (let i = 0; i < mesh.count; i++) {
                mesh.getMatrixAt(i, matrix);
                const box = (found[items[i].element] = found[items[i].element] || new RR1.THREE.Box3());
                const { position } = mesh.geometry.attributes;
                for (let k = 0; k < position.count; k++) {
                    box.expandByPoint(corner.fromBufferAttribute(position, k).applyMatrix4(matrix));
                }
            }
        }
    }
    const boxes = Object.entries(found).map(([name, { min, max }]) => [name, [min.toArray(), max.toArray()]]);
    return Object.fromEntries(boxes);
}"""


def half_sizes(shape: rp.Shape, R: np.ndarray) -> np.ndarray:
    """Half the sizes of the box around a turned box, cylinder or capsule, in the axes of the world, shape (3,)."""
    if isinstance(shape, rp.Box):
        return np.abs(R) @ (0.5 * np.array(shape.size))
    axis = R[:, 2]
    across = 1.0 if isinstance(shape, rp.Capsule) else np.sqrt(np.maximum(0.0, 1.0 - axis**2))
    return 0.5 * shape.length * np.abs(axis) + shape.radius * across


def link_boxes(scene: rp.Scene, q: np.ndarray) -> dict[str, np.ndarray]:
    """Boxes around the links of a scene, by the kinematics in Python."""
    poses = scene.link_poses(scene.split(q))
    boxes = {}
    for arm, placed in scene.arms.items():
        for link in placed.robot.links:
            parts = [(g.shape, poses[f"{arm}/{link.name}"] @ g.pose) for g in link.visuals or link.collisions]
            if parts:
                low = [T[:3, 3] - half_sizes(shape, T[:3, :3]) for shape, T in parts]
                high = [T[:3, 3] + half_sizes(shape, T[:3, :3]) for shape, T in parts]
                boxes[f"{arm}/{link.name}"] = np.array([np.min(low, axis=0), np.max(high, axis=0)])
    return boxes


def wander(scene: rp.Scene, rng: int = 0) -> rp.Trajectory:
    """Three random cubic pieces that meet."""
    generator = np.random.default_rng(rng)
    names = scene.joint_names()
    start = scene.configuration()
    coefficients = np.zeros((3, 4, len(names)))
    for piece in coefficients:
        piece[0] = start
        piece[1:] = generator.uniform(-0.3, 0.3, (3, len(names)))
        start = piece.sum(axis=0)
    return rp.Trajectory(names, np.array([0.0, 1.0, 2.0, 3.0]), coefficients)
