// Exact extremes of piecewise polynomials and of their rates, by their Bernstein coefficients.
//
// On an interval a polynomial lies between the smallest and the largest of its Bernstein coefficients, and the first and
// last of them are its values at the ends. Halving the interval (de Casteljau) closes the gap quadratically, so the
// largest value between two samples is found as exactly as floating point allows, without root finding.
//
// Lane, Riesenfeld (1981), Bounds on a polynomial, BIT 21.
#include "referee_tables.h"
#include "referee_simd.h"

// Position, velocity, acceleration, jerk.
enum { RATE_ORDERS = 4 };
// Values that exceed the highest one by less than this fraction of it or of a piece's largest coefficient are skipped.
#define RELATIVE_GAP 1e-13
#define COEFFICIENT_ROUNDING 1e-15

// The binomials i over k, divided by those of the degree: `shares`, shape (degree + 1, degree + 1).
static void set_shares(int64_t degree, double *shares) {
    for (int64_t i = 0; i <= degree; i++) {
        double share = 1.0;
        for (int64_t k = 0; k <= i; k++) {
            shares[i * (degree + 1) + k] = share;
            if (k < i) share *= (double)(i - k) / (double)(degree - k);
        }
    }
}

// Load eight columns of a piece into `rows`, one row for each power; columns beyond the last are zero.
static void load_columns(const double *piece, int64_t terms, int64_t columns, int64_t first, eight_anywhere *rows) {
    int64_t count = columns - first < 8 ? columns - first : 8;
    for (int64_t k = 0; k < terms; k++) {
        eight row = {0.0};
        for (int64_t lane = 0; lane < count; lane++) row[lane] = piece[k * columns + first + lane];
        rows[k] = row;
    }
}

// Bernstein coefficients of a derivative of eight columns on [0, width], in rows of `control`. Returns the degree.
static int64_t to_bernstein(const eight_anywhere *rows, int64_t terms, int64_t order, double width, const double *shares,
                            eight_anywhere *scaled, eight_anywhere *control) {
    if (order >= terms) {
        control[0] = (eight){0.0};
        return 0;
    }
    int64_t degree = terms - 1 - order;
    double power = 1.0;
    for (int64_t k = 0; k <= degree; k++) {
        double factor = 1.0;
        for (int64_t i = 0; i < order; i++) factor *= (double)(k + order - i);
        scaled[k] = factor * rows[k + order] * power;
        power *= width;
    }
    for (int64_t i = 0; i <= degree; i++) {
        eight value = {0.0};
        for (int64_t k = 0; k <= i; k++) value += shares[i * (degree + 1) + k] * scaled[k];
        control[i] = value;
    }
    return degree;
}

// An open interval; its Bernstein coefficients are a row of an array.
typedef struct {
    double start, width;
} OpenSpan;

// Raise `best` to the highest value on an interval, and note its time.
//
// `stack` has rows of degree + 1 numbers; the first one holds the interval's Bernstein coefficients.
static void climb(double begin, double width, int64_t degree, double rounding, double *best, double *when,
                  double *stack) {
    OpenSpan spans[EXTREMES_DEPTH];
    int64_t count = degree + 1, top = 0;
    spans[0] = (OpenSpan){begin, width};
    if (stack[0] > *best) {
        *best = stack[0];
        *when = begin;
    }
    if (stack[degree] > *best) {
        *best = stack[degree];
        *when = begin + width;
    }
    while (top >= 0) {
        OpenSpan span = spans[top];
        double *row = stack + top * count, hull = row[0];
        for (int64_t i = 1; i <= degree; i++) hull = greater(hull, row[i]);
        int too_short = span.width <= 1e-15 * greater(1.0, fabs(span.start)) || top + 1 >= EXTREMES_DEPTH;
        if (hull <= *best + RELATIVE_GAP * fabs(*best) + rounding || too_short) {
            top--;
            continue;
        }
        // The later half replaces the interval, the earlier half goes on top of it.
        double half = 0.5 * span.width, *earlier = row + count;
        for (int64_t k = 0; k <= degree; k++) {
            earlier[k] = row[0];
            for (int64_t i = 0; i < degree - k; i++) row[i] = 0.5 * (row[i] + row[i + 1]);
        }
        spans[top] = (OpenSpan){span.start + half, half};
        spans[top + 1] = (OpenSpan){span.start, half};
        if (row[0] > *best) {
            *best = row[0];
            *when = span.start + half;
        }
        top++;
    }
}

// Raise `high` and lower `low` of a column to its extremes on a piece, and note the times. The column's Bernstein
// coefficients lie between `least` and `most`.
static void climb_both(double begin, double width, int64_t degree, const eight_anywhere *control, int64_t lane, double least,
                       double most, Peaks *peak, double *stack) {
    double rounding = COEFFICIENT_ROUNDING * greater(fabs(most), fabs(least));
    if (most > peak->high) {
        for (int64_t k = 0; k <= degree; k++) stack[k] = control[k][lane];
        climb(begin, width, degree, rounding, &peak->high, &peak->high_time, stack);
    }
    if (least < peak->low) {
        double depth = -peak->low;
        for (int64_t k = 0; k <= degree; k++) stack[k] = -control[k][lane];
        climb(begin, width, degree, rounding, &depth, &peak->low_time, stack);
        peak->low = -depth;
    }
}

static inline eight choose_eight(eight_integers which, eight yes, eight no) {
    return (eight)((which & (eight_integers)yes) | (~which & (eight_integers)no));
}

// Highest and lowest values of every column and its rates, jumps between pieces, and values at the end.
//
// `breaks`: shape (pieces + 1,), or (1,) for zero duration; `coefficients`: shape (pieces, terms, columns), lowest
// power first. `peaks` has shape (4, columns), `jumps` shape (3, columns), `end` shape (4, columns). `scratch` has room
// for terms * (EXTREMES_DEPTH + 24 + 4 * terms) numbers.
EXPORT void rr1_find_extremes(const double *breaks, int64_t break_count, const double *coefficients, int64_t pieces,
                              int64_t terms, int64_t columns, Peaks *peaks, Jump *jumps, double *end, double *scratch) {
    eight_anywhere *rows = (eight_anywhere *)scratch, *scaled = rows + terms, *control = scaled + terms;
    double *shares = scratch + 24 * terms, *stack = shares + RATE_ORDERS * terms * terms;
    for (int64_t n = 0; n < RATE_ORDERS * columns; n++) peaks[n] = (Peaks){-INFINITY, 0.0, INFINITY, 0.0};
    for (int64_t n = 0; n < (RATE_ORDERS - 1) * columns; n++) jumps[n] = (Jump){0.0, 0.0};
    for (int64_t order = 0; order < RATE_ORDERS; order++)
        set_shares(order < terms ? terms - 1 - order : 0, shares + order * terms * terms);
    // In the order in memory, as there may be many coefficients.
    for (int64_t i = 0; i < pieces; i++) {
        double width = break_count > 1 ? breaks[i + 1] - breaks[i] : 0.0;
        for (int64_t first = 0; first < columns; first += 8) {
            int64_t count = columns - first < 8 ? columns - first : 8;
            load_columns(coefficients + i * terms * columns, terms, columns, first, rows);
            for (int64_t order = 0; order < RATE_ORDERS; order++) {
                int64_t degree =
                    to_bernstein(rows, terms, order, width, shares + order * terms * terms, scaled, control);
                eight most = control[0], least = most;
                for (int64_t k = 1; k <= degree; k++) {
                    eight row = control[k];
                    most = choose_eight(row > most, row, most);
                    least = choose_eight(row < least, row, least);
                }
                for (int64_t lane = 0; lane < count; lane++) {
                    int64_t at = order * columns + first + lane;
                    if (i > 0 && order < RATE_ORDERS - 1) {
                        double size = fabs(control[0][lane] - end[at]);
                        if (size > jumps[at].size) jumps[at] = (Jump){size, breaks[i]};
                    }
                    end[at] = control[degree][lane];
                    climb_both(breaks[i], width, degree, control, lane, least[lane], most[lane], &peaks[at], stack);
                }
            }
        }
    }
}
