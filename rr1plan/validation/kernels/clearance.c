// How near two bodies can come on an interval of time: the cheap bounds first.
//
// A pair is settled on an interval when it provably stays apart there, and no nearer than the smallest clearance seen in
// its group less a tolerance.

// While bodies can come this much nearer [m], an interval that no direction could settle is halved without a search.
#define COARSE 0.01
// Rounding, relative to the sum of all coordinates that a distance is computed from.
#define RELATIVE_ROUNDING 2e-14

// The piece of a time; the later one at a break.
static int64_t piece_at(const RefereeSearch *s, double time) {
    int64_t low = 0, high = s->piece_count;
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (s->breaks[middle] <= time) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

static void place_movers(RefereeSearch *s) {
    move_links(s);
    for (int64_t i = 0; i < s->mover_count; i++) place_body(s, s->movers[i]);
}

// Where all bodies are at a local time, and what the joints do within `half` of it.
static void pose_bodies(RefereeSearch *s, int64_t piece, double local, double half) {
    expand_columns(s, piece, local, half);
    place_movers(s);
}

static void pose_bodies_at(RefereeSearch *s, double time) {
    int64_t piece = piece_at(s, time);
    double width = s->break_count > 1 ? s->breaks[piece + 1] - s->breaks[piece] : 0.0;
    pose_bodies(s, piece, lesser(greater(time - s->breaks[piece], 0.0), width), 0.0);
}

static inline int is_plane(const RefereeSearch *s, int64_t b) { return s->bodies->bodies[b].shape == SHAPE_PLANE; }

typedef struct {
    double gap;       // lower bound of a clearance [m]
    double rounding;  // of it
} BallGap;

// A lower bound of the clearance of a pair by its bounding balls.
static BallGap ball_gap(const RefereeSearch *s, int64_t k) {
    int64_t a = s->pairs[k].a, b = s->pairs[k].b;
    const PlacedBody *one = &s->placed[a], *two = &s->placed[b];
    const BodySizes *size_a = &s->bodies->sizes[a], *size_b = &s->bodies->sizes[b];
    double far = 0.0, square = 0.0;
    for (int i = 0; i < 3; i++) {
        far += fabs(one->origin[i]) + fabs(two->origin[i]);
        double step = two->middle[i] - one->middle[i];
        square += step * step;
    }
    if (is_plane(s, b)) {
        double rounding = RELATIVE_ROUNDING * (far + size_a->radius + fabs(size_b->rounding));
        double height = -size_b->rounding;
        for (int i = 0; i < 3; i++) height += size_b->half[i] * one->middle[i];
        return (BallGap){height - size_a->radius - s->padding[k] - rounding, rounding};
    }
    double rounding = RELATIVE_ROUNDING * (far + size_a->radius + size_b->radius);
    return (BallGap){sqrt(square) - size_a->radius - size_b->radius - s->padding[k] - rounding, rounding};
}

// The same by one body's bounding box and the other's ball [m].
static double box_gap(const RefereeSearch *s, int64_t k) {
    int64_t a = s->pairs[k].a, b = s->pairs[k].b;
    if (is_plane(s, b)) return -1e300;
    double one = box_distance(s, a, b), two = box_distance(s, b, a), best = -1e300;
    if (one > 0.0) best = one - s->bodies->sizes[b].radius;
    if (two > 0.0) best = greater(best, two - s->bodies->sizes[a].radius);
    return best - s->padding[k];
}

// d . (origin of b - origin of a); of a half-space the height of the origin of a above it.
static double origin_gap(const RefereeSearch *s, int64_t a, int64_t b, Direction d) {
    const double *p = s->placed[a].origin, *q = s->placed[b].origin;
    const BodySizes *plane = &s->bodies->sizes[b];
    if (is_plane(s, b))
        return plane->half[0] * p[0] + plane->half[1] * p[1] + plane->half[2] * p[2] - plane->rounding;
    return d.x * (q[0] - p[0]) + d.y * (q[1] - p[1]) + d.z * (q[2] - p[2]);
}

// Clearance of a pair along a direction from a to b [m]: a lower bound of it.
static double gap_along(const RefereeSearch *s, int64_t k, Direction d) {
    int64_t a = s->pairs[k].a, b = s->pairs[k].b;
    double gap = origin_gap(s, a, b, d) - body_reach(s->bodies, s->placed, a, d) - s->padding[k];
    if (is_plane(s, b)) return gap;
    return gap - body_reach(s->bodies, s->placed, b, (Direction){-d.x, -d.y, -d.z});
}

// Least clearance along a direction while both bodies move at their steady velocities [m].
static double steady_gap(const RefereeSearch *s, int64_t k, double half, Direction d) {
    const RefereePair *pair = &s->pairs[k];
    int64_t a = pair->a, b = pair->b;
    int64_t before = pair->shared > 0 ? s->chains[s->bodies->bodies[a].first_joint + pair->shared - 1] : -1;
    double least = 1e300;
    for (int end = 0; end < 2; end++) {
        double time = end ? half : -half;
        double gap = origin_gap(s, a, b, d) - steady_reach(s, a, pair->last_a, before, time, d);
        if (!is_plane(s, b)) gap -= steady_reach(s, b, pair->last_b, before, time, (Direction){-d.x, -d.y, -d.z});
        least = lesser(least, gap);
    }
    return least - s->padding[k];
}

typedef struct {
    double upper, lower;
} ClearanceBounds;

static int is_surface(const RefereeSearch *s, int64_t b);
static ClearanceBounds surface_clearance(RefereeSearch *s, int64_t k, double base, double enough);

// Bounds of the clearance of a pair [m]; the direction found is remembered.
//
// They may differ by a quarter of the upper one's distance from `base`; the search ends above `enough`.
static ClearanceBounds bound_clearance(RefereeSearch *s, int64_t k, double base, double enough) {
    int64_t a = s->pairs[k].a, b = s->pairs[k].b;
    const BodySizes *one = &s->bodies->sizes[a], *two = &s->bodies->sizes[b];
    if (is_plane(s, b)) {
        Direction d = {-two->half[0], -two->half[1], -two->half[2]};
        s->directions[k] = (KnownDirection){d.x, d.y, d.z, 1.0};
        double gap = gap_along(s, k, d);
        return (ClearanceBounds){gap, gap};
    }
    if (is_surface(s, b)) return surface_clearance(s, k, base, enough);
    s->search_count++;
    double off = one->rounding + two->rounding + s->padding[k];
    Separation found = separate(s->bodies, s->placed, a, b, &s->gjk[k], base + off, enough + off);
    s->directions[k] = (KnownDirection){found.direction.x, found.direction.y, found.direction.z, 1.0};
    return (ClearanceBounds){found.upper - off, found.lower - off};
}

// Note a clearance of a pair; whether it is too small to be told from contact.
static int note_clearance(RefereeSearch *s, int64_t k, double value, double time) {
    const RefereePair *pair = &s->pairs[k];
    PairFindings *found = &s->found[pair->elements];
    if (value < found->seen) {
        found->seen = value;
        found->when = time;
    }
    if (!(value > s->touch)) {
        s->marks[pair->elements] = PAIR_LEFT;
        // With a contact to report, only contacts are looked for.
        for (int group = 0; group < PAIR_GROUPS; group++) s->smallest[group] = lesser(s->smallest[group], 0.0);
        return 1;
    }
    if (value < s->smallest[pair->group]) {
        s->smallest[pair->group] = value;
        s->nearest[pair->group] = k;
    }
    return 0;
}

// The lower bound that the remembered direction of a pair proves [m].
static double known_bound(const RefereeSearch *s, int64_t k, double half, double approach, double error, double need) {
    const KnownDirection *known = &s->directions[k];
    Direction d = {known->x, known->y, known->z};
    double gap = gap_along(s, k, d), least = gap - approach;
    if (least > need || gap - error <= need) return least;
    return greater(least, steady_gap(s, k, half, d) - error);
}

typedef struct {
    double least;  // lower bound of a clearance on an interval [m]
    int settled;
} IntervalClearance;

static IntervalClearance surface_interval(RefereeSearch *s, int64_t k, double time, double half, double approach,
                                          double error);

// A lower bound of the clearance of a pair within `half` of the posed time, and whether that settles it.
//
// `single`: the interval is on one piece, so the joints have steady speeds.
static IntervalClearance interval_clearance(RefereeSearch *s, int64_t k, double time, double half, int single) {
    const RefereePair *pair = &s->pairs[k];
    int64_t a = pair->a, b = pair->b, shared = pair->shared;
    double need = greater(0.0, s->smallest[pair->group] - s->tolerance);
    double approach = s->sweeps[a * s->sweep_stride + shared].carried + s->sweeps[b * s->sweep_stride + shared].carried;
    BallGap ball = ball_gap(s, k);
    double least = ball.gap - approach;
    if (least > need) return (IntervalClearance){least, 1};
    least = greater(least, box_gap(s, k) - ball.rounding - approach);
    if (least > need) return (IntervalClearance){least, 1};
    if (is_surface(s, b)) {
        double error = single ? unsteadiness(s, a, shared) + unsteadiness(s, b, shared) : 1e300;
        return surface_interval(s, k, time, half, approach, error);
    }
    // No direction can prove more than the distance of two points of the bodies.
    double most = ball.gap + s->bodies->sizes[a].radius, error = 1e300;
    if (!is_plane(s, b)) most += s->bodies->sizes[b].radius;
    if (single) error = unsteadiness(s, a, shared) + ball.rounding + unsteadiness(s, b, shared);
    if (lesser(approach, error) > greater(COARSE, most - need)) return (IntervalClearance){least, 0};
    approach += ball.rounding;
    if (s->directions[k].known > 0.0) {
        least = greater(least, known_bound(s, k, half, approach, error, need));
        if (least > need) return (IntervalClearance){least, 1};
    }
    ClearanceBounds bounds = bound_clearance(s, k, need, need + approach);
    if (note_clearance(s, k, bounds.upper, time)) return (IntervalClearance){0.0, 1};
    need = greater(0.0, s->smallest[pair->group] - s->tolerance);
    least = greater(least, bounds.lower - approach);
    if (least <= need) least = greater(least, known_bound(s, k, half, approach, error, need));
    return (IntervalClearance){least, least > need};
}
