// The start and the goals of a query, and the straight lines between them.

INLINE int is_within(const double *lower, const double *upper, const double *q, int64_t nq) {
    int inside = 1;
    for (int64_t j = 0; j < nq; j++) inside = inside && lower[j] <= q[j] && q[j] <= upper[j];
    return inside;
}

// Insert row `last` into the rows before it, which are sorted by distance from the start.
static void sort_in(double *rows, int64_t last, const double *start, int64_t nq) {
    for (int64_t k = last; k > 0; k--) {
        double *before = rows + (k - 1) * nq, *after = rows + k * nq, squares[2] = {0.0, 0.0};
        for (int64_t j = 0; j < nq; j++) {
            squares[0] += (before[j] - start[j]) * (before[j] - start[j]);
            squares[1] += (after[j] - start[j]) * (after[j] - start[j]);
        }
        if (squares[0] <= squares[1]) return;
        for (int64_t j = 0; j < nq; j++) {
            double value = before[j];
            before[j] = after[j];
            after[j] = value;
        }
    }
}

// Check the start and the goals. Returns the number of valid goals, 0 if the start is invalid.
//
// `visible` becomes the first of the nearest STRAIGHT_LINES goals with a free straight line from the start, -1 if there
// is none. Bounds are infinite for joints that wrap. The first rows of `near` become the valid goals, nearest to the
// start first; of copies a whole turn apart, the nearest one. Shapes (nq,) and (goal_count, nq).
EXPORT int64_t rr1_check_endpoints(const double *start, const double *goals, int64_t goal_count, const double *lower,
                                   const double *upper, double *near, int64_t *visible, const SceneTables *scene,
                                   Scratch *scratch) {
    int64_t nq = scene->column_count, count = 0;
    *visible = -1;
    if (!is_within(lower, upper, start, nq) || rr1_certify_edge(scene, scratch, start, start) != EDGE_FREE) return 0;
    for (int64_t k = 0; k < goal_count; k++) {
        const double *goal = goals + k * nq;
        double *copy = near + count * nq;
        for (int64_t j = 0; j < nq; j++) {
            int wraps = upper[j] - lower[j] == INFINITY;
            copy[j] = wraps ? goal[j] + nearest_turns(start[j] - goal[j], WHOLE_TURN) : goal[j];
        }
        if (!is_within(lower, upper, goal, nq) || rr1_certify_edge(scene, scratch, copy, copy) != EDGE_FREE) continue;
        sort_in(near, count++, start, nq);
    }
    for (int64_t k = 0; k < count && k < STRAIGHT_LINES; k++) {
        if (rr1_certify_edge(scene, scratch, start, near + k * nq) != EDGE_FREE) continue;
        *visible = k;
        break;
    }
    return count;
}
