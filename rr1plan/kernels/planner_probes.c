// Entries for tests: single steps of the planners' loops.

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
