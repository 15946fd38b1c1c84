// The memory of a search, in one block that the caller allocates.

// A block and its used part [bytes]; without a block, sizes are only added up.
typedef struct {
    char *block;
    int64_t taken;
} Room;

static void *take_room(Room *room, int64_t count, int64_t size) {
    void *start = room->block ? room->block + room->taken : NULL;
    // Items are structs of numbers of eight bytes, or such numbers.
    room->taken += count * size;
    return start;
}

// Count what the scene has, and find where the columns, links, joints, bodies and elements of each arm begin.
static void count_arms(RefereeSearch *s) {
    int64_t arms = s->moving_count + s->stationary_count, columns = 0;
    s->link_count = s->joint_count = s->body_count = s->element_count = 0;
    for (int64_t arm = 0; arm <= arms; arm++) {
        int64_t number = s->arm_models[arm];
        const RefereeModel *model = &s->models[number];
        if (s->arms)
            s->arms[arm] =
                (RefereeArm){number, columns, s->link_count, s->joint_count, s->body_count, s->element_count};
        columns += model->column_count;
        s->link_count += model->joint_count + 1;
        s->joint_count += model->joint_count;
        s->body_count += model->bodies->body_count;
        s->element_count += model->element_count;
    }
    s->owner_count = arms + s->models[s->arm_models[arms]].element_count;
}

// Capacity of a chunk in pairs of bodies: enough for any two owners, but not more than all pairs.
static int64_t count_pairs(const RefereeSearch *s) {
    int64_t arms = s->moving_count + s->stationary_count, most = 0, all = 0;
    for (int64_t arm = 0; arm < arms; arm++) {
        int64_t bodies = s->models[s->arm_models[arm]].bodies->body_count;
        most = bodies > most ? bodies : most;
        all += bodies;
    }
    const RefereeModel *obstacles = &s->models[s->arm_models[arms]];
    int64_t most_of_other = most, pairs = all * s->body_count;
    for (int64_t e = 0; e < obstacles->element_count; e++) {
        int64_t bodies = obstacles->element_bodies[e + 1] - obstacles->element_bodies[e];
        most_of_other = bodies > most_of_other ? bodies : most_of_other;
    }
    int64_t two = most * most_of_other;
    if (pairs > SEARCH_CHUNK) pairs = SEARCH_CHUNK;
    return (two > pairs ? two : pairs) + 1;
}

// Set all pointers to memory in a block, or to NULL without one. Returns the memory needed [bytes].
static int64_t lay_out(RefereeSearch *s, char *block) {
    Room room = {block, 0};
    int64_t arms = s->moving_count + s->stationary_count, own_columns = 0, bodies = 0, columns = 0;
    for (int64_t arm = 0; arm < arms; arm++) {
        const RefereeModel *model = &s->models[s->arm_models[arm]];
        columns += model->column_count;
        if (arm >= s->moving_count) continue;
        own_columns += model->column_count;
        bodies += model->bodies->body_count;
    }
    int64_t spare = s->pair_room + PAIR_GROUPS + 1;
#define TAKE(field, count) s->field = take_room(&room, count, sizeof *s->field)
    TAKE(arms, arms + 1);
    TAKE(arm_columns, columns);
    TAKE(bases, arms + 1);
    TAKE(links, s->link_count);
    TAKE(columns, s->column_count + columns - own_columns);
    TAKE(chords, s->piece_count * s->column_count);
    TAKE(states, s->joint_count + 1);
    TAKE(placed, s->body_count);
    TAKE(sweeps, bodies * s->sweep_stride);
    TAKE(placed_on, bodies);
    TAKE(terms_scratch, s->terms);
    TAKE(element_boxes, s->element_count);
    TAKE(owner_boxes, s->owner_count);
    TAKE(element_slices, MOTION_SLICES * s->element_count);
    TAKE(owner_slices, MOTION_SLICES * s->owner_count);
    TAKE(owner_sweeps, s->owner_count);
    TAKE(sorted, s->owner_count);
    TAKE(near_owners, s->owner_count);
    TAKE(slices, MOTION_SLICES);
    TAKE(intervals, SEARCH_DEPTH);
    TAKE(pairs, spare);
    TAKE(elements, spare);
    TAKE(gjk, spare);
    TAKE(directions, spare);
    TAKE(marked, s->pair_room);
    TAKE(items, s->pair_room * SEARCH_DEPTH);
#undef TAKE
    for (int64_t b = 0; block && b < bodies; b++) s->placed_on[b] = 0;
    return room.taken;
}

// Memory needed to search a motion in a scene [bytes].
EXPORT int64_t rr1_size_search(RefereeSearch *s) {
    s->arms = NULL;
    count_arms(s);
    s->pair_room = count_pairs(s);
    return lay_out(s, NULL);
}

// Prepare a search in a block of the size that `rr1_size_search` returned.
EXPORT void rr1_begin_search(RefereeSearch *s, double *block) {
    int64_t arms = s->moving_count + s->stationary_count, column = 0;
    lay_out(s, (char *)block);
    count_arms(s);
    int64_t moving = s->arms[s->moving_count].first_column, all = s->arms[arms].first_column;
    for (; column < moving; column++) s->arm_columns[column] = s->columns_of_q[column];
    for (; column < all; column++) {
        int64_t own = s->column_count + column - moving;
        s->arm_columns[column] = own;
        s->columns[own] = (ColumnMotion){s->configurations[column - moving], 0.0, 0.0, 0.0};
    }
    for (int64_t arm = 0; arm <= arms; arm++) {
        LinkPose *base = &s->bases[arm];
        *base = (LinkPose){{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, {0.0, 0.0, 0.0}};
        if (arm == arms) break;
        const double *T = s->base_poses + 16 * arm;
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) base->rotation[3 * i + j] = T[4 * i + j];
            base->origin[i] = T[4 * i + 3];
        }
    }
    s->states[s->joint_count] = (JointState){.change = 0.0};
    for (int group = 0; group < PAIR_GROUPS; group++) s->smallest[group] = s->proven[group] = s->refined[group] = INFINITY;
}

// The product of two rigid transforms, shape (3, 4); the factors have shape (4, 4).
static void compose(const double *A, const double *B, double T[12]) {
    for (int i = 0; i < 3; i++) {
        const double *row = A + 4 * i;
        for (int j = 0; j < 4; j++) T[4 * i + j] = row[0] * B[j] + row[1] * B[4 + j] + row[2] * B[8 + j];
        T[4 * i + 3] += row[3];
    }
}

// Fill the tables of bodies from their shapes. Returns the number of columns of their corners.
//
// frames: pose of each shape in the frame of its element, shape (4, 4) each; elements: pose of each element on its link;
// first_body: the first body of each element, and one past the last.
EXPORT int64_t rr1_fill_bodies(const ShapeRow *shapes, const double *frames, const double *elements,
                               const int64_t *first_body, int64_t element_count, RefereeBody *bodies,
                               BodySizes *sizes) {
    int64_t columns = 0, element = 0;
    for (int64_t b = 0; b < first_body[element_count]; b++) {
        while (first_body[element + 1] <= b) element++;
        double T[12];
        compose(elements + 16 * element, frames + 16 * b, T);
        const ShapeRow *shape = &shapes[b];
        BodySizes *size = &sizes[b];
        bodies[b] = (RefereeBody){
            .shape = (int64_t)shape->shape, .first_corner = columns, .corner_count = (int64_t)shape->corner_count};
        columns += (int64_t)shape->columns;
        size->rounding = shape->rounding;
        size->radius = shape->radius;
        for (int i = 0; i < 3; i++) {
            const double *c = shape->center;
            size->half[i] = shape->half[i];
            size->box[i] = shape->box[i];
            for (int j = 0; j < 3; j++) size->rotation[3 * i + j] = T[4 * i + j];
            size->origin[i] = T[4 * i + 3];
            size->center[i] = T[4 * i] * c[0] + T[4 * i + 1] * c[1] + T[4 * i + 2] * c[2] + T[4 * i + 3];
        }
    }
    return columns;
}
