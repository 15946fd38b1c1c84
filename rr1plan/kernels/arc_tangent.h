// The angle of a point in the upper half plane, with the same rounding on all targets.
//
// With u = tan of an angle within pi / 8 of zero and z = u^2, atan u = u - u z P(z); P interpolates its function at
// eleven Chebyshev nodes in z, computed in 60 digits, and is off by 5e-18 at most.
#ifndef RR1_ARC_TANGENT_H
#define RR1_ARC_TANGENT_H

#include "simd.h"

// Angle of (x, y), 0 <= y, in [0, pi]; 0 at the origin.
INLINE double angle_of(double y, double x) {
    static const double polynomial[11] = {
        0.3333333333333333,   -0.1999999999999552, 0.14285714284666542,  -0.11111111015256361,
        0.09090904578123903,  -0.07692183190826087, 0.06664511447381948, -0.0585814891280221,
        0.0508544973794026,   -0.03923165829558719, 0.01917688711906226,
    };
    const double tan_eighth = 0.41421356237309503, quarter_pi = 0.7853981633974483, half_pi = 1.5707963267948966;
    double a = abs_number(x), high = max_number(a, y), low = min_number(a, y), base = 0.0;
    if (high == 0.0) return 0.0;
    double u = low / high;
    if (u > tan_eighth) {
        u = (low - high) / (low + high);
        base = quarter_pi;
    }
    double z = u * u, sum = polynomial[10];
    for (int k = 9; k >= 0; k--) sum = polynomial[k] + z * sum;
    double angle = base + (u - u * z * sum);
    if (y > a) angle = half_pi - angle;
    return x < 0.0 ? 2.0 * half_pi - angle : angle;
}

#endif
