// The configuration space as a torus: the square rolled up, with its images, path and configuration.

const RING = 1, TUBE = 0.48; // radii of the torus

/** The point of the torus at shares of both axes, offset from its surface. */
function onTorus([u, v], lift = 0) {
  const a = 2 * Math.PI * u, b = 2 * Math.PI * v, r = RING + (TUBE + lift) * Math.cos(b);
  return new viewer.THREE.Vector3(r * Math.cos(a), r * Math.sin(a), (TUBE + lift) * Math.sin(b));
}

class TorusView {
  constructor(lesson, plot) {
    const { THREE } = viewer;
    this.lesson = lesson;
    this.canvas = element("canvas", undefined, "torus");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.setAttribute("aria-label", "Configuration space as a torus: drag or arrow keys turn it, a click moves the arm");
    plot.append(this.canvas);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.1, 20);
    this.scene = new THREE.Scene();
    this.turn = [-0.9, 0.85]; // azimuth and elevation of the eye [rad]
    this.texture = new THREE.CanvasTexture(lesson.chart.area);
    this.texture.encoding = THREE.sRGBEncoding;
    this.mesh = new THREE.Mesh(this.surface(), new THREE.MeshLambertMaterial({ map: this.texture }));
    this.lamp = new THREE.DirectionalLight(0xffffff, 0.5);
    this.scene.add(this.mesh, this.seams(), this.lamp, new THREE.AmbientLight(0xffffff, 0.56));
    this.moving = new THREE.Group();
    this.scene.add(this.moving);
    this.wire();
    this.onChange = () => this.ask();
    viewer.on("change", this.onChange);
    this.paint();
  }

  surface() {
    const { THREE } = viewer, n = 96, m = 64, points = [], places = [], index = [];
    for (let i = 0; i <= n; i++) {
      for (let j = 0; j <= m; j++) {
        points.push(...onTorus([i / n, j / m]).toArray());
        places.push(i / n, j / m);
      }
    }
    for (let i = 0; i < n; i++) {
      for (let j = 0; j < m; j++) {
        const a = i * (m + 1) + j, b = a + m + 1;
        index.push(a, b, a + 1, b, b + 1, a + 1);
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute(places, 2));
    geometry.setIndex(index);
    geometry.computeVertexNormals();
    return geometry;
  }

  /** The edges of the square, which are two circles here. */
  seams() {
    const { THREE } = viewer, group = new THREE.Group();
    for (const of of [(t) => [t, 0], (t) => [0, t]]) {
      const points = Array.from({ length: 129 }, (_, k) => onTorus(of(k / 128), 0.006));
      const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineDashedMaterial({ color: INK, dashSize: 0.07, gapSize: 0.05 }));
      line.computeLineDistances();
      group.add(line);
    }
    return group;
  }

  wire() {
    const { canvas } = this;
    let last = null, moved = 0;
    canvas.addEventListener("pointerdown", (event) => {
      last = [event.clientX, event.clientY];
      moved = 0;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
      moved += Math.hypot(dx, dy);
      last = [event.clientX, event.clientY];
      this.rotate(-0.008 * dx, 0.008 * dy);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (last && moved < 4) this.click(event);
      last = null;
    });
    canvas.addEventListener("pointercancel", () => { last = null; });
  }

  rotate(around, above) {
    this.turn = [this.turn[0] + around, clamp(this.turn[1] + above, -1.5, 1.5)];
    this.ask();
  }

  /** Moves the arm to the configuration under the pointer. */
  click(event) {
    const { THREE } = viewer, box = this.canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height), this.camera);
    const [hit] = ray.intersectObject(this.mesh);
    if (hit) this.lesson.pose([value(0, hit.uv.x), value(1, hit.uv.y)]);
  }

  /** Redraws the texture, then the picture. */
  paint() {
    // A picture of another size needs a new texture.
    if (this.size !== this.lesson.chart.area.width) this.texture.dispose();
    this.size = this.lesson.chart.area.width;
    this.texture.needsUpdate = true;
    this.ask();
  }

  ask() {
    this.asked ||= requestAnimationFrame(() => { this.asked = 0; this.draw(); });
  }

  draw() {
    const { THREE } = viewer, { lesson, moving } = this, size = this.canvas.clientWidth, high = this.canvas.clientHeight;
    if (!size || !high) return;
    this.renderer.setPixelRatio(lesson.chart.ratio);
    this.renderer.setSize(size, high, false);
    this.camera.aspect = size / high;
    this.camera.up.set(0, 0, 1);
    const [a, b] = this.turn;
    this.camera.position.set(Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.sin(b)).multiplyScalar(5.9);
    this.camera.lookAt(0, 0, 0);
    this.lamp.position.copy(this.camera.position).add(new THREE.Vector3(0, 0, 3));
    this.camera.updateProjectionMatrix();
    for (const old of [...moving.children]) {
      old.geometry.dispose();
      old.material.dispose();
      moving.remove(old);
    }
    if (lesson.curve.length > 1) {
      const curve = new THREE.CatmullRomCurve3(lesson.curve.filter((_, k) => k % 4 === 0 || k === lesson.curve.length - 1).map((at) => onTorus(at, 0.012)));
      moving.add(new THREE.Mesh(new THREE.TubeGeometry(curve, 300, 0.016, 6), new THREE.MeshBasicMaterial({ color: new THREE.Color(ACCENT).convertSRGBToLinear() })));
    }
    const ball = (at, radius, color) => {
      const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), new THREE.MeshBasicMaterial({ color: new THREE.Color(color).convertSRGBToLinear() }));
      mesh.position.copy(onTorus(at, 0.035));
      moving.add(mesh);
    };
    for (const goal of data.goals) ball(lesson.chart.shares(goal), 0.06, GOAL);
    if (data.start) ball(lesson.chart.shares(data.start), 0.06, START);
    ball(lesson.chart.shares(q2()), 0.072, ACCENT);
    this.renderer.render(this.scene, this.camera);
  }

  dispose() {
    cancelAnimationFrame(this.asked);
    viewer.listeners.change.splice(viewer.listeners.change.indexOf(this.onChange), 1);
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.texture.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }
}
