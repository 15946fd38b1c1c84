// Meshcat's viewer with floor, lights and camera. In the world z is up.

/** Converts a point of the world (z up) to coordinates of three.js' camera (y up). */
function cameraPoint(x, y, z) {
  return new THREE.Vector3(x, z, -y);
}

/** The middle of the box around balls [x, y, z, radius]. */
function middleOf(balls) {
  return new THREE.Box3().setFromPoints(balls.map(([x, y, z]) => new THREE.Vector3(x, y, z))).getCenter(new THREE.Vector3());
}

/** The corners of a box as balls without a radius. */
function cornersOf(box) {
  const { min, max } = box, of = (i, axis) => (i & (1 << "xyz".indexOf(axis)) ? max : min)[axis];
  return box.isEmpty() ? [] : [...Array(8).keys()].map((i) => [of(i, "x"), of(i, "y"), of(i, "z"), 0]);
}

/** A room of soft lamps: their positions, and the walls between them. */
const LAMPS = [
  { color: 0xffffff, size: [9, 9], place: [0, 12, 0] },
  { color: 0xfff1e0, size: [4, 8], place: [11, 4, 5] },
  { color: 0xe4eeff, size: [4, 8], place: [-11, 5, -4] },
];
const LAMP_LIGHT = 2.2, WALLS = 0x4b4f54;

/**
 * The diffuse light of the room for all surface directions, in spherical harmonics. An environment map would also add
 * reflections, which are hardly visible on matte surfaces and take more than a second without a graphics card.
 */
function roomLight() {
  const sh = new THREE.SphericalHarmonics3(), basis = new Float64Array(9), color = new THREE.Color(), count = 4000;
  const lamps = LAMPS.map(({ color: c, size, place }) => {
    const lamp = new THREE.Object3D();
    lamp.position.set(...place);
    lamp.lookAt(0, 0, 0);
    lamp.updateMatrixWorld();
    return { size, color: new THREE.Color(c).multiplyScalar(LAMP_LIGHT), inverse: lamp.matrixWorld.clone().invert() };
  });
  const wall = new THREE.Color(WALLS), d = new THREE.Vector3(), eye = new THREE.Vector3(), hit = new THREE.Vector3();
  for (let i = 0; i < count; i++) {
    const y = 1 - (2 * i + 1) / count, r = Math.sqrt(1 - y * y), turn = i * Math.PI * (3 - Math.sqrt(5));
    d.set(r * Math.cos(turn), y, r * Math.sin(turn));
    color.copy(wall);
    for (const lamp of lamps) {
      // In the frame of a lamp its surface is at z = 0.
      eye.set(0, 0, 0).applyMatrix4(lamp.inverse);
      hit.copy(d).transformDirection(lamp.inverse);
      const far = -eye.z / hit.z, x = eye.x + far * hit.x, across = eye.y + far * hit.y;
      if (far > 0 && Math.abs(x) < lamp.size[0] / 2 && Math.abs(across) < lamp.size[1] / 2) color.copy(lamp.color);
    }
    THREE.SphericalHarmonics3.getBasisAt(d, basis);
    basis.forEach((value, k) => { sh.coefficients[k].x += color.r * value; sh.coefficients[k].y += color.g * value; sh.coefficients[k].z += color.b * value; });
  }
  return sh.scale((4 * Math.PI) / count);
}

class Stage {
  constructor(pane) {
    this.pane = pane;
    const canSwitch = typeof WebGL2RenderingContext !== "undefined"; // else the canvas itself has to be multisampled
    const renderer = new THREE.WebGLRenderer({ antialias: !canSwitch, alpha: true });
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    renderer.outputEncoding = THREE.sRGBEncoding;
    renderer.info.autoReset = false; // it counts whole pictures, which may take several renderings
    this.multisampling = renderer.capabilities.isWebGL2 ? new Multisampling(renderer) : null;
    this.meshcat = new MeshCat.Viewer(pane, false, renderer);
    this.quality = FEW_ARMS[0];
    pane.appendChild(renderer.domElement);
    this.renderer = renderer;
    const lost = pictureNote(
      "The browser has stopped the 3-D view",
      "If it does not come back, close other pages with 3-D views and reload this one.",
    );
    const setLost = (on) => {
      document.body.classList.toggle("no-webgl", on);
      renderer.domElement.hidden = on;
      if (on) pane.append(lost); else lost.remove();
    };
    renderer.domElement.addEventListener("webglcontextlost", () => setLost(true));
    renderer.domElement.addEventListener("webglcontextrestored", () => {
      setLost(false);
      renderer.shadowMap.needsUpdate = true; // else all is in the shadow of an empty map
      this.meshcat.set_dirty();
    });
    this.meshcat.set_3d_pane_size = () => this.resize();
    for (const path of [["Lights"], ["Grid"], ["Axes"]]) this.meshcat.delete_path(path);
    this.meshcat.set_property(["Background"], "visible", false);
    this.meshcat.hide_background();
    this.addCamera();
    this.addLights();
    onResize(pane, () => { this.resize(); if (!this.turned && this.onResize) this.onResize(); });
    this.fitLens();
  }

  addCamera() {
    this.camera = new THREE.PerspectiveCamera(34, 1, 0.01, 200);
    this.meshcat.controls.dispose();
    this.meshcat.set_object(["Cameras", "default", "rotated"], this.camera);
    this.meshcat.set_camera(this.camera);
    this.controls = this.meshcat.controls;
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.maxPolarAngle = Math.PI * 0.98;
    this.count = 1;
    this.shifts = [[0, 0]];
    this.turned = false;
    this.controls.addEventListener("start", () => { this.dragged = this.turned = true; });
    this.controls.addEventListener("end", () => { this.dragged = false; });
  }

  addLights() {
    const lights = new THREE.Group();
    this.key = new THREE.DirectionalLight(0xfff8f0, 0.76);
    this.key.castShadow = true;
    this.key.shadow.mapSize.set(2048, 2048);
    this.key.shadow.radius = 3.2;
    this.key.shadow.normalBias = 0.012;
    this.key.shadow.bias = -0.0004;
    const fill = new THREE.DirectionalLight(0xdfeaff, 0.16);
    fill.position.set(3, 4, 2);
    lights.add(new THREE.LightProbe(roomLight(), 0.85), this.key, this.key.target, fill, new THREE.HemisphereLight(0xffffff, 0xb9c0c9, 0.12));
    this.meshcat.set_object(["rr1plan", "lights"], lights);
  }

  /** Puts floor, shadow and light around a box of the world. */
  furnish(box, floor) {
    const center = box.getCenter(new THREE.Vector3()), radius = box.getSize(new THREE.Vector3()).length() / 2 || 1;
    this.key.target.position.copy(center);
    this.key.position.copy(center).add(new THREE.Vector3(-0.55, -0.75, 1.5).multiplyScalar(2.2 * radius));
    const lens = this.key.shadow.camera;
    Object.assign(lens, { left: -1.35 * radius, right: 1.35 * radius, top: 1.35 * radius, bottom: -1.35 * radius, near: 0.1 * radius, far: 8 * radius });
    lens.updateProjectionMatrix();
    this.key.shadow.normalBias = 0.006 * radius;
    this.meshcat.set_object(["rr1plan", "floor"], this.floor(center, radius, floor));
    // Shadows depend on the radius set above.
    this.apply(this.quality);
  }

  floor(center, radius, height) {
    const group = new THREE.Group();
    const size = 14 * radius, slope = (center.z - height) / 1.5;
    // No larger than the lamp's picture on the floor, because each of its pixels costs a shadow lookup.
    const reach = 2 * 1.35 * Math.SQRT2 * Math.hypot(0.55, 0.75, 1.5) / 1.5 * radius;
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(reach, reach), new THREE.ShadowMaterial({ opacity: 0.24 }));
    shade.position.set(0.55 * slope, 0.75 * slope, 0);
    shade.receiveShadow = true;
    shade.material.depthWrite = false;
    this.shade = shade;
    const step = 10 ** Math.floor(Math.log10(radius * 0.5));
    const grid = new THREE.Mesh(new THREE.PlaneGeometry(size, size), new THREE.ShaderMaterial({
      transparent: true, depthWrite: false, side: THREE.DoubleSide,
      extensions: { derivatives: true },
      uniforms: { step: { value: step }, reach: { value: 4.2 * radius }, center: { value: new THREE.Vector2(center.x, center.y) } },
      vertexShader: `
        varying vec2 place; uniform vec2 center;
        void main() { place = position.xy + center; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
      fragmentShader: `
        varying vec2 place; uniform float step; uniform float reach; uniform vec2 center;
        float lines(float gap) {
          vec2 at = place / gap;
          vec2 wide = fwidth(at);
          vec2 near = abs(fract(at - 0.5) - 0.5) / max(wide, vec2(1e-6));
          float line = 1.0 - min(min(near.x, near.y), 1.0);
          return line * clamp(1.0 - 2.2 * max(wide.x, wide.y), 0.0, 1.0);
        }
        void main() {
          float fade = 1.0 - smoothstep(0.15, 1.0, length(place - center) / reach);
          float ink = max(0.10 * lines(step), 0.24 * lines(step * 10.0)) * fade;
          gl_FragColor = vec4(0.33, 0.38, 0.45, ink);
        }`,
    }));
    group.add(shade, grid);
    group.position.set(center.x, center.y, height - 0.001 * radius);
    shade.renderOrder = 1;
    grid.renderOrder = 0;
    return group;
  }

  /**
   * Frames balls [x, y, z, radius] from a world direction, so that all are visible next to the cards. The camera is on
   * the line through the target, or through the center of all balls; a lens shift moves the picture to its place.
   */
  look(balls, direction, target = null) {
    const d = new THREE.Vector3(...direction).normalize();
    const eye = cameraPoint(d.x, d.y, d.z), up = Math.abs(d.z) > 0.999 ? cameraPoint(0, 1, 0) : new THREE.Vector3(0, 1, 0);
    const right = new THREE.Vector3().crossVectors(up, eye).normalize(), above = new THREE.Vector3().crossVectors(eye, right);
    const middle = target ? new THREE.Vector3(...target) : middleOf(balls);
    const center = cameraPoint(middle.x, middle.y, middle.z);
    const local = balls.map(([x, y, z, r]) => {
      const c = cameraPoint(x, y, z).sub(center);
      return [c.dot(right), c.dot(above), c.dot(eye), r];
    });
    // Half of a tile as tangents of angles, and the extent of the balls in it from a distance.
    const tall = Math.tan((this.camera.fov * Math.PI) / 360), [{ width, height }] = this.tiles(), wide = (tall * width) / height;
    const seen = (distance) => {
      const window = [Infinity, -Infinity, Infinity, -Infinity];
      for (const [x, y, depth, r] of local) {
        const far = distance - depth;
        window[0] = Math.min(window[0], (x - r) / far / wide);
        window[1] = Math.max(window[1], (x + r) / far / wide);
        window[2] = Math.min(window[2], (y - r) / far / tall);
        window[3] = Math.max(window[3], (y + r) / far / tall);
      }
      return window;
    };
    const nearest = local.reduce((most, [, , depth, r]) => Math.max(most, depth + r), 0);
    const size = local.reduce((most, [x, y, depth, r]) => Math.max(most, Math.hypot(x, y, depth) + r), 0) || 1;
    const tiles = this.tiles().map((tile) => {
      let best = null;
      for (const room of this.rooms(tile)) {
        let near = nearest + 0.01 * size, far = nearest + 1000 * size;
        // Halved 24 times, the range is a millionth of the distance.
        for (let i = 0; i < 24; i++) {
          const distance = Math.sqrt((near - nearest) * (far - nearest)) + nearest, [x0, x1, y0, y1] = seen(distance);
          if (x1 - x0 < room.right - room.left && y1 - y0 < room.top - room.bottom) far = distance; else near = distance;
        }
        // A room in the middle may be a little smaller than one beside a card.
        const cost = far * (1 + 0.1 * Math.abs(room.left + room.right));
        if (!best || cost < best.cost) best = { distance: far, cost, room };
      }
      return best;
    });
    const distance = Math.max(...tiles.map((tile) => tile.distance)), [x0, x1, y0, y1] = seen(distance);
    this.shifts = this.shiftsIn(tiles.map(({ room }) => room), (x0 + x1) / 2, (y0 + y1) / 2);
    this.stopTurning();
    this.controls.target.copy(center);
    this.camera.position.copy(center).addScaledVector(eye, distance);
    this.camera.near = distance / 200;
    this.camera.far = distance * 60;
    this.turned = false;
    this.fitLens();
    this.controls.update();
    this.meshcat.set_dirty();
  }

  /** Ends a damped rotation, the rest of which would move the camera from where it is put now. */
  stopTurning() {
    this.controls.enableDamping = false;
    this.controls.update();
    this.controls.enableDamping = true;
  }

  /** Shift that centers a point of the picture in a free area of each tile; equal heights in a row of tiles, equal sides in a column. */
  shiftsIn(rooms, x, y) {
    const stacked = this.tiles().some(({ top }) => top > 0), all = {
      left: Math.max(...rooms.map(({ left }) => left)), right: Math.min(...rooms.map(({ right }) => right)),
      bottom: Math.max(...rooms.map(({ bottom }) => bottom)), top: Math.min(...rooms.map(({ top }) => top)),
    };
    return rooms.map((room) => {
      const across = stacked ? all : room, up = stacked ? room : all;
      return [x - (across.left + across.right) / 2, y - (up.bottom + up.top) / 2];
    });
  }

  /** The tiles of the picture [px]: one, or several in a row, or in a column in a tall window. */
  tiles() {
    const width = this.pane.clientWidth || 1, height = this.pane.clientHeight || 1, { count } = this, tall = height > width;
    const cut = (length, k) => Math.round((k * length) / count);
    return Array.from({ length: count }, (_, k) => (tall ? { left: 0, top: cut(height, k), width, height: cut(height, k + 1) - cut(height, k) }
      : { left: cut(width, k), top: 0, width: cut(width, k + 1) - cut(width, k), height }));
  }

  /**
   * Moves the picture in its tile without changing the perspective. The camera covers the whole window, of which only
   * the tile is drawn, so code that maps pointer positions only needs the first tile.
   */
  fitLens(k = 0) {
    const { left, top, width, height } = this.tiles()[k], [x, y] = this.shifts[k];
    this.camera.aspect = width / height;
    this.camera.setViewOffset(width, height, (x * width) / 2 - left, (-y * height) / 2 - top, this.pane.clientWidth || 1, this.pane.clientHeight || 1);
    this.camera.updateProjectionMatrix();
  }

  /** Direction from the target to the camera, in the world. */
  direction() {
    return worldPoint(this.camera.position.clone().sub(this.controls.target)).toArray();
  }

  /** Parts of a tile not covered by cards, from -1 to 1 each way: next to each card, or above or below it, or all if these are too narrow. */
  rooms(tile) {
    const pane = this.pane.getBoundingClientRect(), large = magnification(), gap = 14 * large, label = this.count > 1 ? 34 * large : 0; // [px] margin; height of a name
    const left = pane.left + tile.left, top = pane.top + tile.top, right = left + tile.width, bottom = top + tile.height;
    const areColorsForced = matchMedia("(forced-colors: active)").matches; // then nothing has a shadow
    const covered = (node) => {
      const box = node.getBoundingClientRect(), card = areColorsForced || getComputedStyle(node).boxShadow !== "none";
      const inside = box.left < right && box.right > left && box.top < bottom && box.bottom > top;
      return box.width && card && inside ? box : null;
    };
    const [side, bar, ...others] = ["side", "bar", "plots", "editing"].map((id) => covered(find(id)));
    // Without a time line the bar is a few buttons in the corner.
    const isCorner = bar && find("bar").classList.contains("still"), below = isCorner ? others : [bar, ...others];
    const heads = [...document.querySelectorAll("#headline, .readout")].map(covered).filter(Boolean);
    const head = heads.length ? { right: Math.max(...heads.map((box) => box.right)), bottom: Math.max(...heads.map((box) => box.bottom)) } : null;
    const phase = [...document.querySelectorAll(".phase")].map(covered)[0];
    const x = (at) => (2 * (clamp(at, left + gap, right - gap) - left)) / tile.width - 1;
    const y = (at) => 1 - (2 * (clamp(at, top + gap, bottom - gap) - top)) / tile.height;
    const whole = { left: x(left), right: x(right), bottom: y(Math.min(bottom, ...below.filter(Boolean).map((box) => box.top)) - gap - label), top: y(top) };
    const choices = [
      side ? [{ right: x(side.left - gap) }, { top: y(side.bottom + gap) }] : [{}],
      head ? [{ left: x(head.right + gap) }, { top: y(head.bottom + gap) }] : [{}],
      phase ? [{ left: x(phase.right + gap) }, { bottom: y(phase.top - gap) }] : [{}],
      isCorner ? [{ right: x(bar.left - gap) }, { bottom: y(bar.top - gap) }] : [{}],
    ];
    const part = (one, two) => ({
      left: Math.max(one.left, two.left ?? -1), right: Math.min(one.right, two.right ?? 1),
      bottom: Math.max(one.bottom, two.bottom ?? -1), top: Math.min(one.top, two.top ?? 1),
    });
    const rooms = choices.reduce((found, others) => found.flatMap((one) => others.map((two) => part(one, two))), [whole]);
    const wide = rooms.filter((r) => r.right - r.left > 0.4 && r.top - r.bottom > 0.3);
    return wide.length ? wide : [part(whole, choices[0][0])];
  }

  resize() {
    this.fitLens();
    this.fitPicture();
    this.meshcat.set_dirty();
  }

  /** Sets the resolution of the picture from the window and the quality; a change reallocates its memory. */
  fitPicture() {
    const width = this.pane.clientWidth || 1, height = this.pane.clientHeight || 1, ratio = fineness() * this.quality.pixels;
    const { x, y } = this.renderer.getSize(new THREE.Vector2());
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    if (x !== width || y !== height) this.renderer.setSize(width, height);
  }

  /** Applies a quality level of `pace.js`. */
  setQuality(quality) {
    if (quality !== this.quality) this.apply(quality);
  }

  apply(quality) {
    this.quality = quality;
    const { renderer, meshcat } = this;
    renderer.shadowMap.autoUpdate = quality.shadows === "moving";
    if (this.shade) this.shade.visible = quality.shadows !== "none";
    this.fitPicture();
    meshcat.set_dirty();
  }

  show(name, group) {
    this.meshcat.set_object(["rr1plan", name], group);
    this.meshcat.set_dirty();
  }

  draw() {
    this.controls.update();
    if (!this.meshcat.needs_render || this.renderer.getContext().isContextLost()) return;
    if (this.onDraw) this.onDraw();
    this.renderer.info.reset();
    if (this.count === 1) this.paint(() => this.meshcat.render()); else this.drawTiles();
  }

  /** Calls render() such that edges are as smooth as the quality says. */
  paint(render) {
    if (this.multisampling && this.quality.smooth) this.multisampling.draw(render); else render();
  }

  /** Draws all tiles, the first one last, so that its content remains visible in the world. */
  drawTiles() {
    const { renderer, meshcat, camera } = this, tiles = this.tiles(), all = this.pane.clientHeight;
    renderer.setScissorTest(true);
    for (let k = tiles.length - 1; k >= 0; k--) {
      const { left, top, width, height } = tiles[k];
      this.onTile(k);
      this.fitLens(k);
      renderer.setScissor(left, all - top - height, width, height);
      this.paint(() => renderer.render(meshcat.scene, camera));
    }
    renderer.setScissorTest(false);
    meshcat.needs_render = false;
  }
}

/** A note in place of the picture: why there is none, and what to try. */
function pictureNote(title, advice) {
  const note = element("div", undefined, "note");
  note.id = "note";
  note.setAttribute("role", "alert");
  note.append(element("h2", title), element("p", "The clock, the joint values, the report and the panels work without it."), element("p", advice));
  return note;
}

/** The stage for a browser without WebGL: a note in place of the picture. Everything that needs no picture still works. */
class EmptyStage {
  constructor(pane) {
    document.body.classList.add("no-webgl");
    pane.replaceChildren(pictureNote(
      "No 3-D view: this browser has no WebGL",
      "For the 3-D view turn on hardware acceleration in the browser’s settings, or open the page in another browser.",
    ));
    // Panels may register listeners here, which are never called, because nothing is drawn.
    this.pane = element("div");
    this.meshcat = { set_dirty: () => {} };
    this.camera = new THREE.PerspectiveCamera(34, 1, 0.01, 200);
    this.controls = { target: new THREE.Vector3() };
    this.key = { intensity: 0 };
    this.quality = FEW_ARMS[0];
    this.turned = false;
  }

  look() {}
  furnish() {}
  show() {}
  setQuality() {}
  draw() {}
}

/** The stage in a pane, an empty one if three.js cannot draw. */
function makeStage(pane) {
  try {
    return new Stage(pane);
  } catch (error) {
    console.warn(`no 3-D view: ${error.message}`);
    return new EmptyStage(pane);
  }
}
