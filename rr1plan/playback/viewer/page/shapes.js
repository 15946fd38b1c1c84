// From a shape of the document to a geometry three.js can draw, many copies at once.

const THREE = MeshCat.THREE;
const unit = {};

function once(key, make) {
  return (unit[key] = unit[key] || make());
}

/** {geometry, scale}: equal geometries are one object, so their copies are drawn in one call; sides: of what is round. */
function solid(shape, sides) {
  switch (shape.kind) {
    case "box":
      return { geometry: once("box", () => new THREE.BoxGeometry(1, 1, 1)), scale: shape.size };
    case "sphere":
      return {
        geometry: once(`sphere ${sides}`, () => new THREE.SphereGeometry(1, sides, sides >> 1)),
        scale: [shape.radius, shape.radius, shape.radius],
      };
    case "cylinder":
      return {
        geometry: once(`cylinder ${sides}`, () => new THREE.CylinderGeometry(1, 1, 1, sides).rotateX(Math.PI / 2)),
        scale: [shape.radius, shape.radius, shape.length],
      };
    case "capsule":
      return {
        geometry: once(`capsule ${sides} ${shape.radius} ${shape.length}`, () => capsule(shape.radius, shape.length, sides)),
        scale: [1, 1, 1],
      };
    case "mesh":
      if (!shape.geometry) shape.geometry = mesh(unpack(shape.vertices).values, unpack(shape.faces).values);
      return { geometry: shape.geometry, scale: [1, 1, 1] };
    default:
      return null;
  }
}

function capsule(radius, length, sides) {
  const points = [], steps = sides >> 2;
  const arc = (from, z) => {
    for (let i = 0; i <= steps; i++) {
      const a = from + (i / steps) * (Math.PI / 2);
      points.push(new THREE.Vector2(Math.max(0, radius * Math.cos(a)), z + radius * Math.sin(a)));
    }
  };
  arc(-Math.PI / 2, -length / 2);
  arc(0, length / 2);
  return new THREE.LatheGeometry(points, sides).rotateX(Math.PI / 2);
}

/** Corners are drawn sharp where faces meet at more than 35 degrees, round elsewhere. */
function mesh(vertices, faces) {
  const count = faces.length / 3;
  const corner = (f, k) => 3 * faces[3 * f + k];
  const normals = new Float32Array(9 * count), positions = new Float32Array(9 * count);
  const flat = new Float32Array(3 * count), area = new Float32Array(3 * count);
  const around = new Map();
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [corner(f, 0), corner(f, 1), corner(f, 2)];
    const u = [0, 1, 2].map((i) => vertices[b + i] - vertices[a + i]);
    const v = [0, 1, 2].map((i) => vertices[c + i] - vertices[a + i]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n) || 1;
    for (let i = 0; i < 3; i++) { area[3 * f + i] = n[i]; flat[3 * f + i] = n[i] / length; }
    for (let k = 0; k < 3; k++) {
      const p = corner(f, k);
      const key = `${vertices[p]},${vertices[p + 1]},${vertices[p + 2]}`;
      if (!around.has(key)) around.set(key, []);
      around.get(key).push(3 * f);
      for (let i = 0; i < 3; i++) positions[9 * f + 3 * k + i] = vertices[p + i];
    }
  }
  const limit = Math.cos((35 * Math.PI) / 180);
  for (let f = 0; f < count; f++) {
    for (let k = 0; k < 3; k++) {
      const p = corner(f, k), own = 3 * f, sum = [0, 0, 0];
      for (const g of around.get(`${vertices[p]},${vertices[p + 1]},${vertices[p + 2]}`)) {
        const alike = flat[own] * flat[g] + flat[own + 1] * flat[g + 1] + flat[own + 2] * flat[g + 2];
        if (alike >= limit || g === own) for (let i = 0; i < 3; i++) sum[i] += area[g + i];
      }
      const length = Math.hypot(...sum) || 1;
      for (let i = 0; i < 3; i++) normals[9 * f + 3 * k + i] = sum[i] / length;
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  return geometry;
}

/** A pose with a scale in it. */
function scaled(pose, scale) {
  const out = Float64Array.from(pose);
  for (let c = 0; c < 3; c++) for (let r = 0; r < 3; r++) out[4 * c + r] *= scale[c];
  return out;
}

/** A color as written (sRGB) for a renderer that counts in light. */
function light(rgb) {
  return new THREE.Color(rgb[0], rgb[1], rgb[2]).convertSRGBToLinear();
}

/** Clear where it is looked at straight on, dense towards its outline: round things stay readable one behind another. */
function rimMaterial(opacity) {
  const material = new THREE.MeshPhongMaterial({
    transparent: true, opacity, depthWrite: false, shininess: 50, specular: 0x1c1c1c, emissive: 0x222222,
  });
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <dithering_fragment>", `
      float facing = abs(dot(normalize(vNormal), normalize(vViewPosition)));
      gl_FragColor.a *= mix(1.0, 0.45, smoothstep(0.0, 0.85, facing));
      #include <dithering_fragment>`);
  };
  return material;
}

/**
 * Solids drawn together: one call for each different geometry.
 * Clear ones hide what is drawn after them behind them; their order is: solids of the document, collision shapes,
 * spheres from fine to coarse, ghosts.
 * items: {shape, pose (with its frame), frame (link number, or -1: the world), color, opacity, element, arm}.
 */
class Bodies {
  constructor(items, style) {
    this.group = new THREE.Group();
    this.sets = [];
    const sets = new Map();
    for (const item of items) {
      const found = solid(item.shape, style.sides || 40);
      if (!found) continue;
      const opacity = style.opacity || item.opacity;
      const key = `${found.geometry.uuid} ${opacity}`;
      if (!sets.has(key)) sets.set(key, { geometry: found.geometry, opacity, items: [] });
      sets.get(key).items.push({ ...item, local: scaled(item.pose, found.scale) });
    }
    for (const set of sets.values()) this.add(set, style);
  }

  add(set, style) {
    const clear = set.opacity < 1;
    const material = style.rim ? rimMaterial(set.opacity) : clear
      ? new THREE.MeshLambertMaterial({
        transparent: true, opacity: set.opacity, depthWrite: false, emissive: 0x555555, emissiveIntensity: 0.6,
        polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2,
      })
      : new THREE.MeshStandardMaterial({ roughness: style.roughness || 0.55, metalness: 0.02, envMapIntensity: 0.85 });
    const drawn = new THREE.InstancedMesh(set.geometry, material, set.items.length);
    drawn.frustumCulled = false;
    drawn.castShadow = !clear && style.shadow !== false;
    drawn.receiveShadow = !clear;
    drawn.renderOrder = clear ? style.order || 2 : 0;
    this.group.add(drawn);
    if (clear) {
      // Depth first, color second: only the nearest surface of a clear body is seen.
      const depth = new THREE.InstancedMesh(set.geometry, new THREE.MeshBasicMaterial({
        colorWrite: false, transparent: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2,
      }), set.items.length);
      depth.instanceMatrix = drawn.instanceMatrix;
      depth.frustumCulled = false;
      depth.renderOrder = drawn.renderOrder - 0.5;
      this.group.add(depth);
    }
    this.sets.push({ drawn, items: set.items });
    set.items.forEach((item, i) => drawn.setColorAt(i, light(item.color)));
  }

  /** Moves everything to where its link is. */
  update(poses) {
    const placed = identity();
    for (const { drawn, items } of this.sets) {
      const out = drawn.instanceMatrix.array;
      items.forEach((item, i) => {
        if (item.frame < 0) { out.set(item.local, 16 * i); return; }
        multiply(placed, 0, poses, 16 * item.frame, item.local, 0);
        out.set(placed, 16 * i);
      });
      drawn.instanceMatrix.needsUpdate = true;
    }
  }

  /** Gives every item the color that choose(item) returns (rgb, 0..1). */
  paint(choose) {
    for (const { drawn, items } of this.sets) {
      items.forEach((item, i) => drawn.setColorAt(i, light(choose(item))));
      drawn.instanceColor.needsUpdate = true;
    }
  }

  dispose() {
    this.group.traverse((o) => { if (o.material) o.material.dispose(); if (o.dispose) o.dispose(); });
  }
}
