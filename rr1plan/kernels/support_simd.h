// Extent of cores along directions, in eight configurations and during the intervals around them.
//
// The gap of two bodies along a direction n is the least n.a over points a of one minus the greatest n.b over points b
// of the other, a lower bound of their distance. In the time h before and after, a point with velocity v and an
// acceleration of at most c approaches along n by at most |n.v| h + c h^2 / 2, so points prove a whole interval too.
#ifndef RR1_SUPPORT_SIMD_H
#define RR1_SUPPORT_SIMD_H

#include "primitives_simd.h"
#include "support_table.h"

// Directions in world axes, expressed in a frame.
INLINE Vec8 to_frame(const FrameLanes *frame, Vec8 n) {
    const f64x8 *R = frame->rotation;
    return (Vec8){
        R[0] * n.x + R[3] * n.y + R[6] * n.z,
        R[1] * n.x + R[4] * n.y + R[7] * n.z,
        R[2] * n.x + R[5] * n.y + R[8] * n.z,
    };
}

// Points in a frame, expressed in the world.
INLINE Vec8 to_world(const FrameLanes *frame, Vec8 p) {
    const f64x8 *R = frame->rotation;
    return (Vec8){
        R[0] * p.x + R[1] * p.y + R[2] * p.z + frame->origin[0],
        R[3] * p.x + R[4] * p.y + R[5] * p.z + frame->origin[1],
        R[6] * p.x + R[7] * p.y + R[8] * p.z + frame->origin[2],
    };
}

// Coordinate of a frame's origin along directions in world axes.
INLINE f64x8 along_origin(const FrameLanes *frame, Vec8 n) {
    return n.x * frame->origin[0] + n.y * frame->origin[1] + n.z * frame->origin[2];
}

// For directions with a smaller component across the axis of a cylinder, the lowest point found is inside the rim.
#define LEAST_ACROSS 1e-6

INLINE Support8 lowest_of_cylinder(const Vec3 *points, Vec8 n) {
    const Vec3 *center = points, *axis = points + 1;
    double half_length = points[2].x, radius = points[2].y;
    f64x8 along = n.x * axis->x + n.y * axis->y + n.z * axis->z;
    Vec8 across = {n.x - along * axis->x, n.y - along * axis->y, n.z - along * axis->z};
    f64x8 length = sqrt_lanes(vec8_dot(across, across));
    // n.p is the sum of its parts: if n is along the axis, the rounding of `across` times radius / length is not small.
    f64x8 part = -radius / max_lanes(length, splat(LEAST_ACROSS));
    f64x8 end = select_less(along, splat(0.0), splat(half_length), splat(-half_length));
    Vec8 p = {
        center->x + end * axis->x + across.x * part,
        center->y + end * axis->y + across.y * part,
        center->z + end * axis->z + across.z * part,
    };
    f64x8 middle = n.x * center->x + n.y * center->y + n.z * center->z;
    return (Support8){middle + end * along - radius * length, p};
}

// Continue the search for the lowest point with further points.
INLINE Support8 lowest_among(const Vec3 *from, const Vec3 *to, Vec8 n, Support8 best) {
    for (const Vec3 *p = from; p < to; p++) {
        f64x8 value = n.x * p->x + n.y * p->y + n.z * p->z;
        i64x8 lower = value < best.along;
        best.point.x = select_mask(lower, splat(p->x), best.point.x);
        best.point.y = select_mask(lower, splat(p->y), best.point.y);
        best.point.z = select_mask(lower, splat(p->z), best.point.z);
        best.along = select_mask(lower, value, best.along);
    }
    return best;
}

// The least n.p over a core, n a direction in its frame, and the point p; in lanes not given, n.p of some point.
INLINE Support8 lowest_of(const ArmGeometry *arm, int64_t core, Vec8 n, uint64_t lanes) {
    const CoreRange *range = &arm->cores[core];
    const Vec3 *points = arm->points + range->first_point, *end = arm->points + range->last_point;
    if (range->kind == CORE_CYLINDER) return lowest_of_cylinder(points, n);
    Support8 best = {splat(1e300), {splat(0.0), splat(0.0), splat(0.0)}};
    if (range->per_bit == 0) return lowest_among(points, end, n, best);
    for (uint64_t left = lowest_candidates(arm, core, n, lanes); left; left &= left - 1) {
        const Vec3 *from = points + first_bit(left) * range->per_bit, *to = from + range->per_bit;
        best = lowest_among(from, to < end ? to : end, n, best);
    }
    return best;
}

// The speed of a core's point p along directions in world axes, relative to another frame, is constant + turning.p.
typedef struct {
    f64x8 constant;
    Vec8 turning;
} Speed8;

INLINE Speed8 speeds_along(const FrameLanes *frame, const FrameLanes *base, Vec8 n) {
    const f64x8 *b = base->angular;
    Vec8 d = {frame->origin[0] - base->origin[0], frame->origin[1] - base->origin[1],
              frame->origin[2] - base->origin[2]};
    f64x8 u = frame->linear[0] - base->linear[0] - (b[1] * d.z - b[2] * d.y);
    f64x8 v = frame->linear[1] - base->linear[1] - (b[2] * d.x - b[0] * d.z);
    f64x8 w = frame->linear[2] - base->linear[2] - (b[0] * d.y - b[1] * d.x);
    Vec8 turn = {frame->angular[0] - b[0], frame->angular[1] - b[1], frame->angular[2] - b[2]};
    // n.(w x p) = (n x w).p
    return (Speed8){n.x * u + n.y * v + n.z * w, to_frame(frame, vec8_cross(n, turn))};
}

INLINE f64x8 fastest_of(const CoreShape *shape, Speed8 speed) {
    const double *c = shape->middle;
    f64x8 center = abs_lanes(speed.constant + speed.turning.x * c[0] + speed.turning.y * c[1] + speed.turning.z * c[2]);
    return (center + sqrt_lanes(vec8_dot(speed.turning, speed.turning)) * shape->reach) * SLACK;
}

// A bound of the absolute speed of any point of a core along directions, relative to frame `base`.
INLINE f64x8 fastest_along(int64_t core, Vec8 n, int64_t base, const SceneTables *scene, const Scratch *scratch) {
    const FrameLanes *frame = &scratch->frames[scene->arm->cores[core].frame];
    return fastest_of(&scene->arm->core_shapes[core], speeds_along(frame, &scratch->frames[base], n));
}

// n.p - h |n.v| of a point.
INLINE f64x8 swept_height(const double p[3], Vec8 n, Speed8 speed, f64x8 h) {
    f64x8 value = n.x * p[0] + n.y * p[1] + n.z * p[2];
    f64x8 along = speed.constant + speed.turning.x * p[0] + speed.turning.y * p[1] + speed.turning.z * p[2];
    return value - h * abs_lanes(along);
}

// The least n.p - h |n.v| over a core, n a direction in world axes, v relative to frame `base`, in the given lanes.
//
// `low`: point of the core with which the search begins; the lower it is, the faster the search.
NOINLINE f64x8 lowest_within(int64_t core, Vec8 n, Vec8 low, int64_t base, uint64_t lanes,
                                                     f64x8 h, const SceneTables *scene, const Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const CoreRange *range = &arm->cores[core];
    const FrameLanes *frame = &scratch->frames[range->frame];
    Speed8 speed = speeds_along(frame, &scratch->frames[base], n);
    Vec8 local = to_frame(frame, n);
    f64x8 offset = along_origin(frame, n);
    if (range->kind == CORE_CYLINDER) {
        Support8 end = lowest_of_cylinder(arm->points + range->first_point, local);
        return offset + end.along - h * fastest_of(&arm->core_shapes[core], speed);
    }
    f64x8 turn = sqrt_lanes(vec8_dot(speed.turning, speed.turning)) * h;
    f64x8 best = vec8_dot(local, low) - h * abs_lanes(speed.constant + vec8_dot(speed.turning, low));
    const Ball *block = arm->blocks + range->first_block;
    for (int64_t i = range->first_point; i < range->last_point; i += BLOCK_POINTS, block++) {
        f64x8 bound = swept_height(block->center, local, speed, h) - block->radius - turn * block->radius;
        if ((less_than(bound, best) & lanes) == 0) continue;
        int64_t last = i + BLOCK_POINTS < range->last_point ? i + BLOCK_POINTS : range->last_point;
        for (int64_t p = i; p < last; p++)
            best = min_lanes(swept_height((const double *)&arm->points[p], local, speed, h), best);
    }
    return offset + best;
}

#endif
