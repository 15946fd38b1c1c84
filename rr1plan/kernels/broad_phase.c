// Pairs that may collide on an edge, from coarse to fine: groups of bodies, bodies, clearance maps, spheres, directions.
//
// The result is a list of candidates: a body and an obstacle or another body, and the lanes in which they are open.
#include "scene_tables.h"

// Candidates from this one on share a bit.
#define LAST_BIT 62

// Place the center of the ball around a group, and the box around it on the whole edge, for the first batch.
//
// The greatest speed of any point of the group suffices as a bound here; the speed of the ball may never be needed.
INLINE void place_box(int64_t group, double h, const SceneTables *scene, Scratch *scratch) {
    int64_t ball = scene->arm->groups[group].ball;
    place_centers(scene->arm->groups[group].joint, ball, ball + 1, scene, scratch);
    const f64x8 *center = scratch->spheres[ball].center;
    double reach = scene->arm->spheres[ball].radius + scene->margin + scene->max_padding;
    f64x8 ends[6] = {center[0], center[1], center[2], -center[0], -center[1], -center[2]};
    f64x8 low = min_of_each(ends) - (h * scratch->speeds[group] + reach);
    double *box = scratch->group_boxes + group;
    int64_t stride = scene->arm->group_stride;
    for (int k = 0; k < 3; k++) {
        box[k * stride] = low[k];
        box[(3 + k) * stride] = -low[3 + k];
    }
}

// The box around a group on the whole edge.
INLINE Box box_of(int64_t group, const SceneTables *scene, const Scratch *scratch) {
    const double *ends = scratch->group_boxes + group;
    int64_t n = scene->arm->group_stride;
    return (Box){{ends[0], ends[n], ends[2 * n]}, {ends[3 * n], ends[4 * n], ends[5 * n]}};
}

// Bits of the entries of a block whose boxes, in rows of `n` numbers, are not proven apart from a box.
INLINE uint64_t boxes_near(Box box, const NearBlock *block, const double *boxes, int64_t n) {
    const double *low = boxes + block->first, *high = low + 3 * n;
    i64x8 apart = (load_lanes(low) >= box.high[0]) | (load_lanes(low + n) >= box.high[1]) |
                  (load_lanes(low + 2 * n) >= box.high[2]) | (load_lanes(high) <= box.low[0]) |
                  (load_lanes(high + n) <= box.low[1]) | (load_lanes(high + 2 * n) <= box.low[2]);
    return bits_of(~apart) & (uint64_t)block->lanes;
}

// Report a contact, in the first of the lanes.
static void report_contact(int64_t pair, uint64_t lanes, Scratch *scratch) {
    scratch->result.status = EDGE_CONTACT;
    scratch->result.pair = pair;
    scratch->result.fraction = scratch->middles[first_bit(lanes)];
}

// Test a candidate whose balls are placed and near, and clear its lanes that are proven free. Returns 1 for a contact.
//
// What spheres leave open is separated at once, not after all other candidates: if it collides, these need no test.
NOINLINE int test_candidate(Candidate *candidate, int64_t batch, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    SphereTest found;
    if (candidate->body_pair >= 0) {
        uint64_t lanes = lanes_not_mapped(candidate->body_pair, candidate->lanes, scene, scratch);
        candidate->lanes = lanes;
        if (lanes == 0) return 0;
        found = test_body(&scene->pairs->body_pairs[candidate->body_pair], lanes, batch, h, scene, scratch);
    } else {
        found = test_obstacle(candidate->body, candidate->other, candidate->pair, candidate->lanes, batch, h, scene,
                              scratch);
    }
    candidate->lanes = found.open;
    candidate->sphere = found.sphere;
    candidate->other_sphere = found.other_sphere;
    uint64_t touching = found.touching;
    if (touching == 0 && found.open) {
        Separation8 separated = separate(candidate, h, scene, scratch);
        candidate->lanes = separated.open;
        candidate->stuck = separated.stuck;
        touching = separated.touching;
    }
    if (touching == 0) return 0;
    report_contact(candidate->pair, touching, scratch);
    return 1;
}

// Add a candidate unless it is proven free. Returns the number of candidates, or -1 for a contact.
INLINE int64_t add_candidate(int64_t count, const NearBody *near, f64x8 h, const SceneTables *scene,
                             Scratch *scratch) {
    Candidate *candidate = &scratch->candidates[count];
    candidate->body = near->body;
    candidate->other = near->other;
    candidate->body_pair = near->body_pair;
    candidate->pair = near->pair;
    candidate->lanes = near->lanes;
    if (test_candidate(candidate, 1, h, scene, scratch)) return -1;
    return candidate->lanes ? count + 1 : count;
}

// Column of the joint that carries a group.
INLINE int64_t column_of_group(int64_t group, const SceneTables *scene) {
    return scene->arm->joints[scene->arm->groups[group].joint].column;
}

// Whether a column belongs to the only arm whose pairs are open.
INLINE int is_open_column(int64_t column, const Scratch *scratch) {
    return scratch->first_open_column <= column && column < scratch->last_open_column;
}

// Whether all pairs of a group with obstacles are known to be free.
INLINE int obstacles_are_settled(int64_t group, const SceneTables *scene, const Scratch *scratch) {
    return scratch->last_open_column != 0 && !is_open_column(column_of_group(group, scene), scratch);
}

// Whether all pairs of two groups are known to be free, or left out.
INLINE int pairs_are_settled(int64_t group, int64_t other, const SceneTables *scene, const Scratch *scratch) {
    if (scratch->last_open_column == 0) return 0;
    int64_t one = column_of_group(group, scene), two = column_of_group(other, scene);
    if (!is_open_column(one, scratch) && !is_open_column(two, scratch)) return 1;
    return scratch->left_out[one] || scratch->left_out[two];
}

// List the obstacles that the ball around a group may come too near, with the lanes. Returns their number.
INLINE int64_t list_obstacles(int64_t g, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    if (scratch->has_free_end && scratch->speeds[g] == 0.0) return 0;
    if (obstacles_are_settled(g, scene, scratch)) return 0;
    SphereRef ball = ball_of_group(g, scene->arm);
    int alone = scene->arm->groups[g].last_body - scene->arm->groups[g].first_body == 1;
    int64_t count = 0;
    Box box = box_of(g, scene, scratch);
    const PairTables *pairs = scene->pairs;
    for (int64_t k = pairs->first_obstacle_block[g]; k < pairs->first_obstacle_block[g + 1]; k++) {
        const NearBlock *block = &pairs->obstacle_blocks[k];
        uint64_t near = boxes_near(box, block, scene->obstacles->boxes, scene->obstacles->count);
        for (; near; near &= near - 1) {
            int64_t o = block->first + first_bit(near);
            uint64_t lanes = lanes_near_obstacle(ball, o, scene->max_padding, ALL_LANES, h, scene, scratch);
            // A single body needs no box: its spheres are tested next.
            if (lanes && !alone) lanes = lanes_near_box(g, o, scene->max_padding, lanes, h, scene, scratch);
            scratch->near_obstacles[count] = (Near){o, lanes};
            count += lanes != 0;
        }
    }
    return count;
}

// List the bodies of a group and the listed obstacles that they may come too near. Returns the number of pairs.
INLINE int64_t list_body_obstacles(int64_t g, int64_t listed, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const Group *group = &scene->arm->groups[g];
    int alone = group->last_body - group->first_body == 1;
    int64_t count = 0;
    for (int64_t b = group->first_body; b < group->last_body; b++) ready_ball(b, 1, scene, scratch);
    for (int64_t b = group->first_body; b < group->last_body; b++) {
        const int32_t *pairs = scene->pairs->obstacle_pair + b * scene->obstacles->count;
        SphereRef ball = ball_around(&scene->arm->bodies[b]);
        for (int64_t n = 0; n < listed; n++) {
            int64_t o = scratch->near_obstacles[n].index, pair = pairs[o];
            uint64_t lanes = scratch->near_obstacles[n].lanes;
            if (pair < 0) continue;
            // The ball around a single body is that of its group.
            if (!alone) lanes = lanes_near_obstacle(ball, o, scene->pairs->padding[pair], lanes, h, scene, scratch);
            scratch->near_bodies[count] = (NearBody){b, o, pair, -1, lanes};
            count += lanes != 0;
        }
    }
    return count;
}

// List bodies and obstacles that are not proven collision-free on the whole edge, bodies farthest from the base first.
//
// Returns the number of candidates, or -1 for a contact.
NOINLINE int64_t add_obstacle_candidates(f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    int64_t count = 0;
    // All boxes first: they are independent of each other, without branches in between.
    for (int64_t g = 0; g < arm->group_count; g++) {
        place_box(g, h[0], scene, scratch);
    }
    for (int64_t g = arm->group_count - 1; g >= 0; g--) {
        int64_t listed = list_obstacles(g, h, scene, scratch);
        if (listed) listed = list_body_obstacles(g, listed, h, scene, scratch);
        for (int64_t n = 0; n < listed; n++) {
            count = add_candidate(count, &scratch->near_bodies[n], h, scene, scratch);
            if (count < 0) return -1;
        }
    }
    return count;
}

// Write the given lanes in which each body of a group may come too near the ball around another group to `group_lanes`.
// Returns those in which any body may.
INLINE uint64_t list_bodies(int64_t group, int64_t other, int64_t shared, uint64_t lanes, f64x8 h,
                        const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    uint64_t some = 0;
    SphereRef ball = ball_of_group(other, arm);
    for (int64_t b = arm->groups[group].first_body; b < arm->groups[group].last_body; b++) {
        ready_ball(b, 1, scene, scratch);
        uint64_t near =
            lanes_near_sphere(ball_around(&arm->bodies[b]), ball, shared, lanes, scene->max_padding, h, scene, scratch);
        scratch->group_lanes[b] = near;
        some |= near;
    }
    return some;
}

// List the body pairs of two groups that neither maps nor balls prove apart on the whole edge. Returns their number.
INLINE int64_t list_body_pairs(const GroupPair *groups, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const Group *group = &arm->groups[groups->group], *other = &arm->groups[groups->other];
    int64_t shared = groups->shared, pairs = groups->last - groups->first, count = 0;
    const double *speeds = scratch->speeds + shared * arm->group_stride;
    if (scratch->has_free_end && speeds[groups->group] == 0.0 && speeds[groups->other] == 0.0) return 0;
    if (pairs_are_settled(groups->group, groups->other, scene, scratch)) return 0;
    if (groups->map >= 0 && map_is_free(groups->map, groups->first, 0.0, 1.0, scene, scratch)) return 0;
    uint64_t near = ALL_LANES;
    if (pairs > 1) {
        near = lanes_near_sphere(ball_of_group(groups->group, arm), ball_of_group(groups->other, arm), shared,
                                 ALL_LANES, scene->max_padding, h, scene, scratch);
        if (near == 0) return 0;
    }
    // If there are more pairs than bodies, test the boxes around both groups and each body against the other group
    // first.
    int64_t bodies = group->last_body - group->first_body + other->last_body - other->first_body;
    int by_body = pairs > bodies;
    if (by_body) {
        near = lanes_near_boxes(groups->group, groups->other, shared, near, scene->max_padding, h, scene, scratch);
        if (near == 0) return 0;
        near = list_bodies(groups->group, groups->other, shared, near, h, scene, scratch);
        if (near == 0) return 0;
        near = list_bodies(groups->other, groups->group, shared, near, h, scene, scratch);
    }
    for (int64_t m = groups->first; m < groups->last; m++) {
        const BodyPair *pair = &scene->pairs->body_pairs[m];
        uint64_t lanes = by_body ? near & scratch->group_lanes[pair->body] & scratch->group_lanes[pair->other] : near;
        if (lanes == 0) continue;
        if (pair->map >= 0 && map_is_free(pair->map, m, 0.0, 1.0, scene, scratch)) continue;
        ready_ball(pair->body, 1, scene, scratch);
        ready_ball(pair->other, 1, scene, scratch);
        lanes = lanes_near_sphere(ball_around(&arm->bodies[pair->body]), ball_around(&arm->bodies[pair->other]), shared,
                                  lanes, scene->pairs->padding[pair->pair], h, scene, scratch);
        scratch->near_bodies[count] = (NearBody){pair->body, pair->other, pair->pair, m, lanes};
        count += lanes != 0;
    }
    return count;
}

// List the pairs of groups whose boxes overlap. Returns their number.
INLINE int64_t list_group_pairs(const SceneTables *scene, Scratch *scratch) {
    const PairTables *pairs = scene->pairs;
    int64_t count = 0;
    for (int64_t g = 0; g < scene->arm->group_count; g++) {
        Box box = box_of(g, scene, scratch);
        for (int64_t k = pairs->first_group_block[g]; k < pairs->first_group_block[g + 1]; k++) {
            const NearBlock *block = &pairs->group_blocks[k];
            uint64_t near = boxes_near(box, block, scratch->group_boxes, scene->arm->group_stride);
            for (; near; near &= near - 1) {
                uint64_t before = (uint64_t)block->lanes & ((near & -near) - 1);
                scratch->near_groups[count++] = block->pair + __builtin_popcountll(before);
            }
        }
    }
    return count;
}

// Add the body pairs that are not proven collision-free on the whole edge.
//
// Returns the number of candidates, or -1 for a contact.
NOINLINE int64_t add_body_candidates(int64_t count, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    int64_t groups = list_group_pairs(scene, scratch);
    for (int64_t g = 0; g < groups; g++) {
        int64_t listed = list_body_pairs(&scene->pairs->group_pairs[scratch->near_groups[g]], h, scene, scratch);
        for (int64_t n = 0; n < listed; n++) {
            count = add_candidate(count, &scratch->near_bodies[n], h, scene, scratch);
            if (count < 0) return -1;
        }
    }
    return count;
}

// The given lanes in which the balls of a candidate may be too near.
INLINE uint64_t lanes_near(const Candidate *candidate, uint64_t lanes, int64_t batch, f64x8 h,
                           const SceneTables *scene, Scratch *scratch) {
    const Body *body = &scene->arm->bodies[candidate->body];
    double padding = scene->pairs->padding[candidate->pair];
    ready_ball(candidate->body, batch, scene, scratch);
    if (candidate->body_pair < 0)
        return lanes_near_obstacle(ball_around(body), candidate->other, padding, lanes, h, scene, scratch);
    int64_t shared = scene->pairs->body_pairs[candidate->body_pair].shared;
    ready_ball(candidate->other, batch, scene, scratch);
    return lanes_near_sphere(ball_around(body), ball_around(&scene->arm->bodies[candidate->other]), shared, lanes,
                             padding, h, scene, scratch);
}

// Test candidates again in the lanes of a later batch in which they are open. Returns 1 for a contact.
NOINLINE int retest_candidates(int64_t count, int64_t head, int64_t taken, int64_t batch, f64x8 h,
                               const SceneTables *scene, Scratch *scratch) {
    for (int64_t k = 0; k < count; k++) {
        Candidate *candidate = &scratch->candidates[k];
        uint64_t lanes = 0;
        int64_t bit = k < LAST_BIT ? k : LAST_BIT;
        for (int64_t i = 0; i < taken; i++) lanes |= (scratch->intervals[head + i].candidates >> bit & 1) << i;
        if (lanes) lanes = lanes_near(candidate, lanes, batch, h, scene, scratch);
        candidate->lanes = lanes;
        if (lanes && test_candidate(candidate, batch, h, scene, scratch)) return 1;
    }
    return 0;
}
