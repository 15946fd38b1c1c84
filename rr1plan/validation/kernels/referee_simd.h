// SIMD vectors for loops over corners.
#ifndef RR1_REFEREE_SIMD_H
#define RR1_REFEREE_SIMD_H

#include "referee_library.h"

typedef double eight __attribute__((vector_size(64)));
typedef int64_t eight_integers __attribute__((vector_size(64)));
typedef double eight_anywhere __attribute__((vector_size(64), aligned(8), may_alias));

static inline double lesser(double a, double b) { return b < a ? b : a; }

static inline double greater(double a, double b) { return b > a ? b : a; }

static inline int64_t lesser_index(int64_t a, int64_t b) { return b < a ? b : a; }

#endif
