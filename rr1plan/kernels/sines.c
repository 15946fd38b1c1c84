// Sines and cosines of the kernels, for callers that need the same bits.
#include "sine.h"

// For single angles of any size; shape (count,) each.
EXPORT void rr1_sine_cosine(const double *angles, int64_t count, double *sines, double *cosines) {
    for (int64_t i = 0; i < count; i++) {
        Sine of = sine_cosine(angles[i]);
        sines[i] = of.sine;
        cosines[i] = of.cosine;
    }
}

// Likewise in SIMD lanes, for angles up to MAX_LANE_ANGLE; the count is a multiple of LANES.
EXPORT void rr1_sine_cosine_lanes(const double *angles, int64_t count, double *sines, double *cosines) {
    for (int64_t i = 0; i < count; i += LANES) {
        SineLanes of = sine_cosine_lanes(load_lanes(angles + i));
        store_lanes(sines + i, of.sine);
        store_lanes(cosines + i, of.cosine);
    }
}
