// Time-optimal path parameterization of straight lines and parabolas under velocity and acceleration limits.
//
// On an interval of length d with constant path acceleration the squared path speed is linear, from x to y, and every
// limit is |alpha x + beta y| <= 1. These constraints in (x, y), instead of (u, x), are symmetric, so that x = y = 0 is
// always feasible and the controllable speeds are [0, high]. A backward pass computes the controllable sets, a forward
// pass the highest controllable speeds (Pham, Pham, A New Approach to Time-Optimal Path Parameterization Based on
// Reachability Analysis, IEEE T-RO 34(3), 2018). The linear programs are solved exactly: the bound of x is a concave
// function of y, a minimum of lines, and its maximum is the intersection of a rising and a falling one.
#include "path_curve.h"

// If the ratio of its coefficients is below this, a row bounds only one of x and y.
#define ROW_RATIO 1e-9
enum { ROW_ROUNDS = 100 };
// Points within an interval at which velocity is constrained.
enum { VELOCITY_PLACES = 4 };
#define MIN_SLOWNESS 1e-12
// A motion keeps this share of the highest squared speed at the end of each bent interval, if it is feasible. On a coarse
// grid, the highest speed at one gridpoint may require rest at the next one, although the motion is slower then, or
// cannot end if that is the last but one.
#define LEAST_SPEED 0.3

// A row is |alpha x + beta y| <= 1; an interval of a curve with nq columns has ROWS(nq) of them.
#define ROWS(nq) (2 * (nq) + VELOCITY_PLACES + 1)

// The inverse of the highest squared path speed at s of a piece.
static double slowness_at(const double *piece, int64_t nq, double s, const double *inverse_velocity) {
    double slowest = max_number(MIN_SLOWNESS, derivative_at(piece, nq, s, inverse_velocity));
    return slowest * slowest;
}

INLINE void set_row(double *alpha, double *beta, double a, double b) {
    *alpha = abs_number(a);
    *beta = a >= 0.0 ? b : -b;
}

// Rows of an interval on a parabola, alpha >= 0; the last row is the caller's.
//
// Acceleration is linear in s, so limits at both ends hold in between. Velocity is limited at VELOCITY_PLACES points.
static void fill_rows(const double *piece, int64_t nq, double offset, double delta, const RateLimits *limits,
                      double *alpha, double *beta) {
    double scale = 0.5 / delta;
    for (int64_t j = 0; j < nq; j++) {
        double second = 2.0 * piece[2 * nq + j], weight = limits->inverse_acceleration[j];
        double begin = (piece[nq + j] + offset * second) * scale;
        double end = (piece[nq + j] + (offset + delta) * second) * scale;
        set_row(&alpha[j], &beta[j], (second - begin) * weight, begin * weight);
        set_row(&alpha[nq + j], &beta[nq + j], -end * weight, (second + end) * weight);
    }
    for (int64_t k = 0; k < VELOCITY_PLACES; k++) {
        double at = ((double)k + 0.5) / VELOCITY_PLACES;
        double slow = slowness_at(piece, nq, offset + at * delta, limits->inverse_velocity);
        alpha[2 * nq + k] = (1.0 - at) * slow;
        beta[2 * nq + k] = at * slow;
    }
}

// Index of the line sign size[r] - slope[r] y that is lowest (sign 1) or highest (sign -1).
static int64_t lowest_line(const double *size, const double *slope, int64_t count, double sign, double y) {
    int64_t best = 0;
    double value = INFINITY;
    for (int64_t r = 0; r < count; r++) {
        double here = size[r] - sign * slope[r] * y;
        if (here < value) {
            best = r;
            value = here;
        }
    }
    return best;
}

// The highest x for which some y in [low, high] satisfies all rows; some alpha must be positive, and low feasible at
// x = 0.
static double highest_speed(const double *alpha, const double *beta, int64_t count, double low, double high) {
    double size[count], slope[count];
    for (int64_t r = 0; r < count; r++) {
        if (alpha[r] > ROW_RATIO * abs_number(beta[r])) {
            size[r] = 1.0 / alpha[r];
            slope[r] = beta[r] * size[r];
        } else {
            size[r] = INFINITY;
            slope[r] = 0.0;
            if (beta[r] != 0.0) high = min_number(high, 1.0 / abs_number(beta[r]));
        }
    }
    double y = high;
    int64_t falling = lowest_line(size, slope, count, 1.0, y);
    if (slope[falling] > 0.0) {
        y = 0.0;
        int64_t rising = lowest_line(size, slope, count, 1.0, y);
        for (int round = 0; round < ROW_ROUNDS && slope[rising] < 0.0; round++) {
            y = (size[falling] - size[rising]) / (slope[falling] - slope[rising]);
            int64_t r = lowest_line(size, slope, count, 1.0, y);
            if (r == rising || r == falling || slope[r] == 0.0) break;
            if (slope[r] > 0.0) {
                falling = r;
            } else {
                rising = r;
            }
        }
    }
    // The other side of the rows bounds x from below: move back to where there is room, as there is at y = 0.
    for (int round = 0; round < ROW_ROUNDS; round++) {
        int64_t upper = lowest_line(size, slope, count, 1.0, y), lower = lowest_line(size, slope, count, -1.0, y);
        double room = size[upper] + size[lower] - (slope[upper] - slope[lower]) * y;
        double closing = slope[upper] - slope[lower];
        // This is the intersection of the two lines up to rounding, or no y gives more room.
        if (room >= -1e-12 * size[upper] || closing <= 0.0) break;
        y = (size[upper] + size[lower]) / closing;
    }
    y = max_number(y, low);
    int64_t r = lowest_line(size, slope, count, 1.0, y);
    return max_number(0.0, size[r] - slope[r] * y);
}

// A squared speed at the end of an interval, as wanted or less, that is feasible from rest.
static double least_next_speed(const double *beta, int64_t count, double wanted) {
    double steepest = 0.0;
    for (int64_t r = 0; r < count; r++) steepest = max_number(steepest, abs_number(beta[r]));
    return min_number(wanted, 0.5 / steepest);
}

// The highest y in [0, high] that satisfies all rows for an x for which there is one.
static double next_speed(const double *alpha, const double *beta, int64_t count, double x, double high) {
    double y = high;
    for (int64_t r = 0; r < count; r++) {
        double steep = abs_number(beta[r]);
        if (!(steep > ROW_RATIO * alpha[r])) continue;
        double used = beta[r] > 0.0 ? alpha[r] * x : -alpha[r] * x;
        if (used + steep * y > 1.0) y = (1.0 - used) / steep;
    }
    return max_number(0.0, y);
}

// Largest change of the squared path speed along a straight piece, per length.
static double speed_gain(const double *piece, int64_t nq, const double *inverse_acceleration) {
    double slowest = 0.0;
    for (int64_t j = 0; j < nq; j++)
        slowest = max_number(slowest, abs_number(piece[nq + j]) * inverse_acceleration[j]);
    return 2.0 / slowest;
}

// A bang-bang profile on a straight interval: where acceleration ends, where deceleration begins, and the squared speed
// in between.
typedef struct {
    double rise, fall, peak;
} Profile;

static Profile bang_bang_profile(const double *piece, int64_t nq, double delta, const RateLimits *limits, double x,
                                 double y) {
    double gain = speed_gain(piece, nq, limits->inverse_acceleration);
    double top = min_number(1.0 / slowness_at(piece, nq, 0.0, limits->inverse_velocity), 0.5 * (x + y + gain * delta));
    double peak = max_number(max_number(top, x), y), rise = min_number((peak - x) / gain, delta);
    return (Profile){rise, max_number(delta - (peak - y) / gain, rise), peak};
}

// Largest ratio of rows first .. stop - 1 to their limits.
static double tightest_row(const double *alpha, const double *beta, double x, double y, int64_t first, int64_t stop) {
    double most = 0.0;
    for (int64_t r = first; r < stop; r++) most = max_number(most, abs_number(alpha[r] * x + beta[r] * y));
    return most;
}

typedef struct {
    double *x;         // squared speeds at the gridpoints, shape (count + 1,)
    double duration;   // of the motion [s]
    double looseness;  // mean over time of the unused share of the limit of the joint closest to its limit
} Speeds;

// Highest squared speeds x at the gridpoints from which the motion can stop at the end of the grid, by a backward pass;
// rows of all intervals. `least`: LEAST_SPEED, or 0 for the highest speeds of all.
static void controllable_speeds(const PathCurve *curve, const Grid *grid, const RateLimits *limits, double least,
                                double *alpha, double *beta, double *x) {
    int64_t n = grid->count, nq = curve->column_count, rows = ROWS(nq);
    x[n] = 0.0;
    for (int64_t i = n - 1; i >= 0; i--) {
        const double *piece = piece_of(curve, grid->piece[i]);
        double *a = alpha + i * rows, *b = beta + i * rows;
        double slow = slowness_at(piece, nq, grid->offset[i], limits->inverse_velocity);
        if (is_bent(piece, nq)) {
            fill_rows(piece, nq, grid->offset[i], grid->delta[i], limits, a, b);
            a[rows - 1] = slow;
            x[i] = highest_speed(a, b, rows, least_next_speed(b, rows, least * x[i + 1]), x[i + 1]);
        } else {
            double gain = grid->delta[i] * speed_gain(piece, nq, limits->inverse_acceleration);
            a[0] = 1.0 / gain;
            b[0] = -1.0 / gain;
            x[i] = min_number(1.0 / slow, x[i + 1] + gain);
        }
    }
}

// Time-optimal squared speeds on a grid, from the squared speed `first`, or less if the motion cannot stop at the end
// of the grid from there. Returns 0 if the arena is used up.
//
// In the time-optimal motion, some joint is always at a limit. On a grid, a joint is at a limit at one end of each
// interval; the unused fraction of the limit at the other end is the looseness.
static int solve_grid(const PathCurve *curve, const Grid *grid, const RateLimits *limits, double first, Arena *arena,
                      Speeds *speeds) {
    int64_t n = grid->count, nq = curve->column_count, rows = ROWS(nq);
    double *x = arena_take(arena, n + 1), *alpha = arena_take(arena, 2 * n * rows);
    if (!x || !alpha) return 0;
    double *beta = alpha + n * rows;
    for (int64_t i = 0; i < 2 * n * rows; i++) alpha[i] = 0.0;
    controllable_speeds(curve, grid, limits, LEAST_SPEED, alpha, beta, x);
    // A moving arm may be too fast to keep the least speeds.
    if (x[0] < first) controllable_speeds(curve, grid, limits, 0.0, alpha, beta, x);
    x[0] = min_number(first, x[0]);
    for (int64_t i = 0; i < n; i++) x[i + 1] = next_speed(alpha + i * rows, beta + i * rows, rows, x[i], x[i + 1]);
    double total = 0.0, loose = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const double *piece = piece_of(curve, grid->piece[i]), *a = alpha + i * rows, *b = beta + i * rows;
        double begin = sqrt_number(x[i]), end = sqrt_number(x[i + 1]), delta = grid->delta[i], duration;
        if (is_bent(piece, nq)) {
            duration = 2.0 * delta / (begin + end);
            double slow = slowness_at(piece, nq, grid->offset[i] + delta, limits->inverse_velocity);
            double used = max_number(tightest_row(a, b, x[i], x[i + 1], 0, nq), x[i] * a[rows - 1]);
            double used_last = max_number(tightest_row(a, b, x[i], x[i + 1], nq, 2 * nq), x[i + 1] * slow);
            loose += duration * max_number(0.0, 1.0 - min_number(used, used_last));
        } else {
            Profile profile = bang_bang_profile(piece, nq, delta, limits, x[i], x[i + 1]);
            double top = sqrt_number(profile.peak);
            duration = 2.0 * profile.rise / (begin + top) + (profile.fall - profile.rise) / top +
                       2.0 * (delta - profile.fall) / (top + end);
        }
        total += duration;
    }
    *speeds = (Speeds){x, total, loose / total};
    return 1;
}

// Time-optimal squared speeds at the gridpoints of a curve, shape (count + 1,), from `first` to rest; 0, or ARENA_FULL.
EXPORT int64_t rr1_fastest_speeds(const PathCurve *curve, const RateLimits *limits, int64_t *piece, double *offset,
                                  double *delta, int64_t count, double first, Arena *arena, double *x) {
    Grid grid = {piece, offset, delta, count};
    Speeds speeds;
    arena->used = 0;
    if (!solve_grid(curve, &grid, limits, first, arena, &speeds)) return ARENA_FULL;
    for (int64_t i = 0; i <= count; i++) x[i] = speeds.x[i];
    return 0;
}
