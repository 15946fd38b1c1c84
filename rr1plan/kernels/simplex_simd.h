// The points of simplices nearest to the origin, eight simplices at once.
#ifndef RR1_SIMPLEX_SIMD_H
#define RR1_SIMPLEX_SIMD_H

#include "simd.h"

// The point w + s a + t b nearest to the origin, of a triangle with edges a and b at its corner w; its squared norm.
typedef struct {
    f64x8 s, t, square;
} TriangleNearest;

// From all dot products of w and the edges a and b. If the nearest point is on the edge opposite w: another point.
INLINE TriangleNearest nearest_in_triangle(f64x8 ww, f64x8 wa, f64x8 wb, f64x8 aa, f64x8 ab, f64x8 bb) {
    f64x8 zero = splat(0.0), one = splat(1.0), tiny = splat(1e-300);
    f64x8 det = aa * bb - ab * ab;
    f64x8 scale = 1.0 / max_lanes(det, tiny);
    f64x8 s = (ab * wb - bb * wa) * scale;
    f64x8 t = (ab * wa - aa * wb) * scale;
    i64x8 inside = (aa * bb * 1e-10 < det) & ~(s < zero) & ~(t < zero) & ~(one < s + t);
    f64x8 along_a = max_lanes(min_lanes(-wa / max_lanes(aa, tiny), one), zero);
    f64x8 along_b = max_lanes(min_lanes(-wb / max_lanes(bb, tiny), one), zero);
    f64x8 on_a = ww + along_a * (2.0 * wa + along_a * aa);
    f64x8 on_b = ww + along_b * (2.0 * wb + along_b * bb);
    f64x8 square = ww + s * (2.0 * wa + s * aa) + t * (2.0 * wb + t * bb) + 2.0 * s * t * ab;
    i64x8 a_nearer = on_a < on_b;
    f64x8 edge_s = select_mask(a_nearer, along_a, zero), edge_t = select_mask(a_nearer, zero, along_b);
    f64x8 edge_square = select_mask(a_nearer, on_a, on_b);
    return (TriangleNearest){
        select_mask(inside, s, edge_s),
        select_mask(inside, t, edge_t),
        select_mask(inside, square, edge_square),
    };
}

// The point w + s e + t f.
INLINE Vec8 weighted_sum(Vec8 w, f64x8 s, Vec8 e, f64x8 t, Vec8 f) {
    return (Vec8){w.x + s * e.x + t * f.x, w.y + s * e.y + t * f.y, w.z + s * e.z + t * f.z};
}

// For the triangles of a new corner with two of three others: the point nearest to the origin, and those two.
typedef struct {
    Vec8 nearest;
    Vec8 one, two;
} Triangle8;

INLINE Triangle8 nearest_triangle(Vec8 w, Vec8 a, Vec8 b, Vec8 c) {
    Vec8 e = vec8_sub(a, w), f = vec8_sub(b, w), g = vec8_sub(c, w);
    f64x8 ww = vec8_dot(w, w), we = vec8_dot(w, e), wf = vec8_dot(w, f), wg = vec8_dot(w, g);
    f64x8 ee = vec8_dot(e, e), ff = vec8_dot(f, f), gg = vec8_dot(g, g);
    f64x8 ef = vec8_dot(e, f), eg = vec8_dot(e, g), fg = vec8_dot(f, g);
    TriangleNearest first = nearest_in_triangle(ww, we, wf, ee, ef, ff);
    TriangleNearest second = nearest_in_triangle(ww, we, wg, ee, eg, gg);
    TriangleNearest third = nearest_in_triangle(ww, wf, wg, ff, fg, gg);
    i64x8 nearer = second.square < first.square;
    Vec8 nearest = vec8_select(nearer, weighted_sum(w, second.s, e, second.t, g),
                               weighted_sum(w, first.s, e, first.t, f));
    Vec8 two = vec8_select(nearer, c, b);
    f64x8 least = min_lanes(second.square, first.square);
    nearer = third.square < least;
    return (Triangle8){
        vec8_select(nearer, weighted_sum(w, third.s, f, third.t, g), nearest),
        vec8_select(nearer, b, a),
        vec8_select(nearer, c, two),
    };
}

// The product a . (b x c).
INLINE f64x8 volume_of(Vec8 a, Vec8 b, Vec8 c) { return vec8_dot(a, vec8_cross(b, c)); }

// Lanes in which the origin is well inside the tetrahedron of four points; largest: their largest squared norm.
//
// A volume of points with coordinates up to m has an error of a few 1e-16 m^3. If the points and the origin are nearly
// in one plane (bodies of a planar arm, or a corner found twice), volumes are mere rounding errors and prove nothing.
INLINE i64x8 origin_inside(Vec8 w, Vec8 a, Vec8 b, Vec8 c, f64x8 largest) {
    f64x8 one = volume_of(a, b, c), two = -volume_of(w, b, c);
    f64x8 three = volume_of(w, a, c), four = -volume_of(w, a, b);
    f64x8 low = min_lanes(min_lanes(one, two), min_lanes(three, four));
    f64x8 high = max_lanes(max_lanes(one, two), max_lanes(three, four));
    // All have one sign, and none is as small as rounding errors; m^3 is at most the greater of m^2 and m^4.
    f64x8 rounding = 1e-14 * (largest * max_lanes(largest, splat(1.0)));
    return max_lanes(low, -high) - 1e-9 * max_lanes(high, -low) >= rounding;
}

#endif
