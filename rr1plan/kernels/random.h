// Random numbers, the same on every machine.
//
// SplitMix64: a counter of 64 bits and a mixing function (Steele, Lea, Flood, Fast splittable pseudorandom number
// generators, 2014). Integers and exact products only, so nothing is rounded.
#ifndef RR1_RANDOM_H
#define RR1_RANDOM_H

#include <stdint.h>

#include "simd.h"

// The next number of the uniform distribution on [0, 1); `state` is the counter.
INLINE double draw_uniform(uint64_t *state) {
    uint64_t x = *state += UINT64_C(0x9E3779B97F4A7C15);
    x = (x ^ (x >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94D049BB133111EB);
    x = x ^ (x >> 31);
    return (double)(x >> 11) * 0x1p-53;
}

// The next integer of 0 .. count - 1.
INLINE int64_t draw_index(uint64_t *state, int64_t count) {
    int64_t index = (int64_t)(draw_uniform(state) * (double)count);
    return index < count ? index : count - 1;
}

// The next point of a box; a side of length zero keeps its value to the bit.
INLINE void draw_in_box(uint64_t *state, const double *lower, const double *extent, int64_t nq, double *q) {
    for (int64_t j = 0; j < nq; j++) q[j] = lower[j] + draw_uniform(state) * extent[j];
}

EXPORT double rr1_draw_uniform(uint64_t *state) { return draw_uniform(state); }

#endif
