// Forward kinematics in eight configurations of an edge: poses and velocities of frames and spheres.
//
// An edge is q(t) = q0 + d t + c t^2, 0 <= t <= 1, with c = 0 if it is straight. Rates d + 2 c t are greatest at one of
// its ends; the second derivative is 2 c.
//
// Let y be a point in the frame that a joint carries. That joint turns by an angle a(t), or slides by s(t) along a unit
// vector u, so in its parent's frame the point is x = R(a) y or x = y + s u. With r the distance from the axis,
//
//     |x'| <= |a'| r + |y'|,    |x''| <= a'^2 r + 2 |a'| |y'| + |a''| r + |y''|    or
//     |x'| <= |s'| + |y'|,      |x''| <= |s''| + |y''|,
//
// because R's derivatives act on y as w x y, and as w x (w x y) + w' x y, and w is along the axis. Applied from the
// last joint to the first, with the greatest rates and the greatest r, this bounds speed and acceleration of every
// point of a group in the frame of any joint above it.
#include "scene_tables.h"
#include "sine.h"

// 1 if all angles of the edge are small enough for `sine_cosine_lanes`.
static int angles_are_small(const SceneTables *scene, const Scratch *scratch) {
    int64_t nq = scene->column_count;
    const double *curve = scratch->curve;
    for (int64_t c = 0; c < nq; c++) {
        double begin = curve[c], bend = abs_number(curve[2 * nq + c]);
        double end = begin + curve[nq + c] + curve[2 * nq + c];
        // These comparisons are also false for NaN.
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
        // A parabola deviates from the straight line between its ends by at most |c| / 4.
        motion->max_value =
            max_number(abs_number(begin), abs_number(begin + rate + bend)) + 0.25 * abs_number(bend);
    }
}

// Greatest speeds and accelerations over the edge, for eight groups at once.
NOINLINE void bound_motion(const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    int64_t stride = arm->group_stride;
    f64x8 zero = splat(0.0);
    bound_joints(scene, scratch);
    for (int64_t block = 0; block < stride; block += LANES) {
        const GroupBlock *groups = &arm->group_blocks[block / LANES];
        f64x8 speed = zero, acceleration = zero, beyond = zero;
        // If all joints that move a group also move the other, the group has no relative motion.
        for (int64_t row = 0; row < scratch->bound_rows; row++) {
            store_lanes(scratch->speeds + row * stride + block, zero);
            store_lanes(scratch->accelerations + row * stride + block, zero);
        }
        for (int64_t j = groups->last_joint - 1; j >= groups->first_joint; j--) {
            const JointMotion *motion = &scratch->joint_motions[j];
            f64x8 reach = load_lanes(arm->reach + (groups->first_row + j - groups->first_joint) * LANES);
            i64x8 carried = reach >= zero;
            double rate = motion->max_rate, bend = 2.0 * SLACK * abs_number(motion->bend);
            f64x8 next_speed, next_acceleration;
            if (arm->joints[j].prismatic) {
                next_acceleration = acceleration + bend;
                next_speed = speed + rate;
                beyond = select_mask(carried, beyond + motion->max_value, beyond);
            } else {
                reach = reach + beyond;
                f64x8 swing = rate * reach;
                next_acceleration = acceleration + (rate * (swing + 2.0 * speed) + bend * reach);
                next_speed = speed + swing;
            }
            speed = select_mask(carried, next_speed, speed);
            acceleration = select_mask(carried, next_acceleration, acceleration);
            // Joints of several arms share rows, but carry different groups.
            double *speeds = scratch->speeds + arm->depths[j] * stride + block;
            double *accelerations = scratch->accelerations + arm->depths[j] * stride + block;
            store_lanes(speeds, select_mask(carried, speed, load_lanes(speeds)));
            store_lanes(accelerations, select_mask(carried, acceleration, load_lanes(accelerations)));
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
        // A prismatic joint does not turn, and a revolute joint does not slide.
        SineLanes turn = {splat(0.0), splat(1.0)};
        if (!prismatic) turn = sine_cosine_lanes(value);
        const f64x8 *w = parent->angular, *v = parent->linear;
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
            offset[r] = a * p[0] + b * p[1] + c * p[2];
            if (prismatic) offset[r] = offset[r] + z * value;
            frame->origin[r] = parent->origin[r] + offset[r];
            frame->angular[r] = prismatic ? w[r] : w[r] + z * rate;
        }
        f64x8 across[3] = {
            w[1] * offset[2] - w[2] * offset[1],
            w[2] * offset[0] - w[0] * offset[2],
            w[0] * offset[1] - w[1] * offset[0],
        };
        for (int r = 0; r < 3; r++) {
            frame->linear[r] = v[r] + across[r];
            if (prismatic) frame->linear[r] = frame->linear[r] + frame->rotation[3 * r + 2] * rate;
        }
    }
}

INLINE Vec8 center_of(const SphereLanes *sphere) {
    return (Vec8){sphere->center[0], sphere->center[1], sphere->center[2]};
}

// Place the centers of spheres that a joint carries.
INLINE void place_centers(int64_t joint, int64_t first, int64_t last, const SceneTables *scene, Scratch *scratch) {
    const FrameLanes *frame = &scratch->frames[joint];
    const f64x8 *R = frame->rotation;
    for (int64_t i = first; i < last; i++) {
        const double *c = scene->arm->spheres[i].center;
        for (int r = 0; r < 3; r++)
            scratch->spheres[i].center[r] =
                frame->origin[r] + (R[3 * r] * c[0] + R[3 * r + 1] * c[1] + R[3 * r + 2] * c[2]);
    }
}

// Velocity of the center of a sphere that a joint carries.
INLINE Vec8 velocity_at(int64_t joint, int64_t sphere, const Scratch *scratch) {
    const FrameLanes *frame = &scratch->frames[joint];
    const SphereLanes *lanes = &scratch->spheres[sphere];
    const f64x8 *w = frame->angular;
    f64x8 dx = lanes->center[0] - frame->origin[0];
    f64x8 dy = lanes->center[1] - frame->origin[1];
    f64x8 dz = lanes->center[2] - frame->origin[2];
    return (Vec8){
        frame->linear[0] + w[1] * dz - w[2] * dy,
        frame->linear[1] + w[2] * dx - w[0] * dz,
        frame->linear[2] + w[0] * dy - w[1] * dx,
    };
}

// A sphere in a body, or a ball around a body or a group.
typedef struct {
    int64_t group;
    int64_t index;
} SphereRef;

INLINE SphereRef sphere_in(const Body *body, int64_t index) { return (SphereRef){body->group, index}; }

INLINE SphereRef ball_around(const Body *body) { return (SphereRef){body->group, body->first_sphere}; }

INLINE SphereRef ball_of_group(int64_t group, const ArmGeometry *arm) {
    return (SphereRef){group, arm->groups[group].ball};
}

INLINE Vec8 velocity_of(SphereRef sphere, const SceneTables *scene, const Scratch *scratch) {
    return velocity_at(scene->arm->groups[sphere.group].joint, sphere.index, scratch);
}

// A bound of the displacement of a sphere in either half of its interval [m].
INLINE f64x8 travel_of(SphereRef sphere, f64x8 h, const SceneTables *scene, const Scratch *scratch) {
    Vec8 v = velocity_of(sphere, scene, scratch);
    f64x8 travel = sqrt_lanes(vec8_dot(v, v)) * h * SLACK + h * h * (0.5 * scratch->accelerations[sphere.group]);
    return min_lanes(travel, h * scratch->speeds[sphere.group]);
}
