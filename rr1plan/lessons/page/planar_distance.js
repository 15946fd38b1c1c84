// Distances in the plane: each body is the convex hull of a few points, widened by a radius.

/** Distance of a point from a segment. */
function toSegment(px, py, ax, ay, bx, by) {
  const dx = bx - ax, dy = by - ay, along = dx * dx + dy * dy;
  const t = along > 0 ? clamp(((px - ax) * dx + (py - ay) * dy) / along, 0, 1) : 0;
  return Math.hypot(px - ax - t * dx, py - ay - t * dy);
}

/** Distance of two segments, 0 if they cross. */
function betweenSegments(a, b, c, d) {
  const side = (p, q, r) => (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
  if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return 0;
  return Math.min(
    toSegment(...a, ...c, ...d), toSegment(...b, ...c, ...d), toSegment(...c, ...a, ...b), toSegment(...d, ...a, ...b),
  );
}

/** Distance of two outlines {points, radius} [m]; at most the sum of the radii below zero. */
function outlineDistance(one, two) {
  const a = one.points, b = two.points;
  let least = insidePolygon(a[0], b) || insidePolygon(b[0], a) ? 0 : Infinity;
  const edges = (points) => (points.length < 3 ? points.length - 1 || 1 : points.length);
  for (let i = 0; i < edges(a) && least > 0; i++) {
    for (let j = 0; j < edges(b); j++) {
      least = Math.min(least, betweenSegments(a[i], a[(i + 1) % a.length], b[j], b[(j + 1) % b.length]));
    }
  }
  return least - one.radius - two.radius;
}

/** An outline moved by a pose of 16 numbers, column-major; null does not move it. */
function movedOutline({ points, radius }, T) {
  return { radius, points: T ? points.map(([x, y]) => [T[0] * x + T[4] * y + T[12], T[1] * x + T[5] * y + T[13]]) : points };
}

/** Least distance of the parts of two elements at poses of links, {"arm/link": pose}. */
function elementDistance(a, b, poses, outlines) {
  let least = Infinity;
  for (const one of outlines[a]) for (const two of outlines[b]) {
    least = Math.min(least, outlineDistance(movedOutline(one, poses[a]), movedOutline(two, poses[b])));
  }
  return least;
}
