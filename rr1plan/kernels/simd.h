// Vectors of eight numbers: one lane for each of eight configurations of an edge.
//
// Plain operators of GCC's and Clang's vector extensions, no intrinsics, so that one source compiles for SSE, AVX2,
// AVX-512, NEON and WebAssembly. IEEE 754 defines the rounding of all operations here (+ - * / sqrt; comparisons and
// selections do not round), and sources are compiled with -ffp-contract=off, so that all targets give the same bytes.
#ifndef RR1_SIMD_H
#define RR1_SIMD_H

#include <stdint.h>

enum { LANES = 8 };
// Bits of all lanes.
#define ALL_LANES ((uint64_t)0xff)

typedef double f64x8 __attribute__((vector_size(64)));
typedef int64_t i64x8 __attribute__((vector_size(64)));
// Likewise, at any address of a double.
typedef double f64x8_unaligned __attribute__((vector_size(64), aligned(8), may_alias));

#define INFINITY __builtin_inf()

#define INLINE static inline __attribute__((always_inline))
// Compiled once and visible in profiles.
#define NOINLINE static __attribute__((noinline))

INLINE f64x8 splat(double value) { return (f64x8){value, value, value, value, value, value, value, value}; }

INLINE f64x8 load_lanes(const double *from) { return *(const f64x8_unaligned *)from; }

INLINE void store_lanes(double *to, f64x8 value) { *(f64x8_unaligned *)to = value; }

// `one` in the lanes whose mask is set (-1), `other` where it is 0.
INLINE f64x8 select_mask(i64x8 mask, f64x8 one, f64x8 other) {
    return (f64x8)((mask & (i64x8)one) | (~mask & (i64x8)other));
}

// `one` where a < b, else `other`; a NaN is not less than anything.
INLINE f64x8 select_less(f64x8 a, f64x8 b, f64x8 one, f64x8 other) { return select_mask(a < b, one, other); }

// Like machine instructions: the second operand if one of them is NaN.
INLINE f64x8 min_lanes(f64x8 a, f64x8 b) { return select_mask(a < b, a, b); }

INLINE f64x8 max_lanes(f64x8 a, f64x8 b) { return select_mask(a > b, a, b); }

INLINE f64x8 abs_lanes(f64x8 a) { return (f64x8)((i64x8)a & INT64_MAX); }

INLINE f64x8 sqrt_lanes(f64x8 a) {
#if defined(__clang__)
    return __builtin_elementwise_sqrt(a);
#else
    f64x8 out;
    for (int i = 0; i < LANES; i++) out[i] = __builtin_sqrt(a[i]);
    return out;
#endif
}

// The nearest integer, ties to even, of numbers below 2^51 in size: the sum has no room for a fraction.
INLINE f64x8 round_lanes(f64x8 a) {
    const double shift = 6755399441055744.0;  // 1.5 * 2^52
    return (a + shift) - shift;
}

// Bit i is set where lane i of a mask is.
INLINE uint64_t bits_of(i64x8 mask) {
#if defined(__clang__)
    typedef _Bool bool8 __attribute__((ext_vector_type(8)));
    union {
        bool8 lanes;
        uint8_t bits;
    } word = {.lanes = __builtin_convertvector(mask, bool8)};
    return word.bits;
#else
    mask &= (i64x8){1, 2, 4, 8, 16, 32, 64, 128};
    return (uint64_t)(mask[0] | mask[1] | mask[2] | mask[3] | mask[4] | mask[5] | mask[6] | mask[7]);
#endif
}

// Bits of the lanes where a is not proven to be at least b; a NaN proves nothing, so it counts as less.
INLINE uint64_t less_than(f64x8 a, f64x8 b) { return bits_of(~(a >= b)); }

// The minima of six vectors, each over all lanes, in the first six lanes.
INLINE f64x8 min_of_each(const f64x8 a[6]) {
    f64x8 pairs[3], quads[2];
    for (int i = 0; i < 3; i++) {
        f64x8 one = a[2 * i], two = a[2 * i + 1];
        pairs[i] = min_lanes(__builtin_shufflevector(one, two, 0, 8, 2, 10, 4, 12, 6, 14),
                             __builtin_shufflevector(one, two, 1, 9, 3, 11, 5, 13, 7, 15));
    }
    for (int i = 0; i < 2; i++) {
        f64x8 one = pairs[2 * i], two = pairs[i + 1];
        quads[i] = min_lanes(__builtin_shufflevector(one, two, 0, 1, 8, 9, 4, 5, 12, 13),
                             __builtin_shufflevector(one, two, 2, 3, 10, 11, 6, 7, 14, 15));
    }
    return min_lanes(__builtin_shufflevector(quads[0], quads[1], 0, 1, 2, 3, 8, 9, 10, 11),
                     __builtin_shufflevector(quads[0], quads[1], 4, 5, 6, 7, 12, 13, 14, 15));
}

// Number of the lowest bit that is set in a word that is not zero.
INLINE int64_t first_bit(uint64_t word) { return __builtin_ctzll(word); }

INLINE double min_number(double a, double b) { return a < b ? a : b; }

INLINE double max_number(double a, double b) { return a > b ? a : b; }

INLINE double abs_number(double a) { return __builtin_fabs(a); }

INLINE double sqrt_number(double a) { return __builtin_sqrt(a); }

// Three numbers in each lane: points and directions.
typedef struct {
    f64x8 x, y, z;
} Vec8;

INLINE Vec8 vec8_splat(const double v[3]) { return (Vec8){splat(v[0]), splat(v[1]), splat(v[2])}; }

INLINE Vec8 vec8_sub(Vec8 a, Vec8 b) { return (Vec8){a.x - b.x, a.y - b.y, a.z - b.z}; }

INLINE Vec8 vec8_add(Vec8 a, Vec8 b) { return (Vec8){a.x + b.x, a.y + b.y, a.z + b.z}; }

INLINE Vec8 vec8_scale(Vec8 a, f64x8 s) { return (Vec8){a.x * s, a.y * s, a.z * s}; }

INLINE Vec8 vec8_negative(Vec8 a) { return (Vec8){-a.x, -a.y, -a.z}; }

INLINE f64x8 vec8_dot(Vec8 a, Vec8 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

INLINE Vec8 vec8_cross(Vec8 a, Vec8 b) {
    return (Vec8){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

INLINE Vec8 vec8_select(i64x8 mask, Vec8 one, Vec8 other) {
    return (Vec8){
        select_mask(mask, one.x, other.x),
        select_mask(mask, one.y, other.y),
        select_mask(mask, one.z, other.z),
    };
}

#endif
