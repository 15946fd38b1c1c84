// Times at which an agent passes the gridpoints of its curve when it moves from rest at one of them to rest at another.
#include "path_curve.h"

// Times from 0 at the gridpoints from `first` to `last` of a grid, for the fastest motion from rest to rest, stretched
// to keep its limits between gridpoints too. Returns 0 if the arena is used up. A single interval is split into two.
static int time_span(const PathCurve *curve, const Grid *grid, int64_t first, int64_t last, const RateLimits *limits,
                     Arena *arena, double *times) {
    int64_t nq = curve->column_count, count = last - first;
    double half = 0.5 * grid->delta[first], offsets[2] = {grid->offset[first], grid->offset[first] + half};
    double halves[2] = {half, half};
    int64_t pieces[2] = {grid->piece[first], grid->piece[first]};
    Grid span = {grid->piece + first, grid->offset + first, grid->delta + first, count};
    if (count == 1) span = (Grid){pieces, offsets, halves, 2};
    Speeds speeds;
    if (!solve_grid(curve, &span, limits, 0.0, arena, &speeds)) return 0;
    double *durations = arena_take(arena, span.count), *coefficients = arena_take(arena, span.count * 5 * nq);
    if (!durations || !coefficients) return 0;
    rr1_time_intervals(curve, span.piece, span.offset, span.delta, speeds.x, span.count, durations, coefficients);
    TimedPieces timed = {durations, coefficients, span.count, span.count};
    double stretch = stretch_factor(&timed, nq, limits), now = 0.0;
    times[0] = 0.0;
    for (int64_t i = 0; i < span.count; i++) {
        now += durations[i];
        if (count > 1) times[i + 1] = now * stretch;
    }
    if (count == 1) times[1] = now * stretch;
    return 1;
}

// Times from 0 of hops between gridpoints begins[h] < ends[h]: row h of `times`, shape (hops, gridpoints), has them in
// the columns of the hop's gridpoints. The motion stops where `halts`, shape (gridpoints,), is 1. Returns 0, or
// ARENA_FULL.
EXPORT int64_t rr1_time_hops(const PathCurve *curve, const RateLimits *limits, int64_t *piece, double *offset,
                             double *delta, int64_t count, const int64_t *halts, const int64_t *begins,
                             const int64_t *ends, int64_t hop_count, Arena *arena, double *times) {
    Grid grid = {piece, offset, delta, count};
    for (int64_t h = 0; h < hop_count; h++) {
        double *row = times + h * (count + 1), before = 0.0;
        int64_t first = begins[h];
        row[first] = 0.0;
        while (first < ends[h]) {
            int64_t last = first + 1;
            while (last < ends[h] && !halts[last]) last++;
            arena->used = 0;
            if (!time_span(curve, &grid, first, last, limits, arena, row + first)) return ARENA_FULL;
            for (int64_t k = first; k <= last; k++) row[k] += before;
            before = row[last];
            first = last;
        }
    }
    return 0;
}

// Approximate duration of a motion along a rounded polyline, shape (count, nq), with stops at corners without a blend;
// below 0 if the arena is used up. Each line and each blend is divided into `intervals`. `sizes` and `tolerance`: see
// rr1_round_corners.
EXPORT double rr1_rounded_duration(const double *points, const double *sizes, int64_t count, int64_t nq,
                                    const RateLimits *limits, int64_t intervals, double tolerance, Arena *arena) {
    arena->used = 0;
    double *lengths = arena_take(arena, 2 * count), *coefficients = arena_take(arena, 6 * count * nq);
    double *times = arena_take(arena, 2 * count * intervals + 1);
    int64_t *before = (int64_t *)arena_take(arena, count);
    Grid grid;
    if (!lengths || !coefficients || !times || !before || !take_grid(arena, 2 * count * intervals, &grid)) return -1.0;
    int64_t pieces = rr1_round_corners(points, sizes, count, nq, tolerance, lengths, coefficients, before);
    PathCurve curve = {lengths, coefficients, pieces, nq};
    for (int64_t k = 0; k < pieces * intervals; k++) {
        int64_t piece = k / intervals;
        double delta = lengths[piece] / (double)intervals;
        grid.piece[k] = piece;
        grid.offset[k] = (double)(k - piece * intervals) * delta;
        grid.delta[k] = delta;
    }
    int64_t mark = arena->used, first = 0;
    double total = 0.0;
    for (int64_t i = 1; i < count; i++) {
        if (sizes[i] > 0.0) continue;
        int64_t last = before[i] * intervals;
        arena->used = mark;
        if (!time_span(&curve, &grid, first, last, limits, arena, times)) return -1.0;
        total += times[last - first];
        first = last;
    }
    return total;
}
