// Forward kinematics of a chain, its pose error, and the Jacobian of the error.
#include "arc_tangent.h"
#include "chain.h"
#include "sine.h"
#include "vectors.h"

// Cosine below which the axis of a rotation is computed from the symmetric part of its matrix.
#define NEAR_HALF_TURN -0.9

// World poses of all joints at q, and of the frame as the last one.
static void place_chain(const Chain *chain, const double *q, Pose *poses) {
    for (int64_t i = 0; i <= chain->joint_count; i++) {
        const ChainLink *link = &chain->links[i];
        Pose *pose = &poses[i];
        if (i == 0) {
            for (int k = 0; k < 9; k++) pose->rotation[k] = link->rotation[k];
            for (int k = 0; k < 3; k++) pose->origin[k] = link->origin[k];
        } else {
            const Pose *parent = &poses[i - 1];
            for (int r = 0; r < 3; r++) {
                const double *row = &parent->rotation[3 * r], *m = link->rotation, *p = link->origin;
                for (int k = 0; k < 3; k++)
                    pose->rotation[3 * r + k] = row[0] * m[k] + row[1] * m[3 + k] + row[2] * m[6 + k];
                pose->origin[r] = parent->origin[r] + row[0] * p[0] + row[1] * p[1] + row[2] * p[2];
            }
        }
        if (i == chain->joint_count) return;
        double value = link->gain * q[chain->joints[i].column] + link->offset;
        if (chain->joints[i].prismatic) {
            for (int r = 0; r < 3; r++) pose->origin[r] += value * pose->rotation[3 * r + 2];
        } else {
            Sine turn = sine_cosine(value);
            for (int r = 0; r < 3; r++) {
                double x = pose->rotation[3 * r], y = pose->rotation[3 * r + 1];
                pose->rotation[3 * r] = x * turn.cosine + y * turn.sine;
                pose->rotation[3 * r + 1] = y * turn.cosine - x * turn.sine;
            }
        }
    }
}

// The rotation vector from the rotation of a target to that of a pose, in world axes [rad].
static void rotation_error(const Pose *pose, const IkTarget *target, double error[3]) {
    double m[3][3];  // R_pose R_target^T
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            m[r][c] = 0.0;
            for (int k = 0; k < 3; k++) m[r][c] += pose->rotation[3 * r + k] * target->rotation[3 * c + k];
        }
    // sin(angle) axis, from the antisymmetric part.
    double x = 0.5 * (m[2][1] - m[1][2]), y = 0.5 * (m[0][2] - m[2][0]), z = 0.5 * (m[1][0] - m[0][1]);
    double sine = sqrt_number(x * x + y * y + z * z), cosine = 0.5 * (m[0][0] + m[1][1] + m[2][2] - 1.0);
    double angle = angle_of(sine, cosine), scale;
    if (sine == 0.0 && cosine > 0.0) {
        error[0] = error[1] = error[2] = 0.0;
        return;
    }
    if (cosine > NEAR_HALF_TURN) {
        scale = angle / sine;
        error[0] = scale * x;
        error[1] = scale * y;
        error[2] = scale * z;
        return;
    }
    // (M + M^T) / 2 - cos I = (1 - cos) axis axis^T: the axis is its longest column.
    int c = m[0][0] >= m[1][1] && m[0][0] >= m[2][2] ? 0 : m[1][1] >= m[2][2] ? 1 : 2;
    double axis[3];
    for (int r = 0; r < 3; r++) axis[r] = r == c ? m[c][c] - cosine : 0.5 * (m[r][c] + m[c][r]);
    scale = angle / sqrt_number(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    if (axis[0] * x + axis[1] * y + axis[2] * z < 0.0) scale = -scale;
    for (int r = 0; r < 3; r++) error[r] = scale * axis[r];
}

// Error of the frame at q: position [m], then rotation times the weight of the target. Returns its squared norm.
//
// Writes the poses of the chain to `poses`.
static double ik_error(const Chain *chain, const IkTarget *target, const double *q, Pose *poses, double error[6]) {
    place_chain(chain, q, poses);
    const Pose *pose = &poses[chain->joint_count];
    double square = 0.0;
    for (int r = 0; r < 3; r++) {
        double p = pose->origin[r];
        error[r] = p - min_number(max_number(p, target->lower[r]), target->upper[r]);
        square += error[r] * error[r];
        error[3 + r] = 0.0;
    }
    double weight = target->weight;
    if (weight > 0.0) {
        double turn[3];
        rotation_error(pose, target, turn);
        for (int r = 0; r < 3; r++) error[3 + r] = weight * turn[r];
        square += weight * weight * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    }
    return square;
}

// Jacobian of the error by column of q, shape (nq, 6), at the configuration of `poses`. Returns the number of entries
// of the error in use.
static int ik_jacobian(const Chain *chain, const IkTarget *target, const Pose *poses, const double error[6],
                       int64_t nq, double (*jacobian)[6]) {
    double weight = target->weight;
    int rows = weight > 0.0 ? 6 : 3;
    for (int64_t j = 0; j < nq; j++)
        for (int r = 0; r < 6; r++) jacobian[j][r] = 0.0;
    const double *end = poses[chain->joint_count].origin;
    for (int64_t i = 0; i < chain->joint_count; i++) {
        const Pose *pose = &poses[i];
        double *column = jacobian[chain->joints[i].column], gain = chain->links[i].gain;
        double x = gain * pose->rotation[2], y = gain * pose->rotation[5], z = gain * pose->rotation[8];
        if (chain->joints[i].prismatic) {
            column[0] += x;
            column[1] += y;
            column[2] += z;
            continue;
        }
        double u = end[0] - pose->origin[0], v = end[1] - pose->origin[1], w = end[2] - pose->origin[2];
        column[0] += y * w - z * v;
        column[1] += z * u - x * w;
        column[2] += x * v - y * u;
        if (rows == 6) {
            column[3] += weight * x;
            column[4] += weight * y;
            column[5] += weight * z;
        }
    }
    for (int r = 0; r < 3; r++)
        // Inside the box, a coordinate may change freely.
        if (target->lower[r] < target->upper[r] && error[r] == 0.0)
            for (int64_t j = 0; j < nq; j++) jacobian[j][r] = 0.0;
    return rows;
}

// World pose of the frame at q: rotation row by row, then origin [m].
EXPORT void rr1_chain_pose(const Chain *chain, const double *q, double pose[12]) {
    Pose poses[chain->joint_count + 1];
    place_chain(chain, q, poses);
    const Pose *frame = &poses[chain->joint_count];
    for (int k = 0; k < 9; k++) pose[k] = frame->rotation[k];
    for (int k = 0; k < 3; k++) pose[9 + k] = frame->origin[k];
}

// Distance [m] and angle [rad] of the frame from its target at q.
EXPORT void rr1_chain_errors(const Chain *chain, const IkTarget *target, const double *q, double errors[2]) {
    Pose poses[chain->joint_count + 1];
    double e[6];
    ik_error(chain, target, q, poses, e);
    errors[0] = sqrt_number(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    errors[1] = target->weight > 0.0 ? sqrt_number(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) / target->weight : 0.0;
}
