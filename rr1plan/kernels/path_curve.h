// Curves of straight lines and parabolas, and motions along them.
#ifndef RR1_PATH_CURVE_H
#define RR1_PATH_CURVE_H

#include <stdint.h>

#include "arena.h"

// A piece is q(s) = c[0] + c[1] s + c[2] s^2, 0 <= s <= length, shape (3, nq).
typedef struct {
    const double *lengths;       // shape (count,)
    const double *coefficients;  // shape (count, 3, nq)
    int64_t count;
    int64_t column_count;  // nq
} PathCurve;

// Limits of each column and their inverses, shape (nq,); finite for joints that move.
typedef struct {
    const double *velocity;
    const double *acceleration;
    const double *inverse_velocity;
    const double *inverse_acceleration;
} RateLimits;

// A motion: polynomials in time, shape (count, 5, nq), lowest power first, and their durations, shape (count,).
typedef struct {
    double *durations;
    double *coefficients;
    int64_t count;
    int64_t capacity;
} TimedPieces;

// Kind of a motion: straight lines only, or with parabolas.
enum { TIMED_STRAIGHT, TIMED_BENT };

#endif
