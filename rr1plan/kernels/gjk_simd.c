// Search for a separating direction of two convex bodies that spheres do not prove apart, eight configurations at once.
//
// Each step takes the direction to the point nearest to the origin of a growing simplex in the difference of the bodies
// (Gilbert, Johnson and Keerthi, A fast procedure for computing the distance between complex objects in
// three-dimensional space, 1988); a triangle of it is kept. See support_simd.h for what a direction proves.
//
// The points found lie in the bodies. If they are nearer than the padding, so are the bodies.
#include "simplex_simd.h"
#include "support_simd.h"

// Searches longer than this are rare.
#define GJK_STEPS 24
// A gap along a direction is good enough if it is this fraction of the distance found.
#define GJK_GOOD 0.9

// Bits of the lanes that stay open, of those in which even the middle of the interval is not proven, and of those with
// a contact in the middle.
typedef struct {
    uint64_t open;
    uint64_t stuck;
    uint64_t touching;
} Separation8;

// A triangle in the world, the vectors with which the search for directions begins, and the best directions found.
typedef struct {
    const double *corners;
    Vec8 begin;
    int within;
    Vec8 found;
} MeshTriangle8;

// The pair to separate: a body, and another body or an obstacle.
typedef struct {
    int64_t core;
    int64_t other_core;    // -1: an obstacle with a closed form
    int64_t obstacle;      // its number
    int64_t base;          // frame that carries both, 0: the world
    int64_t pair;
    int64_t sphere;        // one of each body, too near each other; equal for an obstacle
    int64_t other_sphere;
    double padding;        // distance to keep [m]
    double acceleration;   // bound of the relative acceleration
    MeshTriangle8 *triangle;  // of a mesh, instead of the closed form of an obstacle; null: none
} GjkQuery;

// For a half-space, the only direction is its normal.
static Separation8 separate_half_space(const GjkQuery *query, uint64_t lanes, f64x8 h, const SceneTables *scene,
                                       const Scratch *scratch) {
    const ObstacleShape *shape = &scene->obstacles->shapes[query->obstacle];
    const FrameLanes *frame = &scratch->frames[scene->arm->cores[query->core].frame];
    const double *R = shape->rotation, *p = shape->center;
    double beyond = R[2] * p[0] + R[5] * p[1] + R[8] * p[2] + scene->arm->core_shapes[query->core].radius;
    double needed = query->padding + scene->margin;
    Vec8 n = {splat(R[2]), splat(R[5]), splat(R[8])};
    Support8 low = lowest_of(scene->arm, query->core, to_frame(frame, n), lanes);
    f64x8 gap = low.along + along_origin(frame, n) - beyond;
    uint64_t stuck = less_than(gap, splat(needed)) & lanes;
    uint64_t touching = less_than(gap, splat(query->padding - scene->margin)) & lanes;
    if (touching) return (Separation8){lanes, stuck, touching};
    f64x8 lost = beyond + h * h * (0.5 * query->acceleration);
    gap = lowest_within(query->core, n, low.point, 0, lanes, h, scene, scratch) - lost;
    return (Separation8){less_than(gap, splat(needed)) & lanes, stuck, 0};
}

// The vector with which a search begins, and whether it connects points of the cores.
typedef struct {
    Vec8 point;
    int within;
} GjkBegin;

// The vector from the other object to the sphere that is too near, or the last direction on this edge.
INLINE GjkBegin begin_search(const GjkQuery *query, const SceneTables *scene, Scratch *scratch) {
    if (query->triangle) return (GjkBegin){query->triangle->begin, query->triangle->within};
    DirectionSeed *seed = &scratch->seeds[query->pair];
    if (seed->edge == scratch->edge) return (GjkBegin){vec8_splat(seed->direction), 0};
    seed->edge = scratch->edge;
    Vec8 point = center_of(&scratch->spheres[query->sphere]), other;
    // A ball inside the body has this center.
    int within = scene->arm->spheres[query->sphere].inner_radius > 0.0;
    if (query->other_core < 0) {
        other = nearest_in(scene->obstacles, query->obstacle, point);
    } else if (query->sphere == query->other_sphere) {
        Vec8 middle = vec8_splat(scene->arm->core_shapes[query->other_core].middle);
        other = to_world(&scratch->frames[scene->arm->cores[query->other_core].frame], middle);
    } else {
        other = center_of(&scratch->spheres[query->other_sphere]);
        within &= scene->arm->spheres[query->other_sphere].inner_radius > 0.0;
    }
    return (GjkBegin){vec8_sub(point, other), within};
}

// The greatest n.p over the other core, n a direction in world axes; the point p in the world and in the core's frame.
typedef struct {
    f64x8 along;
    Vec8 point;
    Vec8 local;
} OtherSupport;

INLINE OtherSupport highest_of_triangle(const double *corners, Vec8 n) {
    OtherSupport best = {splat(-1e300), n, n};
    for (int k = 0; k < 3; k++) {
        Vec8 p = vec8_splat(corners + 3 * k);
        f64x8 along = vec8_dot(n, p);
        i64x8 higher = along > best.along;
        best.point = vec8_select(higher, p, best.point);
        best.along = select_mask(higher, along, best.along);
    }
    best.local = best.point;
    return best;
}

INLINE OtherSupport highest_of_other(const GjkQuery *query, Vec8 n, uint64_t lanes, const SceneTables *scene,
                                     const Scratch *scratch) {
    if (query->triangle) return highest_of_triangle(query->triangle->corners, n);
    if (query->other_core < 0) {
        Support8 high = farthest_in(scene->obstacles, query->obstacle, n);
        return (OtherSupport){high.along, high.point, high.point};
    }
    const FrameLanes *frame = &scratch->frames[scene->arm->cores[query->other_core].frame];
    Support8 low = lowest_of(scene->arm, query->other_core, vec8_negative(to_frame(frame, n)), lanes);
    return (OtherSupport){along_origin(frame, n) - low.along, to_world(frame, low.point), low.point};
}

// The least gap of two cores along directions while they move at their current velocities [m].
//
// `low`, `high`: points of the cores in their frames; the search is faster the lower and the higher they are.
static f64x8 gap_within(const GjkQuery *query, Vec8 n, Vec8 low, Vec8 high, uint64_t lanes, f64x8 h,
                        const SceneTables *scene, const Scratch *scratch) {
    f64x8 gap = lowest_within(query->core, n, low, query->base, lanes, h, scene, scratch);
    if (query->other_core < 0) return gap - highest_of_other(query, n, lanes, scene, scratch).along;
    return gap + lowest_within(query->other_core, vec8_negative(n), high, query->base, lanes, h, scene, scratch);
}

// Store the direction found in the first open lane: the next search on this edge begins with it.
static void end_search(int64_t pair, uint64_t left, Vec8 n, Scratch *scratch) {
    int64_t lane = first_bit(left);
    double *direction = scratch->seeds[pair].direction;
    direction[0] = n.x[lane];
    direction[1] = n.y[lane];
    direction[2] = n.z[lane];
}

// Separate a body from another or from an obstacle, in the given lanes; h: half widths of the intervals.
NOINLINE Separation8 gjk_simd(const GjkQuery *query, uint64_t lanes, f64x8 h,
                                                      const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const FrameLanes *frame = &scratch->frames[arm->cores[query->core].frame];
    double padding = query->padding, needed = padding + scene->margin;
    double radius = arm->core_shapes[query->core].radius;
    radius += query->other_core < 0 ? scene->obstacles->shapes[query->obstacle].radius
                                    : arm->core_shapes[query->other_core].radius;
    f64x8 lost = h * h * (0.5 * query->acceleration);
    // The point nearest to the origin so far, and three points of the difference of the bodies around it.
    GjkBegin begin = begin_search(query, scene, scratch);
    Vec8 nearest = begin.point;
    f64x8 square = vec8_dot(nearest, nearest);
    // A point at the origin has no direction: any finite vector will do, since the lane is found to touch.
    Vec8 n = vec8_scale(nearest, 1.0 / max_lanes(sqrt_lanes(square), splat(1e-12)));
    f64x8 best = splat(-1e300);
    Vec8 best_n = n, a = nearest, b = nearest, c = nearest, low_point = n, high_point = n;
    f64x8 largest = square;  // of the points' squares
    for (int step = 0; step < GJK_STEPS; step++) {
        Support8 low = lowest_of(arm, query->core, to_frame(frame, n), lanes);
        OtherSupport high = highest_of_other(query, n, lanes, scene, scratch);
        low_point = low.point;
        high_point = high.local;
        f64x8 gap = low.along + along_origin(frame, n) - high.along - radius;
        i64x8 better = best < gap;
        best_n = vec8_select(better, n, best_n);
        best = select_mask(better, gap, best);
        if (query->triangle) query->triangle->found = best_n;
        if ((less_than(best, splat(needed)) & lanes) == 0) {
            // All middles are proven; a bound of the motion of any point along the direction may prove the intervals.
            f64x8 travel = h * fastest_along(query->core, best_n, query->base, scene, scratch);
            if (query->other_core >= 0)
                travel = travel + h * fastest_along(query->other_core, best_n, query->base, scene, scratch);
            if ((less_than(best - travel - lost, splat(needed)) & lanes) == 0) return (Separation8){0, 0, 0};
        }
        Vec8 w = vec8_sub(to_world(frame, low.point), high.point);
        if (step == 0 && !begin.within) {
            nearest = a = b = c = w;
            square = largest = vec8_dot(w, w);
        } else {
            largest = max_lanes(vec8_dot(w, w), largest);
            uint64_t inside = bits_of(origin_inside(w, a, b, c, largest)) & lanes;
            if (inside) return (Separation8){lanes, lanes, inside};
            Triangle8 triangle = nearest_triangle(w, a, b, c);
            a = triangle.one;
            b = triangle.two;
            c = w;
            f64x8 least = vec8_dot(triangle.nearest, triangle.nearest);
            i64x8 nearer = least < square;
            nearest = vec8_select(nearer, triangle.nearest, nearest);
            square = select_mask(nearer, least, square);
        }
        f64x8 distance = sqrt_lanes(square);
        uint64_t touching = less_than(distance - radius, splat(padding - scene->margin)) & lanes;
        if (touching) return (Separation8){lanes, lanes, touching};
        if ((less_than(best - padding, GJK_GOOD * (distance - radius - padding)) & lanes) == 0) break;
        n = vec8_scale(nearest, 1.0 / max_lanes(distance, splat(1e-9)));
    }
    uint64_t stuck = less_than(best, splat(needed)) & lanes, left = lanes;
    if (stuck != lanes) {
        f64x8 gap = gap_within(query, best_n, low_point, high_point, lanes, h, scene, scratch) - radius - lost;
        left = (less_than(gap, splat(needed)) & lanes) | stuck;
    }
    if (left && !query->triangle) end_search(query->pair, left, best_n, scratch);
    return (Separation8){left, stuck, 0};
}

static Separation8 separate_mesh(const Candidate *candidate, f64x8 h, const SceneTables *scene, Scratch *scratch);

// Separate a candidate in its open lanes.
static Separation8 separate(const Candidate *candidate, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    int64_t group = arm->bodies[candidate->body].group;
    GjkQuery query = {
        .core = candidate->body,
        .pair = candidate->pair,
        .sphere = candidate->sphere,
        .other_sphere = candidate->other_sphere,
        .padding = scene->pairs->padding[candidate->pair],
    };
    if (candidate->body_pair < 0) {
        query.other_core = scene->obstacles->core[candidate->other];
        query.obstacle = candidate->other;
        if (query.other_core == CORE_LEFT_OUT) return (Separation8){candidate->lanes, 0, 0};
        if (query.other_core == CORE_MESH) return separate_mesh(candidate, h, scene, scratch);
        query.acceleration = scratch->accelerations[group];
        if (query.other_core < 0 && scene->obstacles->kinds[query.obstacle].kind == OBSTACLE_HALF_SPACE)
            return separate_half_space(&query, candidate->lanes, h, scene, scratch);
    } else {
        int64_t shared = scene->pairs->body_pairs[candidate->body_pair].shared;
        const double *accelerations = scratch->accelerations + shared * arm->group_stride;
        query.other_core = candidate->other;
        query.obstacle = -1;
        query.base = shared ? arm->chain[arm->groups[group].first_link + shared - 1] : 0;
        query.acceleration = accelerations[group] + accelerations[arm->bodies[candidate->other].group];
    }
    return gjk_simd(&query, candidate->lanes, h, scene, scratch);
}
