// Elements under the pointer: links, held objects and obstacles, by their drawn triangles. World coordinates have z up.

/** Converts a point or a direction from the camera's world (y up) to the world (z up). */
const worldPoint = ({ x, y, z }) => new THREE.Vector3(x, -z, y);

class Picker {
  constructor(viewer) {
    this.viewer = viewer;
    this.caster = new THREE.Raycaster();
    this.local = new THREE.Ray();
    this.pose = new THREE.Matrix4();
    this.inverse = new THREE.Matrix4();
    this.product = identity();
    this.corners = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
    this.hit = new THREE.Vector3();
  }

  /** The ray in the world through a point of the window [px]. */
  ray({ clientX, clientY }) {
    const { camera, pane } = this.viewer.stage, box = pane.getBoundingClientRect();
    camera.updateMatrixWorld();
    this.caster.setFromCamera(new THREE.Vector2((2 * (clientX - box.left)) / box.width - 1, 1 - (2 * (clientY - box.top)) / box.height), camera);
    const { origin, direction } = this.caster.ray;
    return new THREE.Ray(worldPoint(origin), worldPoint(direction));
  }

  /** Projects a point of the world to the window: {x, y} [px], and whether it is in front of the camera. */
  project({ x, y, z }) {
    const { camera, pane } = this.viewer.stage, box = pane.getBoundingClientRect();
    camera.updateMatrixWorld();
    const at = cameraPoint(x, y, z).project(camera);
    return { x: box.left + ((at.x + 1) / 2) * box.width, y: box.top + ((1 - at.y) / 2) * box.height, front: Math.abs(at.z) < 1 };
  }

  /** Right, up and forward of the picture as world directions. */
  axes() {
    const { camera } = this.viewer.stage;
    camera.updateMatrixWorld();
    const column = (k) => worldPoint(new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, k));
    return { right: column(0), up: column(1), forward: column(2).negate() };
  }

  /** The nearest link or obstacle under the pointer: {element, arm (its index, -1 of obstacles), frame, point}; null if there is none. */
  at(event) {
    const { world } = this.viewer, ray = this.ray(event), levels = world.detail.levels;
    const shown = [["robots", [world.robots, world.held]], ["obstacles", [world.obstacles]]];
    let nearest = Infinity, found = null;
    for (const bodies of shown.flatMap(([layer, all]) => (this.viewer.isShown(layer) ? all : []))) {
      for (const { body, items } of bodies.sets) {
        for (const item of items) {
          const level = body.alike || item.arm < 0 ? 0 : levels[item.arm], geometry = level < 0 ? null : body.geometry(level);
          const distance = geometry ? this.distance(geometry, this.placed(item), ray) : Infinity;
          if (distance < nearest) { nearest = distance; found = item; }
        }
      }
    }
    return found && { element: found.element, arm: found.arm, frame: found.frame, point: ray.at(nearest, new THREE.Vector3()) };
  }

  placed({ frame, local }) {
    const { poses } = this.viewer.world;
    if (frame < 0) return this.pose.fromArray(local);
    if (!local) return this.pose.fromArray(poses, 16 * frame);
    multiply(this.product, 0, poses, 16 * frame, local, 0);
    return this.pose.fromArray(this.product);
  }

  /** The distance [m] along a ray to the triangles of a geometry at a pose. */
  distance(geometry, pose, ray) {
    const { local, corners, hit } = this;
    if (!geometry.boundingBox) geometry.computeBoundingBox();
    local.copy(ray).applyMatrix4(this.inverse.copy(pose).invert());
    if (!local.intersectsBox(geometry.boundingBox)) return Infinity;
    const { position } = geometry.attributes, { index } = geometry, count = (index || position).count;
    let nearest = Infinity;
    for (let i = 0; i < count; i += 3) {
      corners.forEach((corner, k) => corner.fromBufferAttribute(position, index ? index.getX(i + k) : i + k));
      if (!local.intersectTriangle(...corners, false, hit)) continue;
      nearest = Math.min(nearest, hit.applyMatrix4(pose).distanceTo(ray.origin));
    }
    return nearest;
  }
}
