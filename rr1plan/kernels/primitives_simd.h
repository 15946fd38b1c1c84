// Eight points against one obstacle with a closed form: distance, speed of approach, nearest point, support.
#ifndef RR1_PRIMITIVES_SIMD_H
#define RR1_PRIMITIVES_SIMD_H

#include "obstacle_tables.h"
#include "scene_tables.h"

// A direction in world axes, expressed in the obstacle's axes.
INLINE Vec8 to_obstacle(const ObstacleShape *shape, Vec8 v) {
    const double *R = shape->rotation;
    return (Vec8){
        v.x * R[0] + v.y * R[3] + v.z * R[6],
        v.x * R[1] + v.y * R[4] + v.z * R[7],
        v.x * R[2] + v.y * R[5] + v.z * R[8],
    };
}

// A direction in the obstacle's axes, expressed in world axes.
INLINE Vec8 turned_from_obstacle(const ObstacleShape *shape, Vec8 v) {
    const double *R = shape->rotation;
    return (Vec8){
        v.x * R[0] + v.y * R[1] + v.z * R[2],
        v.x * R[3] + v.y * R[4] + v.z * R[5],
        v.x * R[6] + v.y * R[7] + v.z * R[8],
    };
}

INLINE Vec8 from_obstacle(const ObstacleShape *shape, Vec8 v) {
    return vec8_add(turned_from_obstacle(shape, v), vec8_splat(shape->center));
}

INLINE Vec8 from_center(const ObstacleShape *shape, Vec8 p) {
    return (Vec8){p.x - shape->center[0], p.y - shape->center[1], p.z - shape->center[2]};
}

INLINE f64x8 clamp(f64x8 value, f64x8 low, f64x8 high) { return max_lanes(min_lanes(value, high), low); }

// Square of the distance from points to an obstacle's core, or a lower bound [m^2].
INLINE f64x8 square_to(const ObstacleTables *obstacles, int64_t o, Vec8 point) {
    const ObstacleShape *shape = &obstacles->shapes[o];
    f64x8 zero = splat(0.0);
    Vec8 p = to_obstacle(shape, from_center(shape, point));
    f64x8 a = abs_lanes(p.x), b = abs_lanes(p.y);
    f64x8 c = max_lanes(max_lanes(p.z - shape->half[2], shape->low - p.z), zero);
    if (obstacles->kinds[o].kind == OBSTACLE_CYLINDER) {
        a = max_lanes(sqrt_lanes(a * a + b * b) - shape->half[0], zero);
        return a * a + c * c;
    }
    a = max_lanes(a - shape->half[0], zero);
    b = max_lanes(b - shape->half[1], zero);
    return a * a + b * b + c * c;
}

// Vectors from the nearest points of an obstacle's core to points, in the obstacle's axes.
INLINE Vec8 away_from(const ObstacleTables *obstacles, int64_t o, Vec8 point) {
    const ObstacleShape *shape = &obstacles->shapes[o];
    Vec8 p = to_obstacle(shape, from_center(shape, point));
    f64x8 c = p.z - clamp(p.z, splat(shape->low), splat(shape->half[2]));
    if (obstacles->kinds[o].kind == OBSTACLE_CYLINDER) {
        f64x8 across = sqrt_lanes(p.x * p.x + p.y * p.y);
        f64x8 part = max_lanes(across - shape->half[0], splat(0.0)) / max_lanes(across, splat(1e-12));
        return (Vec8){p.x * part, p.y * part, c};
    }
    f64x8 a = p.x - clamp(p.x, splat(-shape->half[0]), splat(shape->half[0]));
    f64x8 b = p.y - clamp(p.y, splat(-shape->half[1]), splat(shape->half[1]));
    return (Vec8){a, b, c};
}

// Distance to an obstacle's core times the absolute speed along the direction from its nearest point [m^2].
INLINE f64x8 approach_to(const ObstacleTables *obstacles, int64_t o, Vec8 point, Vec8 velocity) {
    Vec8 v = to_obstacle(&obstacles->shapes[o], velocity);
    return abs_lanes(vec8_dot(away_from(obstacles, o, point), v)) * SLACK;
}

// The points of an obstacle's core that are nearest to points; not for a half-space.
INLINE Vec8 nearest_in(const ObstacleTables *obstacles, int64_t o, Vec8 point) {
    const ObstacleShape *shape = &obstacles->shapes[o];
    Vec8 p = to_obstacle(shape, from_center(shape, point));
    p.z = clamp(p.z, splat(-shape->half[2]), splat(shape->half[2]));
    if (obstacles->kinds[o].kind == OBSTACLE_CYLINDER) {
        f64x8 across = sqrt_lanes(p.x * p.x + p.y * p.y);
        f64x8 part = min_lanes(across, splat(shape->half[0])) / max_lanes(across, splat(1e-12));
        p.x = p.x * part;
        p.y = p.y * part;
    } else {
        p.x = clamp(p.x, splat(-shape->half[0]), splat(shape->half[0]));
        p.y = clamp(p.y, splat(-shape->half[1]), splat(shape->half[1]));
    }
    return from_obstacle(shape, p);
}

// A bound along directions, and the point of a core that attains it.
typedef struct {
    f64x8 along;
    Vec8 point;
} Support8;

// The greatest n.p over an obstacle's core, n a direction, and the point p; not for a half-space.
INLINE Support8 farthest_in(const ObstacleTables *obstacles, int64_t o, Vec8 n) {
    const ObstacleShape *shape = &obstacles->shapes[o];
    Vec8 d = to_obstacle(shape, n);
    f64x8 zero = splat(0.0);
    Vec8 p;
    p.z = select_less(d.z, zero, splat(-shape->half[2]), splat(shape->half[2]));
    if (obstacles->kinds[o].kind == OBSTACLE_CYLINDER) {
        f64x8 part = shape->half[0] / max_lanes(sqrt_lanes(d.x * d.x + d.y * d.y), splat(1e-12));
        p.x = d.x * part;
        p.y = d.y * part;
    } else {
        p.x = select_less(d.x, zero, splat(-shape->half[0]), splat(shape->half[0]));
        p.y = select_less(d.y, zero, splat(-shape->half[1]), splat(shape->half[1]));
    }
    p = from_obstacle(shape, p);
    return (Support8){vec8_dot(n, p), p};
}

#endif
