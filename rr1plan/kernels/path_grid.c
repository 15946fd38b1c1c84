// Adaptive grid on a curve of straight lines and parabolas.
//
// Under a velocity limit the squared path speed is the inverse square of the derivative in units of the limits. At a
// corner that almost reverses the motion, that derivative nearly vanishes and the speed has a sharp peak: the grid is
// dense there and coarse where the derivative is large.
#include "path_curve.h"

// Smaller derivatives, relative to the largest one on the piece, count as this fraction: little time is spent there.
#define DERIVATIVE_FLOOR 0.02
// Between two gridpoints the derivative changes by at most this fraction of itself, above that floor.
#define MAX_CHANGE 0.4
// Largest number of intervals of one piece.
enum { MAX_INTERVALS = 256 };

// Memory for `count` numbers from the arena, or 0 if it is used up.
static double *arena_take(Arena *arena, int64_t count) {
    if (count > arena->size - arena->used) return 0;
    double *taken = arena->memory + arena->used;
    arena->used += count;
    return taken;
}

// Intervals of a curve: piece, offset on the piece, and length of each.
typedef struct {
    int64_t *piece;
    double *offset;
    double *delta;
    int64_t count;
} Grid;

static int take_grid(Arena *arena, int64_t count, Grid *grid) {
    double *memory = arena_take(arena, 3 * count);
    if (!memory) return 0;
    *grid = (Grid){(int64_t *)(memory + 2 * count), memory, memory + count, count};
    return 1;
}

INLINE const double *piece_of(const PathCurve *curve, int64_t i) { return curve->coefficients + i * 3 * curve->column_count; }

// Whether a piece is a parabola.
INLINE int is_bent(const double *piece, int64_t nq) {
    double bend = 0.0;
    for (int64_t j = 0; j < nq; j++) bend = max_number(bend, abs_number(piece[2 * nq + j]));
    return bend > 0.0;
}

// Largest derivative at s in units of the limits, whose inverses are given.
static double derivative_at(const double *piece, int64_t nq, double s, const double *inverse) {
    double most = 0.0;
    for (int64_t j = 0; j < nq; j++)
        most = max_number(most, abs_number(piece[nq + j] + 2.0 * s * piece[2 * nq + j]) * inverse[j]);
    return most;
}

// Second derivative of a piece, in the same units.
static double second_derivative(const double *piece, int64_t nq, const double *inverse) {
    double most = 0.0;
    for (int64_t j = 0; j < nq; j++)
        most = max_number(most, 2.0 * abs_number(piece[2 * nq + j]) * inverse[j]);
    return most;
}

// Longest interval at s under one kind of limits; `most` is the largest derivative on the piece.
static double longest_interval(const double *piece, int64_t nq, double s, double step, double bend, double most,
                               const double *inverse) {
    if (bend == 0.0) return INFINITY;
    double size = max_number(derivative_at(piece, nq, s, inverse), DERIVATIVE_FLOOR * most);
    return min_number(step * sqrt_number(size * most), MAX_CHANGE * size) / bend;
}

// Write the offsets of the intervals of a piece, followed by the length of the piece. Returns the number of intervals.
static int64_t cut_piece(const double *piece, int64_t nq, double length, const RateLimits *limits, double step,
                         double longest, double cuts[MAX_INTERVALS + 1]) {
    const double *inverses[2] = {limits->inverse_velocity, limits->inverse_acceleration};
    double bends[2], peaks[2];
    for (int k = 0; k < 2; k++) {
        bends[k] = second_derivative(piece, nq, inverses[k]);
        double begin = derivative_at(piece, nq, 0.0, inverses[k]), end = derivative_at(piece, nq, length, inverses[k]);
        peaks[k] = max_number(begin, end);
    }
    int bent = is_bent(piece, nq);
    if (bent) longest = min_number(longest, 0.5 * length);
    int64_t count = 1;
    cuts[0] = 0.0;
    while (count < MAX_INTERVALS) {
        double s = cuts[count - 1], delta = longest;
        // Evaluated twice, the second time half an interval ahead, to account for the derivative there.
        for (int look = 0; look < (bent ? 2 : 0); look++) {
            double at = min_number(s + 0.5 * delta, length);
            for (int k = 0; k < 2; k++)
                delta = min_number(delta, longest_interval(piece, nq, at, step, bends[k], peaks[k], inverses[k]));
        }
        delta = max_number(delta, length / MAX_INTERVALS);
        if (s + delta >= length * (1.0 - 1e-9)) break;
        // The remainder becomes one interval, two equal ones, or more.
        cuts[count++] = s + min_number(delta, max_number(0.5 * (length - s), 0.5 * delta));
    }
    cuts[count] = length;
    return count;
}

// Compute the intervals of a curve. Returns 0 if the arena is used up.
//
// `step` is the largest change of the derivative in an interval, in units of the limits, relative to its largest value;
// `longest` is the longest interval of each piece. A parabola has at least two.
static int make_grid(const PathCurve *curve, const RateLimits *limits, double step, const double *longest, Arena *arena,
                     Grid *grid) {
    double cuts[MAX_INTERVALS + 1];
    int64_t count = 0, nq = curve->column_count;
    for (int64_t i = 0; i < curve->count; i++)
        count += cut_piece(piece_of(curve, i), nq, curve->lengths[i], limits, step, longest[i], cuts);
    if (!take_grid(arena, count, grid)) return 0;
    int64_t at = 0;
    for (int64_t i = 0; i < curve->count; i++) {
        int64_t intervals = cut_piece(piece_of(curve, i), nq, curve->lengths[i], limits, step, longest[i], cuts);
        for (int64_t k = 0; k < intervals; k++, at++) {
            grid->piece[at] = i;
            grid->offset[at] = cuts[k];
            grid->delta[at] = cuts[k + 1] - cuts[k];
        }
    }
    return 1;
}

// The grid with every interval on a parabola halved; straight lines are exact on any grid.
static int halve_grid(const PathCurve *curve, const Grid *coarse, Arena *arena, Grid *fine) {
    int64_t count = 0, at = 0, nq = curve->column_count;
    for (int64_t i = 0; i < coarse->count; i++) count += is_bent(piece_of(curve, coarse->piece[i]), nq) ? 2 : 1;
    if (!take_grid(arena, count, fine)) return 0;
    for (int64_t i = 0; i < coarse->count; i++) {
        int64_t parts = is_bent(piece_of(curve, coarse->piece[i]), nq) ? 2 : 1;
        for (int64_t k = 0; k < parts; k++, at++) {
            fine->piece[at] = coarse->piece[i];
            fine->delta[at] = coarse->delta[i] / (double)parts;
            fine->offset[at] = coarse->offset[i] + (double)k * fine->delta[at];
        }
    }
    return 1;
}

// Write the intervals of a curve: piece, offset and length of each. Returns their number, or ARENA_FULL. See
// `make_grid`.
EXPORT int64_t rr1_make_grid(const PathCurve *curve, const RateLimits *limits, double step, const double *longest,
                             Arena *arena, int64_t *piece, double *offset, double *delta, int64_t capacity) {
    Grid grid;
    arena->used = 0;
    if (!make_grid(curve, limits, step, longest, arena, &grid) || grid.count > capacity) return ARENA_FULL;
    for (int64_t i = 0; i < grid.count; i++) {
        piece[i] = grid.piece[i];
        offset[i] = grid.offset[i];
        delta[i] = grid.delta[i];
    }
    return grid.count;
}
