// Sine and cosine with the same rounding on all targets, unlike those of math libraries.
//
// An angle is reduced to x within pi/4 of zero and a number of quarter turns k (Cody and Waite, Software Manual for
// the Elementary Functions, 1980; beyond MAX_QUARTERS Payne and Hanek, Radian reduction for trigonometric functions,
// 1983). With y = x^2, sin x = x - x y S(y) and cos x = 1 - y / 2 + y^2 C(y). S and C interpolate their functions at
// six Chebyshev nodes in y, computed in 60 digits; they are off by 2e-17 at most.
#ifndef RR1_SINE_H
#define RR1_SINE_H

#include "simd.h"

#define TWO_OVER_PI 0.6366197723675814
// pi / 2 in parts; they have 33 bits, so that up to 2^20 times one of them is exact.
#define HALF_PI_1 0x1.921fb54400000p+0
#define HALF_PI_2 0x1.0b4611a600000p-34
#define HALF_PI_3 0x1.3198a2e000000p-69
// pi / 2 minus its first part, as one number.
#define HALF_PI_REST 6.077100506506192e-11
#define MAX_QUARTERS 1048576.0
// Angles in lanes beyond this are not reduced precisely enough [rad].
#define MAX_LANE_ANGLE 1e5

// Estrin's scheme (1960), with shorter dependency chains than Horner's; y2 is y^2.
#define SINE_POLYNOMIAL(y, y2)                                                                                         \
    ((0.16666666666666666 + (y) * -0.008333333333330948) +                                                             \
     (y2) * ((0.00019841269836756774 + (y) * -2.7557316101617874e-06) +                                                \
             (y2) * (2.505113165023518e-08 + (y) * -1.5918115263265974e-10)))
#define COSINE_POLYNOMIAL(y, y2)                                                                                       \
    ((0.041666666666666664 + (y) * -0.0013888888888887398) +                                                           \
     (y2) * ((2.480158729876456e-05 + (y) * -2.7557317271145144e-07) +                                                 \
             (y2) * (2.087614614655861e-09 + (y) * -1.1382623647474604e-11)))

typedef struct {
    f64x8 sine, cosine;
} SineLanes;

// For angles up to MAX_LANE_ANGLE.
INLINE SineLanes sine_cosine_lanes(f64x8 angle) {
    const double shift = 6755399441055744.0;  // 1.5 * 2^52: the low bits of a sum with it are an integer
    f64x8 shifted = angle * TWO_OVER_PI + shift;
    i64x8 k = (i64x8)shifted;
    f64x8 quarters = shifted - shift;
    f64x8 x = angle - quarters * HALF_PI_1 - quarters * HALF_PI_REST;
    f64x8 y = x * x, y2 = y * y;
    f64x8 s = x - x * (y * SINE_POLYNOMIAL(y, y2));
    f64x8 c = 1.0 - (0.5 * y - y2 * COSINE_POLYNOMIAL(y, y2));
    // Odd quarters exchange both; two of them change the sign.
    i64x8 odd = -(k & 1);
    f64x8 sine = select_mask(odd, c, s), cosine = select_mask(odd, s, c);
    i64x8 sine_sign = (k & 2) << 62, cosine_sign = ((k + 1) & 2) << 62;
    return (SineLanes){(f64x8)((i64x8)sine ^ sine_sign), (f64x8)((i64x8)cosine ^ cosine_sign)};
}

// The bits of 2 / pi after the binary point.
static const uint32_t two_over_pi_words[40] = {
    0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab, 0xdebbc561, 0xb7246e3a,
    0x424dd2e0, 0x06492eea, 0x09d1921c, 0xfe1deb1c, 0xb129a73e, 0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41,
    0x3991d639, 0x835339f4, 0x9c845f8b, 0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf,
    0x27cb09b7, 0x4f463f66, 0x9e5fea2d, 0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1, 0x1f8d5d08,
    0x56033046, 0xfc7b6bab, 0xf0cfbc20, 0x9af4361d,
};

// 32 bits of 2 / pi from the bit of weight 2^-(first + 1) on; there are none before the binary point.
INLINE uint32_t two_over_pi_bits(int64_t first) {
    int64_t word = first >> 5, shift = first & 31;
    uint64_t high = word >= 0 && word < 40 ? two_over_pi_words[word] : 0;
    uint64_t low = word + 1 >= 0 && word + 1 < 40 ? two_over_pi_words[word + 1] : 0;
    return (uint32_t)((high << 32 | low) >> (32 - shift));
}

// Add a 32-bit factor times some bits of 2 / pi to a number of five words, the highest first, from word `last` up.
INLINE void add_product(uint32_t words[5], uint64_t factor, const uint32_t bits[5], int64_t offset) {
    uint64_t carry = 0;
    for (int64_t i = 4 - offset; i >= 0; i--) {
        uint64_t sum = factor * bits[i + offset] + words[i] + carry;
        words[i] = (uint32_t)sum;
        carry = sum >> 32;
    }
}

// Reduce a large angle: x within pi/4 of zero, and the number of quarter turns, of which the two lowest bits count.
static uint64_t reduce_large(double angle, double *x) {
    union {
        double number;
        uint64_t bits;
    } of = {.number = angle};
    uint64_t mantissa = (of.bits & 0xfffffffffffff) | 0x10000000000000;
    int64_t exponent = (int64_t)(of.bits >> 52 & 0x7ff) - 1075;
    // |angle| = mantissa 2^exponent. Bits of 2 / pi above 2^(2 - exponent) contribute whole turns and are omitted. The
    // product with the next 160 is kept modulo 2^160: two bits of quarters, then 158 after the point.
    uint32_t bits[5], words[5] = {0, 0, 0, 0, 0};
    for (int i = 0; i < 5; i++) bits[i] = two_over_pi_bits(exponent - 2 + 32 * i);
    add_product(words, mantissa & 0xffffffff, bits, 0);
    add_product(words, mantissa >> 32, bits, 1);
    uint64_t quarters = words[0] >> 30;
    uint32_t sign = words[0] >> 29 & 1;
    words[0] &= 0x3fffffff;
    if (sign) {
        // The nearest quarter is the next one: the remainder is negative, and stored as its absolute value.
        quarters += 1;
        uint64_t carry = 1;
        for (int i = 4; i >= 0; i--) {
            carry += (uint32_t)~words[i];
            words[i] = (uint32_t)carry;
            carry >>= 32;
        }
        words[0] &= 0x3fffffff;
    }
    double part = 0.0;
    for (int i = 4; i >= 0; i--) part = (part + words[i]) * (i == 0 ? 0x1p-30 : 0x1p-32);
    part *= HALF_PI_1 + HALF_PI_REST;
    int negative = angle < 0.0;
    *x = (sign != 0) != negative ? -part : part;
    return negative ? 0 - quarters : quarters;
}

typedef struct {
    double sine, cosine;
} Sine;

// For any angle, with errors below 3e-16; NaN if the angle is not finite.
static Sine sine_cosine(double angle) {
    const double shift = 6755399441055744.0;
    double x;
    uint64_t k;
    if (!(abs_number(angle) <= 1.7976931348623157e308)) return (Sine){angle - angle, angle - angle};
    if (abs_number(angle) < MAX_QUARTERS) {
        double quarters = (angle * TWO_OVER_PI + shift) - shift;
        k = (uint64_t)(int64_t)quarters;
        x = ((angle - quarters * HALF_PI_1) - quarters * HALF_PI_2) - quarters * HALF_PI_3;
    } else {
        k = reduce_large(angle, &x);
    }
    double y = x * x, y2 = y * y;
    double s = x - x * (y * SINE_POLYNOMIAL(y, y2));
    double c = 1.0 - (0.5 * y - y2 * COSINE_POLYNOMIAL(y, y2));
    double sine = k & 1 ? c : s, cosine = k & 1 ? s : c;
    return (Sine){k & 2 ? -sine : sine, (k + 1) & 2 ? -cosine : cosine};
}

#endif
