// From a shape of the document to a geometry of three.js, for drawing many copies at once.

const THREE = MeshCat.THREE;
const unit = {};

function once(key, make) {
  return (unit[key] = unit[key] || make());
}

/** {geometry, scale}: equal geometries are one object, so their copies are drawn in one call; sides: of round shapes. */
function solid(shape, sides, resolution = 0) {
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
        geometry: resolution > 0 ? once(`prism ${sides}`, () => prism(sides))
          : once(`cylinder ${sides}`, () => new THREE.CylinderGeometry(1, 1, 1, sides).rotateX(Math.PI / 2)),
        scale: [shape.radius, shape.radius, shape.length],
      };
    case "capsule":
      return {
        geometry: once(`capsule ${sides} ${shape.radius} ${shape.length}`, () => capsule(shape.radius, shape.length, sides)),
        scale: [1, 1, 1],
      };
    case "mesh":
      return { geometry: meshAt(shape, resolution), scale: [1, 1, 1] };
    default:
      return null;
  }
}

/** A unit cylinder along z with as few vertices and triangles as possible. */
function prism(sides) {
  const position = [], normal = [], index = [], turns = [...Array(sides).keys()].map((i) => (2 * Math.PI * i) / sides);
  for (const [cap, z] of [[0, -0.5], [0, 0.5], [-1, -0.5], [1, 0.5]]) {
    for (const a of turns) {
      position.push(Math.cos(a), Math.sin(a), z);
      normal.push(cap ? 0 : Math.cos(a), cap ? 0 : Math.sin(a), cap);
    }
  }
  for (let i = 0; i < sides; i++) {
    const j = (i + 1) % sides;
    index.push(i, j, sides + i, j, sides + j, sides + i);
  }
  for (let i = 1; i + 1 < sides; i++) index.push(2 * sides, 2 * sides + i + 1, 2 * sides + i, 3 * sides, 3 * sides + i, 3 * sides + i + 1);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
  geometry.setAttribute("normal", new THREE.Float32BufferAttribute(normal, 3));
  return geometry.setIndex(index);
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

/** Vertices and faces of a mesh, cached. */
function meshArrays(shape) {
  if (!shape.arrays) shape.arrays = { vertices: unpack(shape.vertices).values, faces: unpack(shape.faces).values };
  return shape.arrays;
}

/** The geometry of a mesh at a resolution [m], cached. */
function meshAt(shape, resolution) {
  shape.geometries = shape.geometries || new Map();
  if (!shape.geometries.has(resolution)) {
    const { vertices, faces } = resolution > 0 ? clustered(meshArrays(shape), resolution) : meshArrays(shape);
    shape.geometries.set(resolution, mesh(vertices, faces));
  }
  return shape.geometries.get(resolution);
}

/** A mesh with one vertex per cube of a grid, the mean of its vertices (Rossignac and Borrel 1993). */
function clustered({ vertices, faces }, cell) {
  const cells = new Map(), owner = new Uint32Array(vertices.length / 3), sums = [];
  for (let i = 0; i < owner.length; i++) {
    const key = [0, 1, 2].map((k) => Math.floor(vertices[3 * i + k] / cell)).join();
    if (!cells.has(key)) { cells.set(key, cells.size); sums.push([0, 0, 0, 0]); }
    owner[i] = cells.get(key);
    const sum = sums[owner[i]];
    for (let k = 0; k < 3; k++) sum[k] += vertices[3 * i + k];
    sum[3] += 1;
  }
  const kept = [], known = new Set();
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [owner[faces[f]], owner[faces[f + 1]], owner[faces[f + 2]]];
    if (a === b || b === c || c === a) continue;
    const key = a < b && a < c ? `${a},${b},${c}` : b < c ? `${b},${c},${a}` : `${c},${a},${b}`;
    if (known.has(key)) continue;
    known.add(key);
    kept.push(a, b, c);
  }
  return { vertices: Float32Array.from(sums.flatMap(([x, y, z, n]) => [x / n, y / n, z / n])), faces: Uint32Array.from(kept) };
}

/** The bounding box of a solid in its own frame; empty for half-spaces and point clouds. */
function shapeBox(shape) {
  const box = new THREE.Box3(), around = (x, y, z) => box.set(new THREE.Vector3(-x, -y, -z), new THREE.Vector3(x, y, z));
  switch (shape.kind) {
    case "box": return around(...shape.size.map((v) => v / 2));
    case "sphere": return around(shape.radius, shape.radius, shape.radius);
    case "cylinder": return around(shape.radius, shape.radius, shape.length / 2);
    case "capsule": return around(shape.radius, shape.radius, shape.length / 2 + shape.radius);
    case "mesh": return box.setFromArray(meshArrays(shape).vertices);
    default: return box;
  }
}

/** For each vertex the first one at its position. */
function weld(vertices) {
  const known = new Map(), first = new Uint32Array(vertices.length / 3);
  for (let i = 0; i < first.length; i++) {
    const key = `${vertices[3 * i]},${vertices[3 * i + 1]},${vertices[3 * i + 2]}`, other = known.get(key);
    if (other === undefined) known.set(key, i);
    first[i] = other ?? i;
  }
  return first;
}

/** The corners of faces by vertex: those of vertex v are `corners` from `starts[v]` to `starts[v + 1]`. */
function cornersAround(owners, count) {
  const starts = new Uint32Array(count + 1), corners = new Uint32Array(owners.length);
  for (const v of owners) starts[v + 1] += 1;
  for (let v = 0; v < count; v++) starts[v + 1] += starts[v];
  const next = starts.slice();
  owners.forEach((v, corner) => { corners[next[v]++] = corner; });
  return { starts, corners };
}

/** Edges are shaded sharp if faces meet at more than 35 degrees, smooth otherwise. */
function mesh(vertices, faces) {
  const normals = new Float32Array(3 * faces.length), positions = new Float32Array(3 * faces.length);
  const flat = new Float32Array(faces.length), area = new Float32Array(faces.length);
  for (let f = 0; f < faces.length; f += 3) {
    for (let k = 0; k < 3; k++) positions.set(vertices.subarray(3 * faces[f + k], 3 * faces[f + k] + 3), 3 * (f + k));
    const [ax, ay, az, bx, by, bz, cx, cy, cz] = positions.subarray(3 * f, 3 * f + 9);
    const u = [bx - ax, by - ay, bz - az], v = [cx - ax, cy - ay, cz - az];
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n) || 1;
    for (let i = 0; i < 3; i++) { area[f + i] = n[i]; flat[f + i] = n[i] / length; }
  }
  const first = weld(vertices), owners = faces.map((v) => first[v]), { starts, corners } = cornersAround(owners, first.length);
  const limit = Math.cos((35 * Math.PI) / 180);
  for (let corner = 0; corner < faces.length; corner++) {
    const own = corner - (corner % 3), sum = [0, 0, 0];
    for (let j = starts[owners[corner]]; j < starts[owners[corner] + 1]; j++) {
      const g = corners[j] - (corners[j] % 3), alike = flat[own] * flat[g] + flat[own + 1] * flat[g + 1] + flat[own + 2] * flat[g + 2];
      if (alike >= limit || g === own) for (let i = 0; i < 3; i++) sum[i] += area[g + i];
    }
    const length = Math.hypot(...sum) || 1;
    for (let i = 0; i < 3; i++) normals[3 * corner + i] = sum[i] / length;
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

/** Converts an sRGB color for a renderer with linear colors. */
function light(rgb) {
  return new THREE.Color(rgb[0], rgb[1], rgb[2]).convertSRGBToLinear();
}

/** Transparent where it faces the viewer, opaque toward its outline, so that nested round shapes remain readable. */
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
