// Connected cells of a grid: components of free space on the torus, and positions of names within images.

/**
 * Numbers the components of nonzero cells, connected across periodic axes: {labels, count}; 0 marks zero cells.
 * diagonal: cells that share a corner are connected, too, not only those that share an edge.
 */
function labelComponents(cells, [n, m], periodic, diagonal = false) {
  const labels = new Int32Array(n * m), parents = [0], reach = diagonal ? 1 : 0;
  const root = (k) => {
    while (parents[k] !== k) k = parents[k] = parents[parents[k]];
    return k;
  };
  const join = (a, b) => {
    [a, b] = [root(a), root(b)];
    if (a !== b) parents[Math.max(a, b)] = Math.min(a, b);
  };
  // Runs of cells along the second axis: row after row their begins, ends and numbers.
  const rows = [];
  for (let i = 0; i < n; i++) {
    const runs = [];
    for (let j = 0, at = i * m; j < m;) {
      if (!cells[at + j]) { j += 1; continue; }
      const begin = j, run = parents.length;
      while (j < m && cells[at + j]) j += 1;
      parents.push(run);
      labels.fill(run, at + begin, at + j);
      runs.push([begin, j, run]);
    }
    const last = runs[runs.length - 1];
    if (periodic[1] && runs.length > 1 && runs[0][0] === 0 && last[1] === m) join(runs[0][2], last[2]);
    if (i > 0) joinRows(rows[i - 1], runs);
    rows.push(runs);
  }
  function joinRows(one, two) {
    for (let a = 0, b = 0; a < one.length && b < two.length;) {
      const [begin, end, run] = one[a], [from, to, other] = two[b];
      if (begin < to + reach && from < end + reach) join(run, other);
      if (end < to) a += 1; else b += 1;
    }
    if (!diagonal || !periodic[1] || !one.length || !two.length) return;
    const [first, last] = [one, two].map((runs) => runs[0]), [head, tail] = [one, two].map((runs) => runs[runs.length - 1]);
    if (first[0] === 0 && tail[1] === m) join(first[2], tail[2]);
    if (last[0] === 0 && head[1] === m) join(last[2], head[2]);
  }
  if (periodic[0] && n > 1) joinRows(rows[n - 1], rows[0]);
  const numbers = new Int32Array(parents.length);
  let count = 0;
  for (let k = 1; k < parents.length; k++) if (parents[k] === k) numbers[k] = ++count;
  for (let k = 1; k < parents.length; k++) numbers[k] = numbers[root(k)];
  for (let c = 0; c < labels.length; c++) labels[c] = numbers[labels[c]];
  return { labels, count };
}

/** Labels in the order of their colors: those of given cells first, then by size. */
function rankedComponents({ labels, count }, firsts) {
  const sizes = new Int32Array(count + 1), ranks = new Uint8Array(count + 1), out = new Uint8Array(labels.length);
  for (let c = 0; c < labels.length; c++) sizes[labels[c]] += 1;
  const bySize = Array.from({ length: count }, (_, k) => k + 1).sort((a, b) => sizes[b] - sizes[a] || a - b);
  const order = [...new Set([...firsts.map((cell) => (cell < 0 ? 0 : labels[cell])), ...bySize])].filter((label) => label > 0);
  order.forEach((label, k) => { ranks[label] = Math.min(k + 1, 255); });
  for (let c = 0; c < labels.length; c++) out[c] = ranks[labels[c]];
  return out;
}

const COARSE_CELLS = 90; // along each axis, for names

/** The center of the widest part of an image without overlap: [u, v], or null if there is no room for a name. */
function widestSpot(bits, [n, m], layer, periodic) {
  const [a, b] = [n, m].map((size) => Math.min(size, COARSE_CELLS)), far = new Float32Array(a * b), room = 0.02 * Math.max(a, b);
  for (let i = 0; i < a; i++) {
    for (let j = 0; j < b; j++) far[i * b + j] = bits[Math.floor(((i + 0.5) * n) / a) * m + Math.floor(((j + 0.5) * m) / b)] === 1 << layer ? 1e6 : 0;
  }
  // Distances to the outside by two sweeps, repeated for periodic axes (Borgefors 1986).
  const at = (i, j) => {
    if (periodic[0]) i = (i + a) % a;
    if (periodic[1]) j = (j + b) % b;
    return i < 0 || j < 0 || i >= a || j >= b ? 0 : far[i * b + j];
  };
  const steps = [[-1, 0, 1], [0, -1, 1], [-1, -1, Math.SQRT2], [-1, 1, Math.SQRT2]];
  for (let round = 0; round < 2; round++) {
    for (const sign of [1, -1]) {
      for (let c = 0; c < a * b; c++) {
        const cell = sign > 0 ? c : a * b - 1 - c;
        if (far[cell] <= 1) continue;
        const i = Math.floor(cell / b), j = cell % b;
        for (const [di, dj, step] of steps) far[cell] = Math.min(far[cell], at(i + sign * di, j + sign * dj) + step);
      }
    }
  }
  let best = -1;
  const rim = Math.round(0.07 * a);
  for (let i = rim; i < a - rim; i++) for (let j = 2; j < b - 2; j++) if (best < 0 || far[i * b + j] > far[best]) best = i * b + j;
  return far[best] > room ? [(Math.floor(best / b) + 0.5) / a, ((best % b) + 0.5) / b] : null;
}
