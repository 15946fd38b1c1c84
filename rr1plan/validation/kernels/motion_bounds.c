// Poses of bodies at one time of a motion, and bounds of their displacements around it.
//
// Two bounds limit how much nearer two bodies can come. The first adds up how far each joint between them can carry a
// body in any direction. The second considers motion along the separating direction d only. With the joints at
// q + s t + r (s their speeds, |r| <= R, |q' - q| <= D), a point x of a body is carried along d by
//
//     t d . v(x) + e,   |e| <= sum_j rho_j (R_j + D_j^2 / 2 + D_j sum_(i<j) D_i)
//
// where v is the velocity field of the body under s, rho_j the largest distance of its points from axis j, and i runs
// over the turning joints before j. (A turn by D moves a point by D times the velocity, with an error of at most
// D^2 rho / 2; the turns before it tilt this motion by at most their sum.) The largest d . (x + t v(x)) over a body is
// a value of its support function in a direction linear in t. It is therefore convex in t, and its values at both ends
// bound it on the whole interval. The error is of second order, so few intervals suffice for a motion that slides past
// an obstacle.

// Rounding of the distances between axes and bodies [m].
#define AXIS_ROUNDING 1e-7

static inline const RefereeModel *model_of(const RefereeSearch *s, int64_t arm) {
    return &s->models[s->arms[arm].model];
}

// Value, largest change, deviation from constant speed, and speed of a column of q within `half` of a local time.
static ColumnMotion expand_column(RefereeSearch *s, int64_t c, int64_t piece, double at, double half) {
    int64_t degree = s->terms - 1, width = s->column_count;
    double *terms = s->terms_scratch;
    for (int64_t k = 0; k <= degree; k++) terms[k] = s->coefficients[(piece * s->terms + k) * width + c];
    // Taylor shift by Horner's scheme.
    for (int64_t i = 0; i < degree; i++)
        for (int64_t k = degree - 1; k >= i; k--) terms[k] += at * terms[k + 1];
    double rest = 0.0, power = half;
    for (int64_t k = 2; k <= degree; k++) {
        power *= half;
        rest += fabs(terms[k]) * power;
    }
    double speed = degree > 0 ? terms[1] : 0.0;
    return (ColumnMotion){terms[0], fabs(speed) * half + rest, rest, speed};
}

// The chords of all columns of q.
static void set_chords(RefereeSearch *s) {
    for (int64_t i = 0; i < s->piece_count; i++) {
        double half = s->break_count > 1 ? 0.5 * (s->breaks[i + 1] - s->breaks[i]) : 0.0;
        for (int64_t c = 0; c < s->column_count; c++) {
            ColumnMotion column = expand_column(s, c, i, half, half);
            const double *terms = s->terms_scratch;
            double even = 0.0, odd = 0.0, power = 1.0;
            for (int64_t k = 1; k < s->terms; k++) {
                power *= half;
                *(k % 2 ? &odd : &even) += terms[k] * power;
            }
            // For x from -1 to 1, x^k is within 1 of the line through its end points.
            s->chords[c * s->piece_count + i] =
                (ColumnChord){column.value + even - odd, column.value + even + odd, column.rest};
        }
    }
}

// Values of an arm's columns at a local time, and their motion within `half` of it.
static void expand_arm(RefereeSearch *s, int64_t arm, int64_t piece, double at, double half) {
    const int64_t *columns = s->arm_columns + s->arms[arm].first_column;
    int64_t count = s->arms[arm + 1].first_column - s->arms[arm].first_column;
    for (int64_t i = 0; i < count; i++) s->columns[columns[i]] = expand_column(s, columns[i], piece, at, half);
}

// For several pieces: the constant speed between their ends, and the largest deviation from it.
//
// On a piece, the deviation from a straight line is at most that of its chord at one end, plus the bulge.
static void span_pieces(RefereeSearch *s, int64_t arm, int64_t first, int64_t stop, double middle) {
    const int64_t *columns = s->arm_columns + s->arms[arm].first_column;
    int64_t count = s->arms[arm + 1].first_column - s->arms[arm].first_column;
    const double *breaks = s->breaks;
    for (int64_t k = 0; k < count; k++) {
        const ColumnChord *chords = s->chords + columns[k] * s->piece_count;
        ColumnMotion *column = &s->columns[columns[k]];
        double speed = (chords[stop - 1].end - chords[first].begin) / (breaks[stop] - breaks[first]);
        double change = 0.0, rest = 0.0;
        for (int64_t i = first; i < stop; i++) {
            double begin = chords[i].begin - column->value, end = chords[i].end - column->value;
            double far = greater(fabs(begin), fabs(end));
            double off = greater(fabs(begin - speed * (breaks[i] - middle)), fabs(end - speed * (breaks[i + 1] - middle)));
            change = greater(change, far + chords[i].bulge);
            rest = greater(rest, off + chords[i].bulge);
        }
        column->change = change;
        column->rest = rest;
        column->speed = speed;
    }
}

// Turn a frame about an axis given in it (Rodrigues).
static void turn_link(LinkPose *link, const double axis[3], double angle) {
    double c = cos(angle), s = sin(angle), v = 1.0 - c;
    double xx = c + v * axis[0] * axis[0], yy = c + v * axis[1] * axis[1], zz = c + v * axis[2] * axis[2];
    double xy = v * axis[0] * axis[1], xz = v * axis[0] * axis[2], yz = v * axis[1] * axis[2];
    double sx = s * axis[0], sy = s * axis[1], sz = s * axis[2];
    for (int i = 0; i < 3; i++) {
        double *row = &link->rotation[3 * i], x = row[0], y = row[1], z = row[2];
        row[0] = x * xx + y * (xy + sz) + z * (xz - sy);
        row[1] = x * (xy - sz) + y * yy + z * (yz + sx);
        row[2] = x * (xz + sy) + y * (yz - sx) + z * zz;
    }
}

// Poses of all links of an arm, and the axes of its joints.
static void move_links(RefereeSearch *s, int64_t arm) {
    const RefereeModel *model = model_of(s, arm);
    const int64_t *columns = s->arm_columns + s->arms[arm].first_column;
    LinkPose *links = s->links + s->arms[arm].first_link;
    JointState *states = s->states + s->arms[arm].first_joint;
    links[0] = s->bases[arm];
    for (int64_t j = 0; j < model->joint_count; j++) {
        const ArmJoint *joint = &model->joints[j];
        const JointFrame *frame = &model->frames[j];
        const LinkPose *parent = &links[joint->parent];
        LinkPose *child = &links[j + 1];
        JointState *state = &states[j];
        for (int i = 0; i < 3; i++) {
            const double *row = &parent->rotation[3 * i];
            for (int k = 0; k < 3; k++)
                child->rotation[3 * i + k] = row[0] * frame->rotation[k] + row[1] * frame->rotation[3 + k] +
                                             row[2] * frame->rotation[6 + k];
            double shift = row[0] * frame->shift[0] + row[1] * frame->shift[1] + row[2] * frame->shift[2];
            child->origin[i] = parent->origin[i] + shift;
        }
        for (int i = 0; i < 3; i++) {
            const double *row = &child->rotation[3 * i];
            state->axis[i] = row[0] * frame->axis[0] + row[1] * frame->axis[1] + row[2] * frame->axis[2];
            state->pivot[i] = child->origin[i];
        }
        const ColumnMotion *column = &s->columns[columns[joint->column]];
        double value = frame->offset + frame->gain * column->value, size = fabs(frame->gain);
        if (joint->move == MOVE_SLIDES) {
            for (int i = 0; i < 3; i++) child->origin[i] += value * state->axis[i];
        } else {
            turn_link(child, frame->axis, value);
        }
        state->change = size * column->change;
        state->rest = size * column->rest;
        state->speed = frame->gain * column->speed;
    }
}

// The state of a joint; that of the stationary joint for no joint.
static inline JointState *state_of(const RefereeSearch *s, int64_t joint) {
    return &s->states[joint < 0 ? s->joint_count : joint];
}

// Velocities of the bodies that each joint of an arm carries, due to this joint and all joints before it.
static void add_velocities(RefereeSearch *s, int64_t arm) {
    const RefereeModel *model = model_of(s, arm);
    int64_t first = s->arms[arm].first_joint;
    for (int64_t j = 0; j < model->joint_count; j++) {
        const ArmJoint *joint = &model->joints[j];
        JointState *state = &s->states[first + j];
        const JointState *before = state_of(s, joint->parent > 0 ? first + joint->parent - 1 : -1);
        const double *axis = state->axis, *p = state->pivot;
        double speed = state->speed;
        for (int i = 0; i < 3; i++) {
            state->angular[i] = before->angular[i];
            state->linear[i] = before->linear[i];
        }
        if (joint->move == MOVE_SLIDES) {
            for (int i = 0; i < 3; i++) state->linear[i] += speed * axis[i];
        } else {
            for (int i = 0; i < 3; i++) state->angular[i] += speed * axis[i];
            state->linear[0] += speed * (p[1] * axis[2] - p[2] * axis[1]);
            state->linear[1] += speed * (p[2] * axis[0] - p[0] * axis[2]);
            state->linear[2] += speed * (p[0] * axis[1] - p[1] * axis[0]);
        }
    }
}

// World pose of a body, and the center of its bounding ball.
static void place_body(RefereeSearch *s, int64_t arm, int64_t b) {
    const RefereeBodies *bodies = model_of(s, arm)->bodies;
    const LinkPose *link = &s->links[s->arms[arm].first_link + bodies->bodies[b].link];
    const BodySizes *size = &bodies->sizes[b];
    PlacedBody *placed = &s->placed[s->arms[arm].first_body + b];
    for (int i = 0; i < 3; i++) {
        const double *row = &link->rotation[3 * i], *r = size->rotation, *o = size->origin, *c = size->center;
        for (int j = 0; j < 3; j++) placed->rotation[3 * i + j] = row[0] * r[j] + row[1] * r[3 + j] + row[2] * r[6 + j];
        placed->origin[i] = link->origin[i] + row[0] * o[0] + row[1] * o[1] + row[2] * o[2];
        placed->middle[i] = link->origin[i] + row[0] * c[0] + row[1] * c[1] + row[2] * c[2];
    }
}

// Distance that a body reaches from each joint of its chain, and how far that joint and later ones can carry the body.
static void sweep_body(RefereeSearch *s, int64_t arm, int64_t b) {
    const RefereeModel *model = model_of(s, arm);
    const RefereeBody *body = &model->bodies->bodies[b];
    const double *middle = s->placed[s->arms[arm].first_body + b].middle;
    Sweep *sweeps = s->sweeps + (s->arms[arm].first_body + b) * s->sweep_stride;
    sweeps[body->depth].carried = 0.0;
    for (int64_t i = body->depth - 1; i >= 0; i--) {
        int64_t j = model->chains[body->first_joint + i];
        const JointState *state = &s->states[s->arms[arm].first_joint + j];
        if (model->joints[j].move == MOVE_SLIDES) {
            sweeps[i] = (Sweep){1.0, sweeps[i + 1].carried + state->change};
            continue;
        }
        double x = middle[0] - state->pivot[0], y = middle[1] - state->pivot[1], z = middle[2] - state->pivot[2];
        double along = x * state->axis[0] + y * state->axis[1] + z * state->axis[2];
        double across = sqrt(greater(0.0, x * x + y * y + z * z - along * along)) + model->bodies->sizes[b].radius +
                        AXIS_ROUNDING;
        // A chord is never longer than its arc or than the diameter.
        sweeps[i] = (Sweep){across, sweeps[i + 1].carried + lesser(state->change, 2.0) * across};
    }
}

// How far the joints of its chain from `shared` on can carry a body [m].
static inline double carried_by(const RefereeSearch *s, int64_t arm, int64_t b, int64_t shared) {
    if (arm >= s->moving_count) return 0.0;
    return s->sweeps[(s->arms[arm].first_body + b) * s->sweep_stride + shared].carried;
}

// Largest deviation of a body from its steady velocity, due to the joints of its chain from `shared` on [m].
static double unsteadiness(const RefereeSearch *s, int64_t arm, int64_t b, int64_t shared) {
    if (arm >= s->moving_count) return 0.0;
    const RefereeModel *model = model_of(s, arm);
    const RefereeBody *body = &model->bodies->bodies[b];
    const JointState *states = s->states + s->arms[arm].first_joint;
    const Sweep *sweeps = s->sweeps + (s->arms[arm].first_body + b) * s->sweep_stride;
    double total = 0.0, tilt = 0.0;
    for (int64_t i = shared; i < body->depth; i++) {
        int64_t j = model->chains[body->first_joint + i];
        double change = states[j].change, rest = states[j].rest;
        if (model->joints[j].move == MOVE_SLIDES) {
            total += rest + tilt * change;
        } else {
            total += sweeps[i].reach * (rest + change * (0.5 * change + tilt));
            tilt += change;
        }
    }
    return total;
}

// Displacement of the origin of a body's frame along a direction, and the direction in the frame after its turn.
typedef struct {
    double moved;
    Direction direction;
} SteadyTurn;

// Effect of moving for `time` at the steady velocity of a body, along d: that of the joints up to `last`, which is the
// last one that carries it, minus that of the joints up to `before`.
static SteadyTurn steady_turn(const RefereeSearch *s, BodyView b, int64_t last, int64_t before, double time, Direction d) {
    const JointState *end = state_of(s, last), *begin = state_of(s, before);
    const double *p = b.placed->origin;
    double wx = end->angular[0] - begin->angular[0], wy = end->angular[1] - begin->angular[1];
    double wz = end->angular[2] - begin->angular[2];
    double vx = end->linear[0] - begin->linear[0] + wy * p[2] - wz * p[1];
    double vy = end->linear[1] - begin->linear[1] + wz * p[0] - wx * p[2];
    double vz = end->linear[2] - begin->linear[2] + wx * p[1] - wy * p[0];
    double moved = time * (d.x * vx + d.y * vy + d.z * vz);
    // d . (w x r) = (d x w) . r
    Direction turned = {
        d.x + time * (d.y * wz - d.z * wy),
        d.y + time * (d.z * wx - d.x * wz),
        d.z + time * (d.x * wy - d.y * wx),
    };
    return (SteadyTurn){moved, turned};
}

// Support of a body along d, relative to its frame's origin, after `time` at its steady velocity; see `steady_turn`.
static double steady_reach(const RefereeSearch *s, BodyView b, int64_t last, int64_t before, double time, Direction d) {
    SteadyTurn turn = steady_turn(s, b, last, before, time, d);
    return turn.moved + body_reach(b, turn.direction);
}

// Distance of the center of one body from the bounding box of another [m]; 0 inside.
static double box_distance(BodyView a, BodyView b) {
    const double *p = b.placed->middle, *q = a.placed->middle, *rotation = a.placed->rotation;
    const double *half = a.all->sizes[a.index].box;
    double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2], total = 0.0;
    for (int j = 0; j < 3; j++) {
        double along = rotation[j] * x + rotation[3 + j] * y + rotation[6 + j] * z;
        double outside = fabs(along) - half[j];
        if (outside > 0.0) total += outside * outside;
    }
    return sqrt(total);
}
