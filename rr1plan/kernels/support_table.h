// The few points of a core that can be the lowest along a direction, precomputed for each cell of directions.
//
// Directions are divided into the cells of two squares, one for each sign of n_3, as on an unfolded octahedron:
// n / (|n_1| + |n_2| + |n_3|) without its third entry. A word holds a bit for each `per_bit` consecutive points.
#ifndef RR1_SUPPORT_TABLE_H
#define RR1_SUPPORT_TABLE_H

#include "arm_geometry.h"
#include "simd.h"

// Cells along each side of a square.
enum { DIRECTION_CELLS = 16 };
// Consecutive points of a core that are enclosed by one ball.
enum { BLOCK_POINTS = 8 };

// Bits of the points of a core that can be the lowest along directions in its frame, in the given lanes.
INLINE uint64_t lowest_candidates(const ArmGeometry *arm, int64_t core, Vec8 n, uint64_t lanes) {
    const double *A = arm->core_shapes[core].axes;
    const double half = 0.5 * DIRECTION_CELLS;
    f64x8 u = n.x * A[0] + n.y * A[3] + n.z * A[6];
    f64x8 v = n.x * A[1] + n.y * A[4] + n.z * A[7];
    f64x8 w = n.x * A[2] + n.y * A[5] + n.z * A[8];
    f64x8 part = half / max_lanes(abs_lanes(u) + abs_lanes(v) + abs_lanes(w), splat(1e-300));
    // The upper border of a cell belongs to the next one, but each cell's word holds for its borders too, so rounding
    // to the nearest middle suffices. NaN gives an index within the table as well.
    f64x8 row = max_lanes(min_lanes(round_lanes(u * part + (half - 0.5)), splat(2.0 * half - 1.0)), splat(0.0));
    f64x8 column = max_lanes(min_lanes(round_lanes(v * part + (half - 0.5)), splat(2.0 * half - 1.0)), splat(0.0));
    f64x8 cell = select_less(w, splat(0.0), splat(4.0 * half * half), splat(0.0)) + row * (2.0 * half) + column;
    // Cells are small integers: the low bits of their sum with 2^52.
    i64x8 index = (i64x8)(cell + 4503599627370496.0) & 0xfff;
    const uint64_t *words = arm->lowest + arm->cores[core].first_word;
    uint64_t found = 0;
    for (int i = 0; i < LANES; i++) found |= words[index[i]] & -(lanes >> i & 1);
    return found;
}

#endif
