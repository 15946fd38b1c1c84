// Exact extremes of piecewise polynomials and of their rates, by their Bernstein coefficients.
//
// On an interval a polynomial lies between the smallest and the largest of its Bernstein coefficients, and the first and
// last of them are its values at the ends. Halving the interval (de Casteljau) closes the gap quadratically, so the
// largest value between two samples is found as exactly as floating point allows, without root finding.
//
// Lane, Riesenfeld (1981), Bounds on a polynomial, BIT 21.
#include "referee_tables.h"
#include "simd.h"

// Position, velocity, acceleration, jerk.
enum { RATE_ORDERS = 4 };
// What is not higher by this fraction of the highest value, or of a piece's largest coefficient, is not searched for.
#define RELATIVE_GAP 1e-13
#define COEFFICIENT_ROUNDING 1e-15

// Coefficients of a derivative of a column on a piece, shape (degree + 1,); its degree.
static int64_t derivative_terms(const double *coefficients, int64_t terms, int64_t columns, int64_t column,
                                int64_t order, double *out) {
    if (order >= terms) {
        out[0] = 0.0;
        return 0;
    }
    for (int64_t k = order; k < terms; k++) {
        double factor = 1.0;
        for (int64_t i = 0; i < order; i++) factor *= (double)(k - i);
        out[k - order] = factor * coefficients[k * columns + column];
    }
    return terms - 1 - order;
}

// Bernstein coefficients on [0, width]; the largest of their sizes. `terms` is overwritten.
static double to_bernstein(double *terms, int64_t degree, double width, double *control) {
    double power = 1.0, largest = 0.0;
    for (int64_t k = 0; k <= degree; k++) {
        terms[k] *= power;
        power *= width;
    }
    for (int64_t i = 0; i <= degree; i++) {
        // The binomials i over k, divided by those of the degree.
        double share = 1.0, value = 0.0;
        for (int64_t k = 0; k <= i; k++) {
            value += share * terms[k];
            if (k < i) share *= (double)(i - k) / (double)(degree - k);
        }
        control[i] = value;
        largest = greater(largest, fabs(value));
    }
    return largest;
}

// An interval that is open, and the Bernstein coefficients there: rows of an array.
typedef struct {
    double start, width;
} OpenSpan;

// Raise `best` to the highest value on an interval, and note its time.
//
// `stack` has rows of degree + 1 numbers; its first one holds the Bernstein coefficients.
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
        // The later half takes the place of both, the earlier one goes on top of it.
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

// Highest and lowest values of every column and its rates, jumps between pieces, and values at the end.
//
// `breaks`: shape (pieces + 1,), or (1,) for no duration; `coefficients`: shape (pieces, terms, columns), lowest power
// first. `peaks` has shape (4, columns), `jumps` shape (3, columns), zeros to begin with, `end` shape (4, columns).
// `scratch` has room for terms * (EXTREMES_DEPTH + 2) numbers.
EXPORT void rr1_find_extremes(const double *breaks, int64_t break_count, const double *coefficients, int64_t pieces,
                              int64_t terms, int64_t columns, Peaks *peaks, Jump *jumps, double *end, double *scratch) {
    double *derivative = scratch, *control = scratch + terms, *stack = scratch + 2 * terms;
    for (int64_t n = 0; n < RATE_ORDERS * columns; n++) peaks[n] = (Peaks){-INFINITY, 0.0, INFINITY, 0.0};
    // In the order of the coefficients, as there may be many of them.
    for (int64_t i = 0; i < pieces; i++) {
        const double *piece = coefficients + i * terms * columns;
        double width = break_count > 1 ? breaks[i + 1] - breaks[i] : 0.0;
        for (int64_t j = 0; j < columns; j++) {
            for (int64_t order = 0; order < RATE_ORDERS; order++) {
                Peaks *peak = &peaks[order * columns + j];
                double *before = &end[order * columns + j];
                int64_t degree = derivative_terms(piece, terms, columns, j, order, derivative);
                double rounding = COEFFICIENT_ROUNDING * to_bernstein(derivative, degree, width, control);
                if (i > 0 && order < RATE_ORDERS - 1) {
                    Jump *jump = &jumps[order * columns + j];
                    double size = fabs(control[0] - *before);
                    if (size > jump->size) *jump = (Jump){size, breaks[i]};
                }
                *before = control[degree];
                for (int64_t k = 0; k <= degree; k++) stack[k] = control[k];
                climb(breaks[i], width, degree, rounding, &peak->high, &peak->high_time, stack);
                for (int64_t k = 0; k <= degree; k++) stack[k] = -control[k];
                double depth = -peak->low;
                climb(breaks[i], width, degree, rounding, &depth, &peak->low_time, stack);
                peak->low = -depth;
            }
        }
    }
}
