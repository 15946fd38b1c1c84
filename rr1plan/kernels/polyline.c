// Corners of polylines: points that are neither duplicates nor on the line between others.

// Length of a polyline, shape (count, nq).
EXPORT double rr1_polyline_length(const double *points, int64_t count, int64_t nq) {
    double length = 0.0;
    for (int64_t i = 0; i + 1 < count; i++) length += row_distance(points + i * nq, points + (i + 1) * nq, nq);
    return length;
}

// Whether the points between two points are on the line from one to the other, in this order.
static int is_straight(const double *points, int64_t nq, const int64_t *index, int64_t first, int64_t last,
                       double tolerance) {
    const double *a = points + index[first] * nq, *b = points + index[last] * nq;
    double length = row_distance(a, b, nq), before = 0.0;
    if (length < tolerance) return 0;
    for (int64_t i = first + 1; i < last; i++) {
        const double *point = points + index[i] * nq;
        double along = 0.0, square = 0.0;
        for (int64_t j = 0; j < nq; j++) along += (point[j] - a[j]) * (b[j] - a[j]) / length;
        for (int64_t j = 0; j < nq; j++) {
            double off = point[j] - a[j] - along * (b[j] - a[j]) / length;
            square += off * off;
        }
        if (along <= before || square > tolerance * tolerance) return 0;
        before = along;
    }
    return before < length;
}

// Write the indices of ends and corners of a polyline, shape (count, nq), to `index`, ascending. Returns their number.
//
// Points closer together than the tolerance, and points this close to a straight line, are dropped. The first and the
// last point are kept; only the first one if all points coincide. `index` has room for `count`.
EXPORT int64_t rr1_find_corners(const double *points, int64_t count, int64_t nq, double tolerance, int64_t *index) {
    int64_t size = 1, kept = 1;
    index[0] = 0;
    for (int64_t i = 1; i < count; i++)
        if (row_distance(points + index[size - 1] * nq, points + i * nq, nq) >= tolerance) index[size++] = i;
    if (size > 1) index[size - 1] = count - 1;
    for (int64_t last = 0; last < size - 1;) {
        int64_t end = last + 1;
        while (end + 1 < size && is_straight(points, nq, index, last, end + 1, tolerance)) end++;
        index[kept++] = index[end];  // does not overwrite unread entries: kept <= end
        last = end;
    }
    return kept;
}
