// Forward kinematics in one configuration: poses of joints and bodies, and bounds of the displacement of bodies.
#include "scene_tables.h"
#include "sine.h"

// World poses of the driven joints among those from `first` to `last`; the joints above them are placed.
static void place_joint_range(int64_t first, int64_t last, const double *q, const ExactTables *exact,
                              ExactScratch *scratch) {
    for (int64_t j = first; j < last; j++) {
        const ExactJoint *joint = &exact->joints[j];
        if (!joint->driven) continue;
        const ExactPlacement *placement = &exact->placements[j];
        const double *P = scratch->joint_poses[joint->parent].rotation, *o = scratch->joint_poses[joint->parent].origin;
        const double *R = placement->rotation, *p = placement->origin;
        double value = placement->offset;
        if (joint->column >= 0) value += placement->gain * q[joint->column];
        Pose *pose = &scratch->joint_poses[j];
        double x = placement->axis[0], y = placement->axis[1], z = placement->axis[2], T[9];
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++)
                T[3 * r + c] = P[3 * r] * R[c] + P[3 * r + 1] * R[3 + c] + P[3 * r + 2] * R[6 + c];
            pose->origin[r] = P[3 * r] * p[0] + P[3 * r + 1] * p[1] + P[3 * r + 2] * p[2] + o[r];
        }
        if (joint->prismatic == 1) {
            for (int r = 0; r < 3; r++) {
                for (int c = 0; c < 3; c++) pose->rotation[3 * r + c] = T[3 * r + c];
                double along = T[3 * r] * x + T[3 * r + 1] * y + T[3 * r + 2] * z;
                pose->origin[r] += value * along;
            }
            continue;
        }
        Sine turn = sine_cosine(value);
        double s = turn.sine, co = turn.cosine, v = 1.0 - co;
        double M[9] = {
            co + v * x * x,    v * x * y - s * z, v * x * z + s * y,
            v * x * y + s * z, co + v * y * y,    v * y * z - s * x,
            v * x * z - s * y, v * y * z + s * x, co + v * z * z,
        };
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                pose->rotation[3 * r + c] = T[3 * r] * M[c] + T[3 * r + 1] * M[3 + c] + T[3 * r + 2] * M[6 + c];
    }
}

// World poses of all driven joints.
static void place_joints(const double *q, const ExactTables *exact, ExactScratch *scratch) {
    place_joint_range(1, exact->joint_count, q, exact, scratch);
}

// World pose of a body and position of the center of its ball, from the pose of its joint.
static void place_body(int64_t body, const ExactTables *exact, ExactScratch *scratch) {
    const ExactShape *shape = &exact->shapes[body];
    const Pose *joint = &scratch->joint_poses[exact->bodies[body].joint];
    Pose *pose = &scratch->poses[body];
    double *center = (double *)&scratch->centers[body];
    const double *R = shape->rotation, *p = shape->origin, *ball = shape->ball_center;
    for (int r = 0; r < 3; r++) {
        double a = joint->rotation[3 * r], b = joint->rotation[3 * r + 1], c = joint->rotation[3 * r + 2];
        for (int k = 0; k < 3; k++) pose->rotation[3 * r + k] = a * R[k] + b * R[3 + k] + c * R[6 + k];
        double shift = joint->origin[r];
        pose->origin[r] = a * p[0] + b * p[1] + c * p[2] + shift;
        center[r] = a * ball[0] + b * ball[1] + c * ball[2] + shift;
    }
}

INLINE int moves(const ExactBody *body) { return body->last_link > body->first_link; }

// Bound the displacement of any point of a body by each joint of its chain and all below it, into `travel`.
//
// reach: largest change of each column of q, shape (nq,).
static void bound_travel(int64_t body, const double *reach, const ExactTables *exact, ExactScratch *scratch) {
    int64_t first = exact->bodies[body].first_link, last = exact->bodies[body].last_link;
    double radius = exact->shapes[body].ball_radius;
    double *travel = scratch->travel + body * scratch->travel_stride;
    const Vec3 *center = &scratch->centers[body];
    // `moved` bounds the travel of the ball's center, `surface` that of any point of the body.
    double moved = 0.0, surface = 0.0;
    travel[last - first] = 0.0;
    for (int64_t k = last - 1; k >= first; k--) {
        int64_t j = exact->chain[k];
        const Pose *pose = &scratch->joint_poses[j];
        const double *R = pose->rotation, *u = exact->placements[j].axis;
        double amount = abs_number(exact->placements[j].gain) * reach[exact->joints[j].column];
        if (exact->joints[j].prismatic == 1) {
            moved += amount;
            surface += amount;
        } else {
            double x = R[0] * u[0] + R[1] * u[1], y = R[3] * u[0] + R[4] * u[1], z = R[6] * u[0] + R[7] * u[1];
            x += R[2] * u[2];
            y += R[5] * u[2];
            z += R[8] * u[2];
            double dx = center->x - pose->origin[0], dy = center->y - pose->origin[1], dz = center->z - pose->origin[2];
            double cx = y * dz - z * dy, cy = z * dx - x * dz, cz = x * dy - y * dx;
            double arm = min_number(exact->chain_reach[k], sqrt_number(cx * cx + cy * cy + cz * cz) + moved);
            moved += amount * arm;
            surface += amount * (arm + radius);
        }
        travel[k - first] = surface;
    }
}
