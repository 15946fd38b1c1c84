// The picture of a configuration space: cells as smooth areas, a square whose opposite edges are identified, axes.
// Positions are shares (u, v) of the two axes, 0 to 1, v upwards.

const PARTS = ["#cfe0fb", "#cdeedb", "#fde3c8", "#e6dbf7", "#fbd7e4", "#dfe8b8", "#c9ecee", "#efdfcf"];
const CRUMBS = "#e6e9ee", START = "#2f66c8", GOAL = "#14855a";

/** Patterns, so that no reader depends on colors: the inked part of a tile, x and y in 0..1, y downwards; the first is plain. */
const LINE = 0.15, falls = (x, y) => (x - y + 1) % 1 < LINE, rises = (x, y) => (x + y) % 1 < LINE;
const PATTERNS = [
  () => false, (x, y) => Math.hypot(x - 0.5, y - 0.5) < 0.2, falls, (_, y) => y < LINE, (x) => x < LINE,
  (x, y) => falls(x, y) || rises(x, y), (x, y) => x < LINE || y < LINE,
];
const TILE = 9; // [px of the window]
const FAINT = 0.5; // of the ink, on free space, where trees and paths are drawn

const rgb = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
/** Whether dark text is more readable than white text on a color. */
const isLight = (color) => { const [r, g, b] = rgb(color); return 0.299 * r + 0.587 * g + 0.114 * b > 150; };
/** The color of a pattern's ink on a background color, all [r, g, b]. */
const inked = (color, share = 1) => color.map((v, k) => v + share * (isLight(hex(color)) ? 0.3 * (rgb(INK)[k] - v) : 0.38 * (255 - v)));
const hex = (color) => `#${color.map((v) => Math.round(v).toString(16).padStart(2, "0")).join("")}`;
/** The pixels of a tile of a pattern: 1 where it is inked. */
const tileOf = (pattern, size) => Uint8Array.from({ length: size * size }, (_, i) => Number(PATTERNS[pattern](((i % size) + 0.5) / size, (Math.floor(i / size) + 0.5) / size)));

/** The patterns of some layers, by their order among the obstacles; self-collision and joint limits are plain. */
function patternsOf(layers) {
  let things = 0;
  return layers.map(({ kind }) => (kind === "self" || kind === "limits" ? 0 : things++ % PATTERNS.length));
}

/** A background for a swatch of a legend: a color with its pattern, as in the picture. */
const patterned = (color, pattern) => `center / 6px url(${patternTile(color, pattern, 6).toDataURL()}) ${color}`;

/** A tile of a color with its pattern, as a canvas of some pixels. */
function patternTile(color, pattern, size) {
  const canvas = element("canvas"), pen = canvas.getContext("2d"), tile = tileOf(pattern, size);
  canvas.width = canvas.height = size;
  tile.forEach((ink, i) => {
    pen.fillStyle = ink ? hex(inked(rgb(color))) : color;
    pen.fillRect(i % size, Math.floor(i / size), 1, 1);
  });
  return canvas;
}

const LONGEST_NAME = 28; // [characters]
/** A name as written in a picture; legends and messages have it in full. */
const pictureName = (name) => (name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 1)}…` : name);

const modulo = (value, size) => ((value % size) + size) % size;
const bytes = (packed) => new Uint8Array(viewer.unpack(packed).values.buffer);

class Cells {
  constructor() {
    [this.n, this.m] = data.size;
    this.bits = new Uint32Array(this.n * this.m);
    data.layers.forEach((layer, k) => {
      const packed = bytes(layer.cells);
      for (let c = 0; c < this.bits.length; c++) if ((packed[c >> 3] >> (c & 7)) & 1) this.bits[c] |= 1 << k;
    });
    this.labels = bytes(data.labels);
  }

  /** The layers with an image, as bits. */
  used() {
    const { bits } = this;
    let used = 0;
    for (let c = 0; c < bits.length; c++) used |= bits[c];
    return used;
  }

  /** The cell at a position, or -1 outside the picture. */
  at(u, v) {
    const i = cellOn(0, u, this.n), j = cellOn(1, v, this.m);
    return i < 0 || j < 0 ? -1 : i * this.m + j;
  }

  /** The layers that block a point: {free, edge, outside, layers}; edge: a neighboring cell differs. */
  answer(u, v) {
    const cell = this.at(u, v);
    if (cell < 0) return { free: false, edge: false, outside: true, layers: [] };
    let bits = this.bits[cell], edge = false;
    for (const [du, dv] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      const next = this.at(u + du / this.n, v + dv / this.m);
      if (next >= 0 && !this.bits[next] !== !this.bits[cell]) { edge = true; bits |= this.bits[next]; }
    }
    return { free: !this.bits[cell], edge, outside: false, layers: data.layers.filter((_, k) => (bits >>> k) & 1), part: this.labels[cell] };
  }

  /** The cells as a picture of size by size pixels: areas with smooth rims, overlaps striped; only: the layer shown in full. */
  paint(size, ratio, tinted, only) {
    const { n, m, bits, labels } = this, key = `${size} ${ratio} ${tinted} ${only}`;
    const [rangeX, rangeY] = !tinted && this.painted && this.painted.key === key ? this.changed(size) : [[0, size], [0, size]];
    const image = this.painted && this.painted.image.width === size ? this.painted.image : new ImageData(size, size);
    this.painted = { key, image, bits: bits.slice() };
    const out = new Uint32Array(image.data.buffer);
    const colors = data.layers.map((layer) => rgb(layer.color)), parts = [...PARTS.map(rgb), rgb(CRUMBS)], white = [255, 255, 255];
    // Plain and inked colors of each layer and component.
    const shades = colors.map((color) => [color, inked(color)]), tints = parts.map((color) => [color, inked(color, FAINT)]);
    const wide = Math.round(TILE * ratio), tiles = PATTERNS.map((_, k) => tileOf(k, wide));
    const layerTiles = patternsOf(data.layers).map((k) => tiles[k]), partTiles = parts.map((_, k) => tiles[k < PARTS.length ? k % tiles.length : 0]);
    const columns = lookup(size, n, data.periodic[0]), rows = lookup(size, m, data.periodic[1]);
    const sharp = size / Math.max(n, m), band = Math.max(2, Math.round(5 * ratio));
    /** Color of a pixel that a layer covers partly, blended with the color of free space. */
    const mixed = (under, layer, cover, ink) => {
      const over = shades[layer] ? shades[layer][ink] : under;
      return word(under[0] + cover * (over[0] - under[0]), under[1] + cover * (over[1] - under[1]), under[2] + cover * (over[2] - under[2]));
    };
    /** The layer shown at a pixel of an overlap. */
    const striped = (full, count, x, y) => {
      let turn = Math.floor((x + y) / band) % count, k = 0;
      for (; !((full >>> k) & 1 && turn-- === 0); k++);
      return k;
    };
    const shown = (full, best, cover, under, x, y, spot) => {
      let layer = best;
      const count = bitCount(full);
      if (count > 1) { layer = striped(full, count, x, y); cover = 1; }
      if (only >= 0) { if ((full >>> only) & 1) layer = only; if (layer !== only) cover *= 0.16; }
      // Overlaps have distinct stripes.
      return mixed(under, layer, cover, count > 1 ? 0 : layerTiles[layer] ? layerTiles[layer][spot] : 0);
    };
    const free = tints.map((both) => both.map((color) => word(...color))), plain = word(...white);
    const alone = shades.map((_, k) => layerTiles[k].reduce((both, ink, spot) => { both[ink] = shown(1 << k, k, 1, white, 0, 0, spot); return both; }, []));
    for (let y = size - rangeY[1]; y < size - rangeY[0]; y++) {
      const row = size - 1 - y, j0 = rows.low[row], j1 = rows.high[row], fj = rows.part[row], jn = rows.near[row];
      for (let x = rangeX[0]; x < rangeX[1]; x++) {
        const i0 = columns.low[x] * m, i1 = columns.high[x] * m, a = bits[i0 + j0], b = bits[i1 + j0], c = bits[i0 + j1], d = bits[i1 + j1];
        const any = a | b | c | d, at = y * size + x, spot = (y % wide) * wide + (x % wide);
        let under = white, ground = plain;
        if (tinted) {
          // Near a boundary the nearest cell may be blocked; then its free neighbor determines the color.
          const label = labels[columns.near[x] * m + jn] || labels[i0 + j0] || labels[i1 + j0] || labels[i0 + j1] || labels[i1 + j1];
          if (label) {
            const part = label > PARTS.length ? PARTS.length : label - 1, ink = partTiles[part][spot];
            under = tints[part][ink];
            ground = free[part][ink];
          }
        }
        if (!any) {
          out[at] = ground;
        } else if (a === b && a === c && a === d) {
          const layer = 31 - Math.clz32(any);
          out[at] = (any & (any - 1)) === 0 && (under === white || only < 0) ? alone[layer][layerTiles[layer][spot]] : shown(any, layer, 1, under, x, y, spot);
        } else {
          const fi = columns.part[x];
          let full = 0, cover = 0, best = 0;
          for (let k = 0; k < colors.length; k++) {
            if (!((any >>> k) & 1)) continue;
            const value = (1 - fj) * ((1 - fi) * ((a >>> k) & 1) + fi * ((b >>> k) & 1)) + fj * ((1 - fi) * ((c >>> k) & 1) + fi * ((d >>> k) & 1));
            const inside = Math.min(Math.max((value - 0.5) * sharp + 0.5, 0), 1);
            if (inside >= 0.5) full |= 1 << k;
            if (inside > cover) { cover = inside; best = k; }
          }
          out[at] = shown(full, best, cover, under, x, y, spot);
        }
      }
    }
    return image;
  }

  /** The range of pixels along both axes that may differ from the previous picture. */
  changed(size) {
    const { n, m, bits, painted } = this, low = [n, m], high = [-1, -1];
    for (let i = 0, c = 0; i < n; i++) {
      for (let j = 0; j < m; j++, c++) {
        if (bits[c] === painted.bits[c]) continue;
        if (i < low[0]) low[0] = i;
        if (i > high[0]) high[0] = i;
        if (j < low[1]) low[1] = j;
        if (j > high[1]) high[1] = j;
      }
    }
    return [n, m].map((count, axis) => {
      if (high[axis] < 0) return [0, 0];
      // A cell at an identified edge is drawn at the other edge, too.
      if (data.periodic[axis] && (low[axis] < 2 || high[axis] > count - 3)) return [0, size];
      const wide = size / count;
      return [Math.max(0, Math.floor((low[axis] - 1) * wide)), Math.min(size, Math.ceil((high[axis] + 2) * wide))];
    });
  }
}

/** A color as an opaque pixel in the memory of a picture (little endian). */
function word(red, green, blue) {
  return ((255 << 24) | (Math.round(blue) << 16) | (Math.round(green) << 8) | Math.round(red)) >>> 0;
}

function bitCount(bits) {
  let count = 0;
  for (; bits; bits &= bits - 1) count += 1;
  return count;
}

/** For each pixel of a row: the two cells it lies between, the fraction toward the second, and the nearest cell. */
function lookup(size, count, closes) {
  const of = (Numbers) => new Numbers(size), found = { low: of(Int32Array), high: of(Int32Array), part: of(Float64Array), near: of(Int32Array) };
  const place = (i) => (closes ? modulo(i, count) : clamp(i, 0, count - 1));
  for (let x = 0; x < size; x++) {
    const at = ((x + 0.5) / size) * count - 0.5, low = Math.floor(at);
    [found.low[x], found.high[x], found.part[x], found.near[x]] = [place(low), place(low + 1), at - low, place(Math.round(at))];
  }
  return found;
}

/** Edges as pieces [u0, v0, u1, v1] inside the square; one across a seam appears twice. */
function treePieces(tree) {
  const vertices = viewer.unpack(tree.vertices).values, edges = viewer.unpack(tree.edges).values;
  const pieces = [];
  for (let e = 0; e < edges.length; e += 2) {
    const ends = [edges[e], edges[e + 1]].map((k) => [share(0, vertices[2 * k]), share(1, vertices[2 * k + 1])]);
    pieces.push(wrappedCopies(ends));
  }
  return pieces;
}

/** Copies of a polyline, shifted by whole turns so that each part of it lies in the square once. */
function wrappedCopies(points) {
  const range = (axis) => {
    if (!data.periodic[axis]) return [0];
    const values = points.map((p) => p[axis]);
    const low = Math.floor(Math.min(...values)), high = Math.floor(Math.max(...values));
    return Array.from({ length: high - low + 1 }, (_, k) => low + k);
  };
  return range(0).flatMap((du) => range(1).map((dv) => points.map(([u, v]) => [u - du, v - dv])));
}

/** A position, and its copies just beyond edges that are identified with others. */
function copiesNear([u, v]) {
  const turns = (axis) => (data.periodic[axis] ? [-1, 0, 1] : [0]), isNear = (part) => part > -0.05 && part < 1.05;
  return turns(0).flatMap((du) => turns(1).map((dv) => [u + du, v + dv])).filter((at) => at.every(isNear));
}

/** Value of a joint as a share of its axis, and back. */
const share = (axis, value) => (value - data.low[axis]) / (data.high[axis] - data.low[axis]);
const value = (axis, part) => data.low[axis] + part * (data.high[axis] - data.low[axis]);

/** The step of a joint's slider: about half a degree or a round length. It divides the range, less what browsers round. */
function stepOf(low, high, straight) {
  const range = high - low || 1, step = straight ? 10 ** (Math.ceil(Math.log10(range)) - 3) : Math.PI / 360;
  return (range / Math.max(Math.round(range / step), 1)) * (1 - 1e-12);
}

/** The index of the cell at a share of an axis with `size` cells, or -1 outside; both ends are inside, up to rounding. */
function cellOn(axis, part, size) {
  const k = Math.floor(part * size);
  if (data.periodic[axis]) return modulo(k, size);
  return Math.abs(part - 0.5) < 0.5 + 1e-9 ? clamp(k, 0, size - 1) : -1;
}

/** A joint's value wrapped into the picture if its axis is periodic. */
function wrapped(axis, angle) {
  return data.periodic[axis] ? value(axis, modulo(share(axis, angle), 1)) : angle;
}

/** The unit of the axis of a joint and its scale, null for multiples of π; short travels in meters would have long numbers. */
function axisUnit(axis) {
  if (!data.joints[axis].straight) return eighthsOf(axis) ? null : { unit: "rad", scale: 1 };
  return data.high[axis] - data.low[axis] < 0.1 ? { unit: "mm", scale: 1000 } : { unit: "m", scale: 1 };
}

/** How many multiples of `eighths` π/8 are on an axis. */
function countMultiples(axis, eighths) {
  const [low, high] = [data.low[axis], data.high[axis]].map((v) => (8 * v) / (Math.PI * eighths));
  return Math.floor(high + 1e-6) - Math.ceil(low - 1e-6) + 1;
}

/** The eighths of π between marks of an axis, as in `cspace_torus.py`; 0 if its range is too short for three marks. */
function eighthsOf(axis) {
  let eighths = 4;
  while (countMultiples(axis, eighths) > 9) eighths *= 2;  // more marks would overlap
  while (countMultiples(axis, eighths) < 3 && eighths > 1) eighths /= 2;
  return countMultiples(axis, eighths) < 3 ? 0 : eighths;
}

/** π/8, π/4, 3π/8, ..., π, 3π/2, 2π, 2.5π. */
function multipleOfPi(eighths) {
  const parts = Math.abs(eighths), below = [1, 2, 4, 8].find((n) => Number.isInteger((parts * n) / 8));
  const above = (parts * below) / 8, text = above === 1 ? "π" : `${above}π`;
  return parts ? `${eighths < 0 ? "−" : ""}${below === 1 ? text : parts > 16 ? `${parts / 8}π` : `${text}/${below}`}` : "0";
}

/** Tick marks of an axis: multiples of π or of fractions of it for angles, otherwise round numbers: [share, text]. */
function ticks(axis) {
  const numbers = axisUnit(axis);
  if (numbers) {
    const { scale } = numbers;
    return niceTicks(scale * data.low[axis], scale * data.high[axis], 5).map((v) => [share(axis, v / scale), shortNumber(v)]);
  }
  const step = eighthsOf(axis), first = Math.ceil((8 * data.low[axis]) / (Math.PI * step) - 1e-6);
  return Array.from({ length: countMultiples(axis, step) }, (_, k) => step * (first + k)).map((k) => [share(axis, (k * Math.PI) / 8), multipleOfPi(k)]);
}

/** Position of the name of an axis, as a share of the axis: between the two marks around a given position. */
function betweenTicks(axis, place) {
  const shares = [0, ...ticks(axis).map(([part]) => part), 1];
  const above = shares.findIndex((part) => part > place);
  return (shares[above - 1] + shares[above]) / 2;
}

/** Axes, marks and edges around a plot; dashed edges with arrows are identified with the opposite edge. */
function drawFrame(pen, plot, unit) {
  const { x, y, size } = plot;
  pen.save();
  pen.fillStyle = SOFT;
  pen.strokeStyle = INK;
  pen.font = `${11.5 * unit}px ${FONT}`;
  for (const [part, text] of ticks(0)) {
    pen.textAlign = (1 - part) * size < 12 * unit ? "right" : "center";
    pen.fillText(text, x + part * size + (pen.textAlign === "right" ? 7 * unit : 0), y + size + 16 * unit);
  }
  const widest = Math.max(...ticks(1).map(([, text]) => pen.measureText(text).width));
  pen.font = `${11.5 * unit * Math.min((x - 9 * unit) / widest, 1)}px ${FONT}`; // long numbers are not cut, but smaller
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const [part, text] of ticks(1)) pen.fillText(text, x - 8 * unit, y + (1 - part) * size);
  pen.fillStyle = INK;
  pen.textAlign = "center";
  pen.textBaseline = "alphabetic";
  const unitOf = (axis) => (axisUnit(axis) ? `[${axisUnit(axis).unit}]` : ""), high = y + (1 - betweenTicks(1, 0.624)) * size + 4 * unit;
  pen.font = `600 ${(unitOf(0) ? 11 : 13) * unit}px ${FONT}`; // between two marks also in a small window
  pen.fillText(`${symbol(0)} ${unitOf(0)}`.trim(), x + betweenTicks(0, 0.625) * size, y + size + 18 * unit);
  pen.font = `600 ${13 * unit}px ${FONT}`;
  pen.fillText(symbol(1), x - 20 * unit, high);
  pen.fillText(unitOf(1), x - 20 * unit, high + 15 * unit);
  for (const axis of [0, 1]) {
    pen.setLineDash(data.periodic[axis] ? [6 * unit, 4 * unit] : []);
    pen.lineWidth = (data.periodic[axis] ? 1.6 : 1.1) * unit;
    for (const side of [0, size]) {
      pen.beginPath();
      if (axis === 0) { pen.moveTo(x + side, y); pen.lineTo(x + side, y + size); } else { pen.moveTo(x, y + side); pen.lineTo(x + size, y + side); }
      pen.stroke();
    }
  }
  pen.setLineDash([]);
  for (const side of [0, size]) {
    if (data.periodic[0]) arrows(pen, x + side, y + size * 0.375, 0, -1, 1, unit);
    if (data.periodic[1]) arrows(pen, x + size * 0.375, y + side, 1, 0, 2, unit);
  }
  pen.restore();
}

/** Marks as in topology: edges with the same number of arrows are identified. */
function arrows(pen, x, y, dx, dy, count, unit) {
  for (let k = 0; k < count; k++) {
    const at = (k - (count - 1) / 2) * 7 * unit, s = 5 * unit;
    const px = x + at * dx, py = y + at * dy;
    pen.fillStyle = INK;
    pen.beginPath();
    pen.moveTo(px + s * dx, py + s * dy);
    pen.lineTo(px - s * dx - s * dy, py - s * dy - s * dx);
    pen.lineTo(px - s * dx + s * dy, py - s * dy + s * dx);
    pen.closePath();
    pen.fill();
  }
}

const symbol = (axis) => data.joints[axis].symbol;
const reading = (axis, v) => viewer.jointText(data.columns[axis], v);
