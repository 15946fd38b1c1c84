// Spheres against obstacles and each other, in eight configurations of an edge.
//
// Moving bodies are covered by spheres. Let the center of a sphere have velocity v along the edge and an acceleration
// of at most a. For the time h before and after a configuration, it stays within |n.v| h + a h^2 / 2 of its position,
// measured along any direction n. With n the direction from the nearest point of an obstacle (or from the other
// sphere), this bounds the decrease of the gap, because the obstacle is convex. A contact of a ball inside a body
// proves a contact of the body.
#include "support_simd.h"

// Result for a candidate: open lanes, lanes with a proven contact, and a sphere of each body, which are too near.
typedef struct {
    uint64_t open;
    uint64_t touching;
    int64_t sphere;
    int64_t other_sphere;
} SphereTest;

// Place the ball around a body, once in a batch.
INLINE void ready_ball(int64_t body, int64_t batch, const SceneTables *scene, Scratch *scratch) {
    int64_t *placed = &scratch->placed_batch[body];
    if (*placed != batch && *placed != -batch) {
        *placed = -batch;
        const Body *of = &scene->arm->bodies[body];
        place_centers(of->joint, of->first_sphere, of->first_sphere + 1, scene, scratch);
    }
}

// Place the spheres of a body whose ball is placed, once in a batch.
INLINE void ready_spheres(int64_t body, int64_t batch, const SceneTables *scene, Scratch *scratch) {
    if (scratch->placed_batch[body] != batch) {
        scratch->placed_batch[body] = batch;
        const Body *of = &scene->arm->bodies[body];
        place_centers(of->joint, of->first_sphere + 1, of->last_sphere, scene, scratch);
    }
}

// Least squared distance of two points [m^2] for which gaps along the direction between them are precise enough.
#define LEAST_SQUARE 1e-6

// The lanes in which two objects may come too near.
//
// With d the distance of two points and l the gap of two objects along the line through both, the test is l < m. To
// avoid quotients and roots, it is multiplied by d and squared: l d is negative, or its square is less than d^2 m^2.
//
// left: l d; square: d^2; needed: m, not negative.
INLINE uint64_t lanes_too_near(f64x8 left, f64x8 square, f64x8 needed) {
    return less_than(left, splat(0.0)) | less_than(left * left, square * (needed * needed)) |
           less_than(square, splat(LEAST_SQUARE));
}

// The least and the greatest n.(p - c) over points p of the box around a group, c the center of its ball.
typedef struct {
    f64x8 least, greatest;
} BoxExtent;

INLINE BoxExtent extent_along(int64_t group, Vec8 n, const SceneTables *scene, const Scratch *scratch) {
    const Box *box = &scene->arm->group_boxes[group];
    Vec8 local = to_frame(&scratch->frames[scene->arm->groups[group].joint], n);
    f64x8 low[3] = {local.x * box->low[0], local.y * box->low[1], local.z * box->low[2]};
    f64x8 high[3] = {local.x * box->high[0], local.y * box->high[1], local.z * box->high[2]};
    return (BoxExtent){
        min_lanes(low[0], high[0]) + min_lanes(low[1], high[1]) + min_lanes(low[2], high[2]),
        max_lanes(low[0], high[0]) + max_lanes(low[1], high[1]) + max_lanes(low[2], high[2]),
    };
}

// ---- against obstacles ---------------------------------------------------------------------------------------------

// The given lanes in which a sphere of a group may come too near an obstacle.
//
// With d the distance of the center from the obstacle's core, r the least distance allowed and s the speed along it,
// this is d - s h < r + a h^2 / 2.
INLINE uint64_t lanes_near_obstacle(SphereRef sphere, int64_t o, double padding, uint64_t lanes, f64x8 h,
                                    const SceneTables *scene, const Scratch *scratch) {
    const SphereLanes *placed = &scratch->spheres[sphere.index];
    double radius = scene->arm->spheres[sphere.index].radius + scene->obstacles->shapes[o].radius;
    double needed = radius + padding + scene->margin;
    Vec8 center = center_of(placed);
    f64x8 square = square_to(scene->obstacles, o, center);
    f64x8 limit = h * scratch->speeds[sphere.group] + needed;
    lanes &= less_than(square, limit * limit);
    // Lanes that are too near without any motion need no speeds.
    uint64_t others = lanes & ~less_than(square, splat(needed * needed));
    if (others == 0) return lanes;
    Vec8 velocity = velocity_of(sphere, scene, scratch);
    double acceleration = scratch->accelerations[sphere.group];
    f64x8 approach = approach_to(scene->obstacles, o, center, velocity);
    return (lanes & ~others) | (others & lanes_too_near(square - approach * h, square, needed + h * h * (0.5 * acceleration)));
}

// The given lanes in which the box around a group may come too near an obstacle.
INLINE uint64_t lanes_near_box(int64_t group, int64_t o, double padding, uint64_t lanes, f64x8 h,
                               const SceneTables *scene, const Scratch *scratch) {
    const ObstacleShape *shape = &scene->obstacles->shapes[o];
    Vec8 away = away_from(scene->obstacles, o, center_of(&scratch->spheres[scene->arm->groups[group].ball]));
    f64x8 square = vec8_dot(away, away);
    f64x8 left = square + extent_along(group, turned_from_obstacle(shape, away), scene, scratch).least;
    f64x8 needed = h * scratch->speeds[group] + (shape->radius + padding + scene->margin);
    return lanes & lanes_too_near(left, square, needed);
}

// Test a body against an obstacle; the ball around the body is placed and may be too near.
INLINE SphereTest test_obstacle(int64_t body, int64_t o, int64_t pair, uint64_t lanes, int64_t batch, f64x8 h,
                                const SceneTables *scene, Scratch *scratch) {
    const Body *of = &scene->arm->bodies[body];
    const LinkSphere *spheres = scene->arm->spheres;
    int64_t ball = of->first_sphere, count = 0;
    double padding = scene->pairs->padding[pair], kept = padding + scene->obstacles->shapes[o].radius;
    f64x8 travel = h * scratch->speeds[of->group];
    ready_spheres(body, batch, scene, scratch);
    // Contacts first: once one is found no speeds are needed.
    for (int64_t i = ball + 1; i < of->last_sphere; i++) {
        const SphereLanes *placed = &scratch->spheres[i];
        f64x8 square = square_to(scene->obstacles, o, center_of(placed));
        f64x8 limit = travel + (spheres[i].radius + kept + scene->margin);
        uint64_t near = less_than(square, limit * limit) & lanes;
        if (near) {
            double inner = spheres[i].inner_radius + kept - scene->margin;
            if (inner > 0.0 && scene->obstacles->kinds[o].is_exact) {
                uint64_t touching = less_than(square, splat(inner * inner)) & near;
                if (touching) return (SphereTest){near, touching, i, i};
            }
            scratch->near_spheres[count++] = (Near){i, near};
        }
    }
    uint64_t open = 0;
    int64_t last = ball;
    for (int64_t n = 0; n < count; n++) {
        int64_t i = scratch->near_spheres[n].index;
        uint64_t near = scratch->near_spheres[n].lanes & ~open;
        if (near) near = lanes_near_obstacle(sphere_in(of, i), o, padding, near, h, scene, scratch);
        if (near) {
            open |= near;
            last = i;
        }
    }
    return (SphereTest){open, 0, last, last};
}

// ---- against each other --------------------------------------------------------------------------------------------

// Square of the distance of the centers of two spheres [m^2].
INLINE f64x8 square_between(int64_t one, int64_t two, const Scratch *scratch) {
    Vec8 d = vec8_sub(center_of(&scratch->spheres[one]), center_of(&scratch->spheres[two]));
    return vec8_dot(d, d);
}

// The given lanes in which spheres of two groups may come too near each other.
//
// shared: number of joints of their chains that move both; velocity_one, velocity_two: null to compute them if needed.
INLINE uint64_t lanes_near_moving(SphereRef one, SphereRef two, const Vec8 *velocity_one, const Vec8 *velocity_two,
                                  int64_t shared, uint64_t lanes, double padding, f64x8 h, const SceneTables *scene,
                                  const Scratch *scratch) {
    const SphereLanes *a = &scratch->spheres[one.index], *b = &scratch->spheres[two.index];
    const double *speeds = scratch->speeds + shared * scene->arm->group_stride;
    const double *accelerations = scratch->accelerations + shared * scene->arm->group_stride;
    double radius = scene->arm->spheres[one.index].radius + scene->arm->spheres[two.index].radius;
    double needed = radius + padding + scene->margin;
    Vec8 d = vec8_sub(center_of(a), center_of(b));
    f64x8 square = vec8_dot(d, d);
    f64x8 limit = h * (speeds[one.group] + speeds[two.group]) + needed;
    lanes &= less_than(square, limit * limit);
    uint64_t others = lanes & ~less_than(square, splat(needed * needed));
    if (others == 0) return lanes;
    Vec8 velocity = vec8_sub(velocity_one ? *velocity_one : velocity_of(one, scene, scratch),
                             velocity_two ? *velocity_two : velocity_of(two, scene, scratch));
    f64x8 approach = abs_lanes(vec8_dot(d, velocity)) * SLACK;
    double acceleration = accelerations[one.group] + accelerations[two.group];
    return (lanes & ~others) | (others & lanes_too_near(square - approach * h, square, needed + h * h * (0.5 * acceleration)));
}

INLINE uint64_t lanes_near_sphere(SphereRef one, SphereRef two, int64_t shared, uint64_t lanes, double padding,
                                  f64x8 h, const SceneTables *scene, const Scratch *scratch) {
    return lanes_near_moving(one, two, 0, 0, shared, lanes, padding, h, scene, scratch);
}

// The given lanes in which the boxes around two groups may come too near each other.
INLINE uint64_t lanes_near_boxes(int64_t one, int64_t two, int64_t shared, uint64_t lanes, double padding, f64x8 h,
                                 const SceneTables *scene, const Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const double *speeds = scratch->speeds + shared * arm->group_stride;
    Vec8 d = vec8_sub(center_of(&scratch->spheres[arm->groups[one].ball]),
                      center_of(&scratch->spheres[arm->groups[two].ball]));
    f64x8 square = vec8_dot(d, d);
    f64x8 left = square + extent_along(one, d, scene, scratch).least - extent_along(two, d, scene, scratch).greatest;
    return lanes & lanes_too_near(left, square, h * (speeds[one] + speeds[two]) + (padding + scene->margin));
}

// Test a body against another; the balls around both are placed.
INLINE SphereTest test_body(const BodyPair *bodies, uint64_t lanes, int64_t batch, f64x8 h, const SceneTables *scene,
                            Scratch *scratch) {
    const Body *a = &scene->arm->bodies[bodies->body], *b = &scene->arm->bodies[bodies->other];
    const LinkSphere *spheres = scene->arm->spheres;
    SphereRef ball_a = ball_around(a), ball_b = ball_around(b);
    int64_t shared = bodies->shared, count = 0;
    uint64_t some = 0;
    double padding = scene->pairs->padding[bodies->pair];
    ready_spheres(bodies->body, batch, scene, scratch);
    ready_spheres(bodies->other, batch, scene, scratch);
    Vec8 velocity_a = velocity_of(ball_a, scene, scratch), velocity_b = velocity_of(ball_b, scene, scratch);
    // Only the spheres of each body that are near the ball around the other.
    for (int64_t k = ball_b.index + 1; k < b->last_sphere; k++) {
        uint64_t near = lanes_near_moving(ball_a, sphere_in(b, k), &velocity_a, 0, shared, lanes, padding, h, scene,
                                          scratch);
        scratch->near_spheres[count] = (Near){k, near};
        count += near != 0;
        some |= near;
    }
    SphereTest found = {0, 0, ball_a.index, ball_b.index};
    // Lanes that stay open need no further test.
    for (int64_t i = ball_a.index + 1; (some & ~found.open) && i < a->last_sphere; i++) {
        uint64_t beside = lanes_near_moving(sphere_in(a, i), ball_b, 0, &velocity_b, shared, some & ~found.open,
                                            padding, h, scene, scratch);
        for (int64_t n = 0; beside && n < count; n++) {
            int64_t k = scratch->near_spheres[n].index;
            uint64_t near = scratch->near_spheres[n].lanes & beside & ~found.open;
            if (near == 0) continue;
            // Contacts first: they need no speeds.
            double inner = spheres[i].inner_radius + spheres[k].inner_radius + padding - scene->margin;
            if (inner > 0.0) {
                uint64_t touching = less_than(square_between(i, k, scratch), splat(inner * inner)) & near;
                if (touching) return (SphereTest){near, touching, i, k};
            }
            near = lanes_near_sphere(sphere_in(a, i), sphere_in(b, k), shared, near, padding, h, scene, scratch);
            if (near == 0) continue;
            found.open |= near;
            found.sphere = i;
            found.other_sphere = k;
        }
    }
    return found;
}
