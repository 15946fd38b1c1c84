// Maps that prove two bodies apart from the one or two columns of q that move them relative to each other.
//
// A map has a cell for each small rectangle of those columns' values; in a free cell the pair keeps its padding. Maps
// store counts: entry (x, y) is the number of cells below x and y that are not free, so that four entries determine
// whether a rectangle of cells is free (a summed-area table: Crow, 1984).
#include "scene_tables.h"

// First and last cell of a column of q along a side, between two times of the edge. Returns 0 if it leaves the map.
INLINE int cells_between(const double *curve, int64_t nq, int64_t column, double t0, double t1, double low,
                         double per_unit, int64_t *first, int64_t *last) {
    double c0 = curve[column], c1 = curve[nq + column], c2 = curve[2 * nq + column];
    double a = c0 + t0 * (c1 + t0 * c2), b = c0 + t1 * (c1 + t1 * c2);
    // Largest deviation of a parabola from the straight line between its ends.
    double aside = 0.25 * (t1 - t0) * (t1 - t0) * abs_number(c2);
    double from = (min_number(a, b) - aside - low) * per_unit, to = (max_number(a, b) + aside - low) * per_unit;
    // These comparisons are also false for NaN; conversion rounds down, because neither is negative.
    if (!(from >= 0.0 && to < (double)MAP_CELLS)) return 0;
    *first = (int64_t)from;
    *last = (int64_t)to;
    return 1;
}

// 1 if a map over the columns of a body pair proves its pairs free between two times of the edge.
static int map_is_free(int64_t map, int64_t body_pair, double t0, double t1, const SceneTables *scene,
                       const Scratch *scratch) {
    const BodyPair *of = &scene->pairs->body_pairs[body_pair];
    const MapRange *range = &scene->pairs->map_ranges[body_pair];
    int64_t nq = scene->column_count, width = of->width, x0, x1, y0 = 0, y1 = 0;
    if (!cells_between(scratch->curve, nq, of->column, t0, t1, range->low, range->per_unit, &x0, &x1))
        return 0;
    if (width > 1 &&
        !cells_between(scratch->curve, nq, of->column2, t0, t1, range->low2, range->per_unit2, &y0, &y1))
        return 0;
    const int16_t *low = scene->pairs->maps + map + x0 * (width + 1);
    const int16_t *high = scene->pairs->maps + map + (x1 + 1) * (width + 1);
    return high[y1 + 1] - high[y0] - low[y1 + 1] + low[y0] == 0;
}

// The given lanes in which no map proves a body pair free.
static uint64_t lanes_not_mapped(int64_t body_pair, uint64_t lanes, const SceneTables *scene,
                                 const Scratch *scratch) {
    int64_t map = scene->pairs->body_pairs[body_pair].map;
    if (map < 0) return lanes;
    for (uint64_t left = lanes; left; left &= left - 1) {
        int64_t i = first_bit(left);
        double t = scratch->middles[i], h = scratch->halves[i];
        if (map_is_free(map, body_pair, t - h, t + h, scene, scratch)) lanes &= ~((uint64_t)1 << i);
    }
    return lanes;
}
