// Entries for tests: single steps of the loops of planners and of the path parameterization.

EXPORT int64_t rr1_solve_cholesky(double *h, double *x, int64_t n) { return solve_cholesky(h, x, n, n); }

EXPORT int64_t rr1_nearest_vertex(const Trees *trees, int64_t side, const double *q, double max_length,
                                  const double *turns, double *distance) {
    const Tree *tree = &trees->sides[side];
    return nearest_vertex(tree, tree->size, q, trees->column_count, trees->capacity, max_length, turns, distance);
}

EXPORT int64_t rr1_draw_in_ellipsoid(const Trees *trees, int64_t goal, double bound, uint64_t *random,
                                     const double *lower, const double *extent, const double *turns, double *q) {
    SampleBox box = {lower, extent, turns, trees->column_count};
    return draw_in_ellipsoid(trees, goal, bound, random, &box, q);
}

EXPORT double rr1_escape_sample(const Trees *trees, int64_t side, int64_t index, double step, uint64_t *random,
                                const double *lower, const double *extent, const double *turns, double *q) {
    SampleBox box = {lower, extent, turns, trees->column_count};
    return escape_sample(&trees->sides[side], trees->capacity, index, step, random, &box, q);
}

EXPORT int64_t rr1_find_neighbors(const RoadmapGraph *graph, int64_t count, const double *q, int64_t max_count,
                                  double *squares, int64_t *nearest, double *distances) {
    return find_neighbors(graph, count, q, max_count, squares, nearest, distances);
}

EXPORT int64_t rr1_draw_index(uint64_t *state, int64_t count) { return draw_index(state, count); }

EXPORT void rr1_draw_in_box(uint64_t *state, const double *lower, const double *extent, int64_t nq, double *q) {
    draw_in_box(state, lower, extent, nq, q);
}

// The error at q, shape (6,), and its Jacobian by column of q, shape (nq, 6). Returns the number of its entries in use.
EXPORT int64_t rr1_chain_jacobian(const Chain *chain, const IkTarget *target, const double *q, int64_t nq,
                                  double error[6], double (*jacobian)[6]) {
    Pose poses[chain->joint_count + 1];
    ik_error(chain, target, q, poses, error);
    return ik_jacobian(chain, target, poses, error, nq, jacobian);
}

EXPORT double rr1_highest_speed(const double *alpha, const double *beta, int64_t count, double high) {
    return highest_speed(alpha, beta, count, 0.0, high);
}

EXPORT double rr1_next_speed(const double *alpha, const double *beta, int64_t count, double x, double high) {
    return next_speed(alpha, beta, count, x, high);
}

// Rows of an interval of a curve with one piece, shape (ROWS(nq),) each; see `fill_rows`.
EXPORT void rr1_fill_rows(const PathCurve *curve, double offset, double delta, const RateLimits *limits, double *alpha,
                          double *beta) {
    fill_rows(curve->coefficients, curve->column_count, offset, delta, limits, alpha, beta);
}
