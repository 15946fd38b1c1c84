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


def surface_points(shape: rp.Shape) -> np.ndarray:
    """Extreme points of a box, a cylinder or a capsule, in its frame."""
    if isinstance(shape, rp.Box):
        return np.array(np.meshgrid(*[[-0.5 * s, 0.5 * s] for s in shape.size])).reshape(3, -1).T
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles]) * shape.radius
    ends = np.array([[0.0, 0.0, -0.5 * shape.length], [0.0, 0.0, 0.5 * shape.length]])
    if isinstance(shape, rp.Capsule):
        heights = np.linspace(-1.0, 1.0, 61)[:, None, None]
        ball = (np.sqrt(1.0 - heights**2) * ring + shape.radius * heights * [0.0, 0.0, 1.0]).reshape(-1, 3)
        return np.concatenate([ball + end for end in ends])
    return np.concatenate([ring + end for end in ends])


def link_boxes(scene: rp.Scene, q: np.ndarray) -> dict[str, np.ndarray]:
    """Boxes around the links of a scene, by the kinematics in Python."""
    poses = scene.link_poses(scene.split(q))
    boxes = {}
    for arm, placed in scene.arms.items():
        for link in placed.robot.links:
            parts = [
                (poses[f"{arm}/{link.name}"] @ g.pose, surface_points(g.shape)) for g in link.visuals or link.collisions
            ]
            if parts:
                points = np.concatenate([p @ T[:3, :3].T + T[:3, 3] for T, p in parts])
                boxes[f"{arm}/{link.name}"] = np.array([points.min(axis=0), points.max(axis=0)])
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
