// Forward kinematics in eight configurations of an edge: frames, their velocities, and where that takes spheres.
//
// An edge is q(t) = q0 + d t + c t^2, 0 <= t <= 1, with c = 0 where it is straight. Rates d + 2 c t are greatest at one
// of its ends; the second derivative is 2 c.
//
// Let y be a point in the frame that a joint carries. That joint turns by an angle a(t), or slides by s(t) along a unit
// vector u, so in its parent's frame the point is x = R(a) y or x = y + s u. With r the distance from the axis,
//
//     |x'| <= |a'| r + |y'|,    |x''| <= a'^2 r + 2 |a'| |y'| + |a''| r + |y''|    or
//     |x'| <= |s'| + |y'|,      |x''| <= |s''| + |y''|,
//
// because R's derivatives act on y as w x y, and as w x (w x y) + w' x y, and w is along the axis. From the last joint
// to the first, with the greatest rates and the greatest r, this bounds speed and acceleration of every point of a
// group in the frame of any joint above it.
#include "scene_tables.h"
#include "sine.h"

// 1 if all angles of the edge are small enough for `sine_cosine_lanes`.
static int angles_are_small(const SceneTables *scene, const Scratch *scratch) {
    int64_t nq = scene->column_count;
    const double *curve = scratch->curve;
    for (int64_t c = 0; c < nq; c++) {
        double begin = curve[c], bend = abs_number(curve[2 * nq + c]);
        double end = begin + curve[nq + c] + curve[2 * nq + c];
        // Comparisons that NaN fails as well.
        if (!(abs_number(begin) + bend < MAX_LANE_ANGLE && abs_number(end) + bend < MAX_LANE_ANGLE)) return 0;
    }
    return 1;
}

static void bound_joints(const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    int64_t nq = scene->column_count;
    const double *curve = scratch->curve;
    for (int64_t j = 1; j < arm->joint_count; j++) {
        int64_t column = arm->joints[j].column;
        double gain = arm->placements[j].gain;
        double begin = gain * curve[column], rate = gain * curve[nq + column], bend = gain * curve[2 * nq + column];
        JointMotion *motion = &scratch->joint_motions[j];
        motion->begin = begin;
        motion->rate = rate;
        motion->bend = bend;
        motion->max_rate = max_number(abs_number(rate), abs_number(rate + 2.0 * bend)) * SLACK;
        // From the straight line between its ends a parabola gets away by a quarter of |c|.
        motion->max_value =
            max_number(abs_number(begin), abs_number(begin + rate + bend)) + 0.25 * abs_number(bend);
    }
}

// Greatest speeds and accelerations over the edge, by group and by the joints that count.
NOINLINE void bound_motion(const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    bound_joints(scene, scratch);
    for (int64_t g = 0; g < arm->group_count; g++) {
        int64_t first = arm->groups[g].first_link, last = arm->groups[g].last_link;
        double *speeds = scratch->speeds + g * scratch->chain_stride;
        double *accelerations = scratch->accelerations + g * scratch->chain_stride;
        double speed = 0.0, acceleration = 0.0, beyond = 0.0;
        speeds[last - first] = 0.0;
        accelerations[last - first] = 0.0;
        for (int64_t k = last - 1; k >= first; k--) {
            int64_t j = arm->chain[k];
            const JointMotion *motion = &scratch->joint_motions[j];
            double rate = motion->max_rate, bend = 2.0 * SLACK * abs_number(motion->bend);
            if (arm->joints[j].prismatic) {
                acceleration += bend;
                speed += rate;
                beyond += motion->max_value;
            } else {
                double reach = arm->chain_reach[k] + beyond;
                double swing = rate * reach;
                acceleration += rate * (swing + 2.0 * speed) + bend * reach;
                speed += swing;
            }
            speeds[k - first] = speed;
            accelerations[k - first] = acceleration;
        }
    }
}

// World poses and velocities of all joints at the times t of the edge.
NOINLINE void place_frames(f64x8 t, const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    for (int64_t j = 1; j < arm->joint_count; j++) {
        const JointMotion *motion = &scratch->joint_motions[j];
        const JointPlacement *placement = &arm->placements[j];
        const FrameLanes *parent = &scratch->frames[arm->joints[j].parent];
        FrameLanes *frame = &scratch->frames[j];
        int prismatic = arm->joints[j].prismatic == 1;
        f64x8 rate = t * (2.0 * motion->bend) + motion->rate;
        f64x8 value = t * (t * motion->bend + motion->rate) + motion->begin;
        f64x8 zero = splat(0.0);
        SineLanes turn = {zero, splat(1.0)};
        if (!prismatic) turn = sine_cosine_lanes(value);
        f64x8 turn_rate = prismatic ? zero : rate, slide_rate = prismatic ? rate : zero;
        f64x8 slide = prismatic ? value : zero;
        f64x8 offset[3];
        for (int r = 0; r < 3; r++) {
            f64x8 a = parent->rotation[3 * r], b = parent->rotation[3 * r + 1], c = parent->rotation[3 * r + 2];
            const double *R = placement->rotation, *p = placement->origin;
            f64x8 x = a * R[0] + b * R[3] + c * R[6];
            f64x8 y = a * R[1] + b * R[4] + c * R[7];
            f64x8 z = a * R[2] + b * R[5] + c * R[8];
            frame->rotation[3 * r] = x * turn.cosine + y * turn.sine;
            frame->rotation[3 * r + 1] = y * turn.cosine - x * turn.sine;
            frame->rotation[3 * r + 2] = z;
            offset[r] = a * p[0] + b * p[1] + c * p[2] + z * slide;
            frame->origin[r] = parent->origin[r] + offset[r];
            frame->angular[r] = parent->angular[r] + z * turn_rate;
        }
        const f64x8 *w = parent->angular, *v = parent->linear;
        f64x8 across[3] = {
            w[1] * offset[2] - w[2] * offset[1],
            w[2] * offset[0] - w[0] * offset[2],
            w[0] * offset[1] - w[1] * offset[0],
        };
        for (int r = 0; r < 3; r++)
            frame->linear[r] = v[r] + across[r] + frame->rotation[3 * r + 2] * slide_rate;
    }
}

INLINE Vec8 center_of(const SphereLanes *sphere) {
    return (Vec8){sphere->center[0], sphere->center[1], sphere->center[2]};
}

INLINE Vec8 velocity_of(const SphereLanes *sphere) {
    return (Vec8){sphere->velocity[0], sphere->velocity[1], sphere->velocity[2]};
}

// Places and velocities of the centers of spheres that a joint carries.
INLINE void place_centers(int64_t joint, int64_t first, int64_t last, const SceneTables *scene, Scratch *scratch) {
    const FrameLanes *frame = &scratch->frames[joint];
    const f64x8 *R = frame->rotation, *w = frame->angular;
    for (int64_t i = first; i < last; i++) {
        const double *c = scene->arm->spheres[i].center;
        SphereLanes *sphere = &scratch->spheres[i];
        f64x8 d[3];
        for (int r = 0; r < 3; r++) {
            d[r] = R[3 * r] * c[0] + R[3 * r + 1] * c[1] + R[3 * r + 2] * c[2];
            sphere->center[r] = frame->origin[r] + d[r];
        }
        sphere->velocity[0] = frame->linear[0] + w[1] * d[2] - w[2] * d[1];
        sphere->velocity[1] = frame->linear[1] + w[2] * d[0] - w[0] * d[2];
        sphere->velocity[2] = frame->linear[2] + w[0] * d[1] - w[1] * d[0];
    }
}

// Place and travel of the ball around a group or a body of it.
INLINE void place_ball(int64_t group, int64_t sphere, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    int64_t joint = scene->arm->groups[group].joint;
    place_centers(joint, sphere, sphere + 1, scene, scratch);
    Vec8 v = velocity_of(&scratch->spheres[sphere]);
    int64_t row = group * scratch->chain_stride;
    f64x8 travel = sqrt_lanes(vec8_dot(v, v)) * h * SLACK + h * h * (0.5 * scratch->accelerations[row]);
    scratch->spheres[sphere].travel = min_lanes(travel, h * scratch->speeds[row]);
}

// Places and travels of the spheres of a body whose ball is placed.
INLINE void place_spheres(int64_t body, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const Body *of = &scene->arm->bodies[body];
    int64_t ball = of->first_sphere;
    place_centers(of->joint, ball + 1, of->last_sphere, scene, scratch);
    const f64x8 *w = scratch->frames[of->joint].angular;
    // None moves faster than the ball's center and the turn about that.
    f64x8 turn = sqrt_lanes(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * h * SLACK;
    f64x8 travel = scratch->spheres[ball].travel;
    f64x8 most = h * scratch->speeds[of->group * scratch->chain_stride];
    for (int64_t i = ball + 1; i < of->last_sphere; i++)
        scratch->spheres[i].travel = min_lanes(travel + turn * scene->arm->spheres[i].apart, most);
}
