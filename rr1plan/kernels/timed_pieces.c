// Curves with squared path speeds as polynomials in time, and the peaks of their derivatives.
#include "path_curve.h"

// Polynomial in time of an interval on which the squared path speed is linear from x to y, shape (5, nq).
static void write_timed_piece(const double *piece, int64_t nq, double offset, double delta, double x, double y,
                              double *timed) {
    double speed = sqrt_number(x), half = 0.25 * (y - x) / delta;
    for (int64_t j = 0; j < nq; j++) {
        double c0 = piece[j], c1 = piece[nq + j], c2 = piece[2 * nq + j], first = c1 + 2.0 * offset * c2;
        timed[j] = c0 + offset * (c1 + offset * c2);
        timed[nq + j] = first * speed;
        timed[2 * nq + j] = first * half + c2 * x;
        timed[3 * nq + j] = 2.0 * c2 * speed * half;
        timed[4 * nq + j] = c2 * half * half;
    }
}

// Intervals of a curve with squared path speeds x at the gridpoints, shape (count + 1,), as polynomials in time.
EXPORT void rr1_time_intervals(const PathCurve *curve, const int64_t *piece, const double *offset, const double *delta,
                               const double *x, int64_t count, double *durations, double *timed) {
    int64_t nq = curve->column_count;
    for (int64_t i = 0; i < count; i++) {
        durations[i] = 2.0 * delta[i] / (sqrt_number(x[i]) + sqrt_number(x[i + 1]));
        write_timed_piece(piece_of(curve, piece[i]), nq, offset[i], delta[i], x[i], x[i + 1], timed + i * 5 * nq);
    }
}

// The motion along a curve with squared speeds at the gridpoints, in memory of the arena. Returns 0 if that is used up.
//
// A straight interval becomes up to three: full acceleration, top speed, full deceleration.
static int time_curve(const PathCurve *curve, const Grid *grid, const RateLimits *limits, const double *speeds, Arena *arena,
                      TimedPieces *timed) {
    int64_t n = grid->count, nq = curve->column_count, count = 0;
    Grid parts;
    double *x = arena_take(arena, 3 * n + 1);
    if (!x || !take_grid(arena, 3 * n, &parts)) return 0;
    x[0] = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const double *piece = piece_of(curve, grid->piece[i]);
        double delta = grid->delta[i], start = 0.0;
        double ramp = 0.0;
        Profile profile = {delta, delta, speeds[i + 1]};
        if (!is_bent(piece, nq)) {
            profile = bang_bang_profile(piece, nq, delta, limits, speeds[i], speeds[i + 1]);
            ramp = profile.peak / speed_gain(piece, nq, limits->inverse_acceleration);
        }
        double ends[3] = {profile.rise, profile.fall, delta}, tops[3] = {profile.peak, profile.peak, speeds[i + 1]};
        // Shorter parts are left out: on them, speeds change by no more than their rounding errors.
        double least = 1e-12 * max_number(delta, ramp);
        for (int k = 0; k < 3; k++) {
            if (!(ends[k] - start > least)) continue;
            parts.piece[count] = grid->piece[i];
            parts.offset[count] = grid->offset[i] + start;
            parts.delta[count] = ends[k] - start;
            x[++count] = tops[k];
            start = ends[k];
        }
    }
    double *durations = arena_take(arena, count), *coefficients = arena_take(arena, count * 5 * nq);
    if (!durations || !coefficients) return 0;
    rr1_time_intervals(curve, parts.piece, parts.offset, parts.delta, x, count, durations, coefficients);
    *timed = (TimedPieces){durations, coefficients, count, count};
    return 1;
}

// Largest |c0 + c1 t + c2 t^2 + c3 t^3| on [0, end]: at an end or where the derivative is zero.
static double cubic_peak(double c0, double c1, double c2, double c3, double end) {
    double best = max_number(abs_number(c0), abs_number(c0 + end * (c1 + end * (c2 + end * c3))));
    double a = 3.0 * c3, b = 2.0 * c2, c = c1, square = b * b - 4.0 * a * c;
    if (!(square >= 0.0)) return best;
    // The form without cancellation; a = 0 gives the linear root by c / q.
    double q = -0.5 * (b + __builtin_copysign(sqrt_number(square), b)), roots[2] = {q / a, c / q};
    for (int k = 0; k < 2; k++) {
        double root = roots[k];
        if (0.0 < root && root < end)
            best = max_number(best, abs_number(c0 + root * (c1 + root * (c2 + root * c3))));
    }
    return best;
}

// Largest absolute value of a derivative of each column on each piece, shape (count, nq).
//
// `coefficients` has shape (count, terms, nq), terms <= 5; the derivative is at least the first.
EXPORT void rr1_find_peaks(const double *coefficients, const double *durations, int64_t count, int64_t terms, int64_t nq,
                           int64_t derivative, double *out) {
    for (int64_t i = 0; i < count; i++)
        for (int64_t j = 0; j < nq; j++) {
            double c[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
            for (int64_t k = derivative; k < terms; k++) {
                double value = coefficients[(i * terms + k) * nq + j];
                for (int64_t p = 0; p < derivative; p++) value *= (double)(k - p);
                c[k - derivative] = value;
            }
            out[i * nq + j] = cubic_peak(c[0], c[1], c[2], c[3], durations[i]);
        }
}

// Time scaling factor that satisfies the limits, at least 1.
static double stretch_factor(const TimedPieces *timed, int64_t nq, const RateLimits *limits) {
    double fast = 1.0, strong = 1.0;
    for (int64_t i = 0; i < timed->count; i++) {
        const double *c = timed->coefficients + i * 5 * nq;
        double end = timed->durations[i], third = end / 3.0, half = 0.5 * end;
        for (int64_t j = 0; j < nq; j++) {
            double pace = limits->inverse_velocity[j], pull = limits->inverse_acceleration[j];
            double c1 = c[nq + j], c2 = 2.0 * c[2 * nq + j], c3 = 3.0 * c[3 * nq + j], c4 = 4.0 * c[4 * nq + j];
            // Bernstein coefficients bound a polynomial: its peak is computed only if they exceed the largest value so
            // far.
            double most = max_number(abs_number(c1), abs_number(c1 + third * c2));
            most = max_number(most, abs_number(c1 + third * (2.0 * c2 + end * c3)));
            most = max_number(most, abs_number(c1 + end * (c2 + end * (c3 + end * c4))));
            if (most * pace > fast) fast = max_number(fast, cubic_peak(c1, c2, c3, c4, end) * pace);
            c3 *= 2.0;
            c4 *= 3.0;
            most = max_number(abs_number(c2), abs_number(c2 + half * c3));
            most = max_number(most, abs_number(c2 + end * (c3 + end * c4)));
            if (most * pull > strong) strong = max_number(strong, cubic_peak(c2, c3, c4, 0.0, end) * pull);
        }
    }
    return max_number(fast, sqrt_number(strong));
}
