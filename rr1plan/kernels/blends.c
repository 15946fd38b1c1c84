// Parabolic blends of polylines, and their time-optimal parameterization.
//
// Around a corner p with unit directions d0 and d1 the polyline is replaced, from r before p to r behind it, by the
// parabola p - r d0 + s d0 + s^2 (d1 - d0) / (4 r), 0 <= s <= 2 r.
#include "path_curve.h"

// A grid is fine enough if a grid twice as coarse costs less than MIN_REFINEMENT_GAIN of the time, the looseness is
// below MAX_LOOSENESS, velocity exceeds its limits by less than MAX_OVERRUN, and it has enough intervals to decide the
// first of these.
#define MIN_REFINEMENT_GAIN 0.0015
#define MAX_LOOSENESS 0.004
#define MAX_OVERRUN 0.001
enum { MIN_GRID = 32, REFINEMENTS = 6 };

// Unit direction from a to b, shape (nq,). Returns their distance.
static double unit_direction(const double *a, const double *b, int64_t nq, double *unit) {
    double square = 0.0;
    for (int64_t j = 0; j < nq; j++) {
        unit[j] = b[j] - a[j];
        square += unit[j] * unit[j];
    }
    double length = sqrt_number(square);
    for (int64_t j = 0; j < nq; j++) unit[j] /= length;
    return length;
}

// Largest blend size of each waypoint, the distance before and behind it, shape (count,); 0 at both ends, and for a
// stop. Returns the length of the polyline.
//
// Consecutive waypoints are distinct. The motion stops where it reverses: the sum of both unit directions is shorter
// than `reversal`. Blends below a fraction `smallest` of the whole length are dropped.
EXPORT double rr1_largest_blends(const double *points, int64_t count, int64_t nq, double max_size, double reversal,
                                 double smallest, double *sizes) {
    double before[nq], behind[nq], total = 0.0;
    for (int64_t i = 0; i + 1 < count; i++) total += unit_direction(points + i * nq, points + (i + 1) * nq, nq, behind);
    sizes[0] = sizes[count - 1] = 0.0;
    if (count < 3) return total;
    double length_before = unit_direction(points, points + nq, nq, before);
    for (int64_t i = 1; i + 1 < count; i++) {
        double length_behind = unit_direction(points + i * nq, points + (i + 1) * nq, nq, behind), square = 0.0;
        for (int64_t j = 0; j < nq; j++) square += (before[j] + behind[j]) * (before[j] + behind[j]);
        double size = min_number(max_size, 0.5 * min_number(length_before, length_behind));
        sizes[i] = sqrt_number(square) >= reversal && size >= smallest * total ? size : 0.0;
        length_before = length_behind;
        for (int64_t j = 0; j < nq; j++) before[j] = behind[j];
    }
    return total;
}

// The parabola at a corner between two unit directions, shape (3, nq).
static void write_blend(const double *corner, const double *before, const double *behind, double size, int64_t nq,
                        double *out) {
    for (int64_t j = 0; j < nq; j++) {
        out[j] = corner[j] - size * before[j];
        out[nq + j] = before[j];
        out[2 * nq + j] = (behind[j] - before[j]) / (4.0 * size);
    }
}

// The blend of a size at the second of three waypoints, shape (3, nq).
EXPORT void rr1_blend(const double *points, int64_t nq, double size, double *out) {
    double before[nq], behind[nq];
    unit_direction(points, points + nq, nq, before);
    unit_direction(points + nq, points + 2 * nq, nq, behind);
    write_blend(points + nq, before, behind, size, nq, out);
}

// Write the pieces of a rounded polyline. Returns their number.
//
// `sizes`: blend size of each waypoint, 0 for a stop. The remainder of an edge is dropped if it is below a fraction
// `tolerance` of the edge. Writes `lengths`, shape (2 count,), `coefficients`, shape (2 count, 3, nq), and `before`,
// the number of pieces before the blend of each waypoint, shape (count,).
EXPORT int64_t rr1_round_corners(const double *points, const double *sizes, int64_t count, int64_t nq, double tolerance,
                                 double *lengths, double *coefficients, int64_t *before) {
    double unit[nq], next[nq];
    int64_t pieces = 0;
    before[0] = 0;
    if (count < 2) return 0;
    double edge = unit_direction(points, points + nq, nq, unit), next_edge = 0.0;
    for (int64_t i = 0; i + 1 < count; i++) {
        const double *corner = points + (i + 1) * nq;
        double line = edge - sizes[i] - sizes[i + 1];
        if (line > tolerance * edge) {
            double *piece = coefficients + pieces * 3 * nq;
            lengths[pieces++] = line;
            for (int64_t j = 0; j < nq; j++) {
                piece[j] = points[i * nq + j] + sizes[i] * unit[j];
                piece[nq + j] = unit[j];
                piece[2 * nq + j] = 0.0;
            }
        }
        before[i + 1] = pieces;
        if (i + 2 == count) break;
        next_edge = unit_direction(corner, corner + nq, nq, next);
        if (sizes[i + 1] > 0.0) {
            double *piece = coefficients + pieces * 3 * nq;
            lengths[pieces++] = 2.0 * sizes[i + 1];
            write_blend(corner, unit, next, sizes[i + 1], nq, piece);
        }
        edge = next_edge;
        for (int64_t j = 0; j < nq; j++) unit[j] = next[j];
    }
    return pieces;
}

// Time from one waypoint to another with a stop at each waypoint in between, in closed form.
static double stopping_duration(const double *points, int64_t first, int64_t last, int64_t nq,
                                const RateLimits *limits) {
    double unit[nq], total = 0.0;
    for (int64_t i = first; i < last; i++) {
        double length = unit_direction(points + i * nq, points + (i + 1) * nq, nq, unit);
        double speed = INFINITY, pull = INFINITY;
        for (int64_t j = 0; j < nq; j++) {
            if (unit[j] == 0.0) continue;
            speed = min_number(speed, limits->velocity[j] / abs_number(unit[j]));
            pull = min_number(pull, limits->acceleration[j] / abs_number(unit[j]));
        }
        double peak = min_number(speed, sqrt_number(pull * length));
        total += length / peak + peak / pull;
    }
    return total;
}

// Time-optimal motion along a curve from rest to rest, in memory of the arena. Returns 0 if the arena is used up.
//
// The grid is halved until the gain is negligible, some joint is close to a limit nearly always, and velocity exceeds
// its limits only slightly between constrained points. The motion is then stretched to satisfy the limits.
static int time_within(const PathCurve *curve, const RateLimits *limits, double step, Arena *arena, TimedPieces *timed) {
    int64_t nq = curve->column_count;
    Grid grid, fine;
    Speeds speeds;
    if (!make_grid(curve, limits, step, curve->lengths, arena, &grid)) return 0;
    if (!solve_grid(curve, &grid, limits, 0.0, arena, &speeds)) return 0;
    double factor = INFINITY;
    for (int left = REFINEMENTS; left > 0; left--) {
        int64_t count = grid.count;
        double before = speeds.duration;
        if (!halve_grid(curve, &grid, arena, &fine)) return 0;
        grid = fine;
        int straight = grid.count == count;
        if (!straight && !solve_grid(curve, &grid, limits, 0.0, arena, &speeds)) return 0;
        int is_fine = before <= speeds.duration * (1.0 + MIN_REFINEMENT_GAIN) && speeds.looseness <= MAX_LOOSENESS &&
                      grid.count >= MIN_GRID;
        if (!straight && left > 1 && !is_fine) continue;
        if (!time_curve(curve, &grid, limits, speeds.x, arena, timed)) return 0;
        factor = stretch_factor(timed, nq, limits);
        if (straight || factor <= 1.0 + MAX_OVERRUN) break;
    }
    if (factor > 1.0) {
        double power = 1.0;
        for (int64_t k = 0; k < 5; k++, power /= factor)
            for (int64_t i = 0; i < timed->count; i++)
                for (int64_t j = 0; j < nq; j++) timed->coefficients[(i * 5 + k) * nq + j] *= power;
        for (int64_t i = 0; i < timed->count; i++) timed->durations[i] *= factor;
    }
    return 1;
}

// Append the pieces of one motion to another. Returns 0 if the capacity is exceeded.
static int append_pieces(TimedPieces *all, const TimedPieces *more, int64_t nq) {
    if (all->count + more->count > all->capacity) return 0;
    for (int64_t i = 0; i < more->count; i++) all->durations[all->count + i] = more->durations[i];
    double *end = all->coefficients + all->count * 5 * nq;
    for (int64_t i = 0; i < more->count * 5 * nq; i++) end[i] = more->coefficients[i];
    all->count += more->count;
    return 1;
}

static double total_duration(const TimedPieces *timed) {
    double total = 0.0;
    for (int64_t i = 0; i < timed->count; i++) total += timed->durations[i];
    return total;
}

// Time-optimal motion along a rounded polyline, shape (count, nq), with stops at corners without a blend.
//
// If rounded corners are slower than a stop at each of them, the motion stops there. `sizes` and `tolerance`: see
// rr1_round_corners; `step`: see make_grid. `timed` gets the pieces. Returns TIMED_BENT if some piece is a parabola in
// joint space, else TIMED_STRAIGHT; ARENA_FULL if the arena or `timed` is too small; or -3 - k if no speed is feasible
// before waypoint k.
EXPORT int64_t rr1_time_polyline(const double *points, const double *sizes, int64_t count, int64_t nq,
                                 const RateLimits *limits, double step, double tolerance, Arena *arena,
                                 TimedPieces *timed) {
    arena->used = 0;
    timed->count = 0;
    double *lengths = arena_take(arena, 2 * count), *coefficients = arena_take(arena, 6 * count * nq);
    int64_t *before = (int64_t *)arena_take(arena, count);
    if (!lengths || !coefficients || !before) return ARENA_FULL;
    rr1_round_corners(points, sizes, count, nq, tolerance, lengths, coefficients, before);
    int64_t mark = arena->used, first = 0;
    int bent = TIMED_STRAIGHT;
    TimedPieces some;
    for (int64_t last = 1; last < count; last++) {
        if (sizes[last] > 0.0) continue;
        if (last - first > 1) {
            int64_t begin = before[first];
            PathCurve curve = {lengths + begin, coefficients + begin * 3 * nq, before[last] - begin, nq};
            arena->used = mark;
            if (!time_within(&curve, limits, step, arena, &some)) return ARENA_FULL;
            if (total_duration(&some) <= stopping_duration(points, first, last, nq, limits)) {
                if (!append_pieces(timed, &some, nq)) return ARENA_FULL;
                bent = TIMED_BENT;
                first = last;
            }
        }
        for (; first < last; first++) {
            double length[4], line[12 * nq], no_blends[2] = {0.0, 0.0};
            int64_t ends[2];
            int64_t pieces = rr1_round_corners(points + first * nq, no_blends, 2, nq, tolerance, length, line, ends);
            PathCurve curve = {length, line, pieces, nq};
            arena->used = mark;
            if (!time_within(&curve, limits, step, arena, &some)) return ARENA_FULL;
            if (!(total_duration(&some) < INFINITY)) return -3 - (first + 1);
            if (!append_pieces(timed, &some, nq)) return ARENA_FULL;
        }
    }
    return bent;
}
