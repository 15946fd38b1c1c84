// Simulation steps of freely moving arms driven by servos, eight arms at once.
//
// The bias torque comes from the recursive Newton-Euler algorithm, the mass matrix M from the composite-rigid-body
// algorithm, and M = L^T D L is factorized without fill-in (Featherstone, Rigid Body Dynamics Algorithms, 2008,
// sections 5.3, 6.2 and 6.5). Servos use computed torque control: for desired positions qd, velocities vd and
// accelerations ad,
//
//     effort = clamp(kp (qd - q) + kv (vd - v) + M ad + bias + added effort).
//
// A step of h is that of MuJoCo's integrator "implicitfast": (M + h kv) a = effort - bias, where kv counts only for
// joints whose effort is below its limit; then v += h a and q += h v.
#include "arm_dynamics.h"
#include "sine.h"

// Rotate a vector from a joint's frame to that of its parent, and back.
INLINE Vec8 rotate(const f64x8 R[9], Vec8 v) {
    return (Vec8){
        R[0] * v.x + R[1] * v.y + R[2] * v.z,
        R[3] * v.x + R[4] * v.y + R[5] * v.z,
        R[6] * v.x + R[7] * v.y + R[8] * v.z,
    };
}

INLINE Vec8 rotate_back(const f64x8 R[9], Vec8 v) {
    return (Vec8){
        R[0] * v.x + R[3] * v.y + R[6] * v.z,
        R[1] * v.x + R[4] * v.y + R[7] * v.z,
        R[2] * v.x + R[5] * v.y + R[8] * v.z,
    };
}

INLINE Vec8 vec8_of(const f64x8 v[3]) { return (Vec8){v[0], v[1], v[2]}; }

INLINE void set_vec8(f64x8 to[3], Vec8 v) {
    to[0] = v.x;
    to[1] = v.y;
    to[2] = v.z;
}

INLINE void add_vec8(f64x8 to[3], Vec8 v) {
    to[0] += v.x;
    to[1] += v.y;
    to[2] += v.z;
}

// Product of a symmetric matrix, xx, yy, zz, xy, xz, yz, with a vector.
INLINE Vec8 symmetric_times(const double I[6], Vec8 v) {
    return (Vec8){
        I[0] * v.x + I[3] * v.y + I[4] * v.z,
        I[3] * v.x + I[1] * v.y + I[5] * v.z,
        I[4] * v.x + I[5] * v.y + I[2] * v.z,
    };
}

// Pose of the joint in its parent's frame.
INLINE void place_joint(const DynamicJoint *joint, const DynamicBody *body, JointLanes *lanes) {
    const double *R = body->rotation;
    SineLanes turn = {splat(0.0), splat(1.0)};
    if (!joint->prismatic) turn = sine_cosine_lanes(lanes->position);
    for (int r = 0; r < 3; r++) {
        lanes->rotation[3 * r] = R[3 * r] * turn.cosine + R[3 * r + 1] * turn.sine;
        lanes->rotation[3 * r + 1] = R[3 * r + 1] * turn.cosine - R[3 * r] * turn.sine;
        lanes->rotation[3 * r + 2] = splat(R[3 * r + 2]);
        lanes->origin[r] = splat(body->origin[r]);
        if (joint->prismatic) lanes->origin[r] += R[3 * r + 2] * lanes->position;
    }
}

// Velocity of a joint's frame, its acceleration without joint accelerations, and the force and torque on its body that
// these require. Mass and inertia are those of the body, to which others are added later.
INLINE void move_joint(const DynamicJoint *joint, const DynamicBody *body, const JointLanes *parent,
                       const f64x8 gravity[3], JointLanes *lanes) {
    Vec8 p = vec8_of(lanes->origin), w, dw, a;
    f64x8 rate = lanes->velocity;
    if (parent) {
        Vec8 above = vec8_of(parent->angular), turning = vec8_of(parent->angular_acceleration);
        a = vec8_add(vec8_cross(turning, p), vec8_cross(above, vec8_cross(above, p)));
        a = rotate_back(lanes->rotation, vec8_add(vec8_of(parent->acceleration), a));
        w = rotate_back(lanes->rotation, above);
        dw = rotate_back(lanes->rotation, turning);
    } else {
        a = rotate_back(lanes->rotation, vec8_negative(vec8_of(gravity)));
        w = dw = vec8_splat((const double[3]){0.0, 0.0, 0.0});
    }
    if (joint->prismatic) {
        a.x += 2.0 * w.y * rate;
        a.y -= 2.0 * w.x * rate;
    } else {
        dw.x += w.y * rate;
        dw.y -= w.x * rate;
        w.z += rate;
    }
    set_vec8(lanes->angular, w);
    set_vec8(lanes->angular_acceleration, dw);
    set_vec8(lanes->acceleration, a);
    Vec8 h = vec8_splat(body->moment);
    Vec8 force = vec8_add(vec8_cross(dw, h), vec8_cross(w, vec8_cross(w, h)));
    set_vec8(lanes->force, vec8_add(vec8_scale(a, splat(body->mass)), force));
    Vec8 torque = vec8_add(symmetric_times(body->inertia, dw), vec8_cross(w, symmetric_times(body->inertia, w)));
    set_vec8(lanes->torque, vec8_add(torque, vec8_cross(h, a)));
    lanes->mass = splat(body->mass);
    for (int i = 0; i < 3; i++) lanes->moment[i] = splat(body->moment[i]);
    for (int i = 0; i < 6; i++) lanes->inertia[i] = splat(body->inertia[i]);
}

// Add force, torque and inertia of all that a joint carries to those of its parent.
INLINE void add_to_parent(const JointLanes *lanes, JointLanes *parent) {
    const f64x8 *R = lanes->rotation, *I = lanes->inertia;
    Vec8 p = vec8_of(lanes->origin), force = rotate(R, vec8_of(lanes->force));
    add_vec8(parent->force, force);
    add_vec8(parent->torque, vec8_add(rotate(R, vec8_of(lanes->torque)), vec8_cross(p, force)));
    Vec8 h = rotate(R, vec8_of(lanes->moment));
    // R I R^T, with its axes shifted by p (parallel axis theorem).
    Vec8 rows[3];
    for (int r = 0; r < 3; r++) {
        f64x8 x = R[3 * r], y = R[3 * r + 1], z = R[3 * r + 2];
        rows[r].x = I[0] * x + I[3] * y + I[4] * z;
        rows[r].y = I[3] * x + I[1] * y + I[5] * z;
        rows[r].z = I[4] * x + I[5] * y + I[2] * z;
    }
    Vec8 ex = {R[0], R[1], R[2]}, ey = {R[3], R[4], R[5]}, ez = {R[6], R[7], R[8]};
    Vec8 mp = vec8_scale(p, lanes->mass), g = vec8_add(h, mp);
    f64x8 xx = p.x * (g.x + h.x), yy = p.y * (g.y + h.y), zz = p.z * (g.z + h.z);
    parent->inertia[0] += vec8_dot(rows[0], ex) + (yy + zz);
    parent->inertia[1] += vec8_dot(rows[1], ey) + (xx + zz);
    parent->inertia[2] += vec8_dot(rows[2], ez) + (xx + yy);
    parent->inertia[3] += vec8_dot(rows[0], ey) - (p.x * g.y + h.x * p.y);
    parent->inertia[4] += vec8_dot(rows[0], ez) - (p.x * g.z + h.x * p.z);
    parent->inertia[5] += vec8_dot(rows[1], ez) - (p.y * g.z + h.y * p.z);
    add_vec8(parent->moment, g);
    parent->mass += lanes->mass;
}

// Row `i` of the lower triangle of the mass matrix, in the columns of the joints that carry joint i.
INLINE void fill_mass_row(const DynamicJoint *joints, const JointLanes *lanes, int64_t i, double armature, f64x8 *row) {
    const JointLanes *own = &lanes[i];
    const f64x8 *h = own->moment, *I = own->inertia;
    f64x8 zero = splat(0.0);
    // Force and torque for a unit acceleration of the joint.
    Vec8 force, torque;
    if (joints[i].prismatic) {
        force = (Vec8){zero, zero, own->mass};
        torque = (Vec8){h[1], -h[0], zero};
        row[i] = own->mass + armature;
    } else {
        force = (Vec8){-h[1], h[0], zero};
        torque = (Vec8){I[4], I[5], I[2]};
        row[i] = I[2] + armature;
    }
    for (int64_t j = i; joints[j].parent >= 0;) {
        force = rotate(lanes[j].rotation, force);
        torque = vec8_add(rotate(lanes[j].rotation, torque), vec8_cross(vec8_of(lanes[j].origin), force));
        j = joints[j].parent;
        row[j] = joints[j].prismatic ? force.z : torque.z;
    }
}

// Set right sides to M times the desired accelerations.
INLINE void multiply(const DynamicJoint *joints, int64_t n, const f64x8 *matrix, JointLanes *lanes) {
    for (int64_t i = 0; i < n; i++) {
        const f64x8 *row = matrix + i * n;
        lanes[i].right_side = row[i] * lanes[i].wanted;
        for (int64_t j = joints[i].parent; j >= 0; j = joints[j].parent) {
            lanes[i].right_side += row[j] * lanes[j].wanted;
            lanes[j].right_side += row[j] * lanes[i].wanted;
        }
    }
}

// Solve L^T D L x = right sides, in place of these and of the matrix.
INLINE void solve(const DynamicJoint *joints, int64_t n, f64x8 *matrix, JointLanes *lanes) {
    for (int64_t k = n - 1; k >= 0; k--) {
        f64x8 *row = matrix + k * n, inverse = 1.0 / row[k];
        for (int64_t i = joints[k].parent; i >= 0; i = joints[i].parent) {
            f64x8 factor = row[i] * inverse;
            for (int64_t j = i; j >= 0; j = joints[j].parent) matrix[i * n + j] -= factor * row[j];
            lanes[i].right_side -= factor * lanes[k].right_side;
            row[i] = factor;
        }
        lanes[k].right_side *= inverse;
    }
    for (int64_t k = 0; k < n; k++)
        for (int64_t i = joints[k].parent; i >= 0; i = joints[i].parent)
            lanes[k].right_side -= matrix[k * n + i] * lanes[i].right_side;
}

// Values of a joint of eight arms from a row of all joints of the simulation.
INLINE f64x8 gather(const double *row, const ArmLanes *arms, int64_t joint) {
    f64x8 out;
    for (int i = 0; i < LANES; i++) out[i] = row[arms->columns[i] + joint];
    return out;
}

INLINE void scatter(double *row, const ArmLanes *arms, int64_t joint, f64x8 values) {
    for (int64_t i = 0; i < arms->arm_count; i++) row[arms->columns[i] + joint] = values[i];
}

// A step of eight arms; `desired`, shape (4, columns), and `state`, shape (3, columns), as in rr1_step_arms.
static void step_arms(const ArmDynamics *dynamics, int64_t group, const double *desired, double *state,
                      JointLanes *lanes, f64x8 *matrix) {
    const ArmLanes *arms = &dynamics->arms[group];
    const DynamicJoint *joints = dynamics->joints + arms->first_joint;
    const DynamicBody *bodies = dynamics->bodies + arms->first_joint;
    const ServoLanes *servos = dynamics->servos + arms->first_servo;
    int64_t n = arms->joint_count, columns = dynamics->column_count;
    double dt = dynamics->dt;
    for (int64_t i = 0; i < n; i++) {
        const JointLanes *parent = joints[i].parent < 0 ? NULL : &lanes[joints[i].parent];
        place_joint(&joints[i], &bodies[i], &lanes[i]);
        move_joint(&joints[i], &bodies[i], parent, dynamics->bases[group].gravity, &lanes[i]);
        lanes[i].wanted = gather(desired + 2 * columns, arms, i);
    }
    // From the last joint to the first: a joint is complete before it is added to its parent.
    for (int64_t i = n - 1; i >= 0; i--) {
        fill_mass_row(joints, lanes, i, bodies[i].armature, matrix + i * n);
        if (joints[i].parent >= 0) add_to_parent(&lanes[i], &lanes[joints[i].parent]);
    }
    multiply(joints, n, matrix, lanes);
    for (int64_t i = 0; i < n; i++) {
        const ServoLanes *servo = &servos[i];
        JointLanes *own = &lanes[i];
        f64x8 bias = joints[i].prismatic ? own->force[2] : own->torque[2];
        f64x8 effort = servo->stiffness * (gather(desired, arms, i) - own->position) +
                       servo->damping * (gather(desired + columns, arms, i) - own->velocity) +
                       (own->right_side + bias + gather(desired + 3 * columns, arms, i));
        effort = max_lanes(min_lanes(effort, servo->effort), -servo->effort);
        i64x8 limited = abs_lanes(effort) >= servo->effort;
        matrix[i * n + i] += select_mask(limited, splat(0.0), dt * servo->damping);
        own->right_side = effort - bias;
        scatter(state + 2 * columns, arms, i, effort);
    }
    solve(joints, n, matrix, lanes);
    for (int64_t i = 0; i < n; i++) {
        JointLanes *own = &lanes[i];
        own->velocity += dt * own->right_side;
        own->position += dt * own->velocity;
        scatter(state, arms, i, own->position);
        scatter(state + columns, arms, i, own->velocity);
    }
}

// Simulate `count` steps of the arms in the groups from `first` to before `last`.
//
// `desired`: desired positions, velocities and accelerations and added efforts of all joints of the simulation for each
// step, shape (count, 4, columns). `states`: their positions, velocities and efforts before the first step and after
// each step, the latter written for these arms, shape (count + 1, 3, columns). `lanes` and `matrix`: scratch for as
// many joints as any arm has, and for the square of that number.
EXPORT void rr1_step_arms(const ArmDynamics *dynamics, int64_t first, int64_t last, const double *desired,
                          double *states, int64_t count, JointLanes *lanes, f64x8 *matrix) {
    int64_t columns = dynamics->column_count;
    for (int64_t group = first; group < last; group++) {
        const ArmLanes *arms = &dynamics->arms[group];
        for (int64_t i = 0; i < arms->joint_count; i++) {
            lanes[i].position = gather(states, arms, i);
            lanes[i].velocity = gather(states + columns, arms, i);
        }
        for (int64_t step = 0; step < count; step++)
            step_arms(dynamics, group, desired + 4 * columns * step, states + 3 * columns * (step + 1), lanes, matrix);
    }
}
