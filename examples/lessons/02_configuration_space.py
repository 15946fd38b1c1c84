"""Images of obstacles in configuration space: strips, blobs, overlaps, seams, for revolute and prismatic joints."""

import numpy as np

import rr1plan as rp

SHAPES = {
    "disc": (rp.Cylinder(0.15, 0.2), (0.25, 0.72, 0.0)),
    "box": (rp.Box((0.36, 0.2, 0.2)), (-0.62, 0.82, 0.0)),
    "corner": (rp.polygon_prism([(0.7, -1.1), (1.1, -1.1), (1.1, -1.0), (0.8, -1.0), (0.8, -0.7), (0.7, -0.7)]), None),
}
for joints in ("RR", "RP", "PP"):
    scene = rp.Scene(name=f"{joints} arm").with_arm("arm", rp.planar_arm(joints, lengths=(1.0, 0.8)))
    for name, (shape, place) in SHAPES.items():
        scene = scene.with_obstacle(name, shape, place)
    grid = rp.cspace(scene).grid
    print(f"{joints}: {100 * grid.free.mean():.0f} % free, closed: {grid.periodic}, {grid.components} components")
    for name, image in grid.layers.items():
        strip = "with a strip" if image.all(axis=1).any() else "without a strip"
        print(f"  {name}: {100 * image.mean():.1f} % of the cells, {strip}")
    overlap = np.sum(list(grid.layers.values()), axis=0) > 1
    print(f"  in two images at once: {100 * overlap.mean():.1f} %")
    lesson = rp.lesson("configuration_space", scene)
    print(f"  {lesson.save_html(f'02_{joints}.html')}, {lesson.save_png(f'02_{joints}.png')}")
