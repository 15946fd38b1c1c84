// Bounds of the clearance of two bodies on an interval of time: the cheap bounds first.
//
// A pair is settled on an interval if it is proven to stay apart there, at a distance not below the smallest clearance
// seen in its group minus a tolerance.

// If bodies can come nearer by this much [m], an interval that no direction could settle is halved without a search.
#define COARSE 0.01
// Rounding error relative to the sum of all coordinates that a distance is computed from.
#define RELATIVE_ROUNDING 2e-14

// The piece that contains a time; the later one at a break.
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

// A time of the motion as a piece and a local time.
typedef struct {
    int64_t piece;
    double local;
} PieceTime;

static PieceTime locate_time(const RefereeSearch *s, double time) {
    int64_t piece = piece_at(s, time);
    double width = s->break_count > 1 ? s->breaks[piece + 1] - s->breaks[piece] : 0.0;
    return (PieceTime){piece, lesser(greater(time - s->breaks[piece], 0.0), width)};
}

static inline BodyView view_of(const RefereeSearch *s, int64_t arm, int64_t body) {
    return (BodyView){model_of(s, arm)->bodies, body, &s->placed[s->arms[arm].first_body + body]};
}

typedef struct {
    BodyView a, b;
} PairView;

static inline PairView view_pair(const RefereeSearch *s, int64_t k) {
    const RefereePair *pair = &s->pairs[k];
    return (PairView){view_of(s, pair->arm_a, pair->body_a), view_of(s, pair->arm_b, pair->body_b)};
}

static inline int is_plane(BodyView b) { return b.all->bodies[b.index].shape == SHAPE_PLANE; }

// A body of many convex parts.
static inline int is_compound(BodyView b) { return b.all->bodies[b.index].shape >= SHAPE_SURFACE; }

static inline double radius_of(BodyView b) { return b.all->sizes[b.index].radius; }

static inline double rounding_of(BodyView b) { return b.all->sizes[b.index].rounding; }

// World normal of a half-space.
static Direction plane_normal(BodyView plane) {
    const double *r = plane.placed->rotation, *n = plane.all->sizes[plane.index].half;
    return (Direction){
        r[0] * n[0] + r[1] * n[1] + r[2] * n[2],
        r[3] * n[0] + r[4] * n[1] + r[5] * n[2],
        r[6] * n[0] + r[7] * n[1] + r[8] * n[2],
    };
}

// Height of a point above a half-space [m].
static double plane_height(BodyView plane, const double p[3]) {
    Direction n = plane_normal(plane);
    const double *o = plane.placed->origin;
    return n.x * (p[0] - o[0]) + n.y * (p[1] - o[1]) + n.z * (p[2] - o[2]) - rounding_of(plane);
}

typedef struct {
    double gap;       // lower bound of a clearance [m]
    double rounding;  // of it
} BallGap;

// A lower bound of the clearance of two bodies from their bounding balls; a half-space comes second.
static BallGap ball_gap(BodyView a, BodyView b, double padding) {
    double far = 0.0, square = 0.0;
    for (int i = 0; i < 3; i++) {
        far += fabs(a.placed->origin[i]) + fabs(b.placed->origin[i]);
        double step = b.placed->middle[i] - a.placed->middle[i];
        square += step * step;
    }
    if (is_plane(b)) {
        double rounding = RELATIVE_ROUNDING * (far + radius_of(a) + fabs(rounding_of(b)));
        return (BallGap){plane_height(b, a.placed->middle) - radius_of(a) - padding - rounding, rounding};
    }
    double rounding = RELATIVE_ROUNDING * (far + radius_of(a) + radius_of(b));
    return (BallGap){sqrt(square) - radius_of(a) - radius_of(b) - padding - rounding, rounding};
}

// A lower bound of the clearance from one body's bounding box and the other's ball [m].
static double box_gap(BodyView a, BodyView b, double padding) {
    if (is_plane(b)) return -1e300;
    double one = box_distance(a, b), two = box_distance(b, a), best = -1e300;
    if (one > 0.0) best = one - radius_of(b);
    if (two > 0.0) best = greater(best, two - radius_of(a));
    return best - padding;
}

// d . (origin of b - origin of a); for a half-space, the height of the origin of a above it.
static double origin_gap(BodyView a, BodyView b, Direction d) {
    const double *p = a.placed->origin, *q = b.placed->origin;
    if (is_plane(b)) return plane_height(b, p);
    return d.x * (q[0] - p[0]) + d.y * (q[1] - p[1]) + d.z * (q[2] - p[2]);
}

// A lower bound of the clearance of a pair [m], from a direction from a to b.
static double gap_along(PairView v, Direction d, double padding) {
    double gap = origin_gap(v.a, v.b, d) - body_reach(v.a, d) - padding;
    if (is_plane(v.b)) return gap;
    return gap - body_reach(v.b, (Direction){-d.x, -d.y, -d.z});
}

// Smallest clearance along a direction while both bodies move at their steady velocities [m].
static double steady_gap(const RefereeSearch *s, const RefereePair *pair, PairView v, double half, Direction d) {
    double least = 1e300;
    for (int end = 0; end < 2; end++) {
        double time = end ? half : -half;
        double gap = origin_gap(v.a, v.b, d) - steady_reach(s, v.a, pair->last_a, pair->before, time, d);
        if (!is_plane(v.b))
            gap -= steady_reach(s, v.b, pair->last_b, pair->before, time, (Direction){-d.x, -d.y, -d.z});
        least = lesser(least, gap);
    }
    return least - pair->padding;
}

typedef struct {
    double upper, lower;
} ClearanceBounds;

static ClearanceBounds compound_clearance(RefereeSearch *s, int64_t k, double base, double enough);

// The clearance that follows from a separation of two bodies and is smaller than the distance by `off` [m]; for bodies
// in contact, minus the depth.
static Separation sign_clearance(BodyView a, BodyView b, Separation found, double off, double touch) {
    if (!(found.upper - off > touch) && found.lower < -1e299) found.upper = found.lower = -penetration(a, b);
    found.upper -= off;
    found.lower -= off;
    return found;
}

// Bounds of the clearance of a pair [m], or of minus the depth if it is in contact; the direction found is stored.
//
// The bounds may differ by a quarter of the upper bound's distance from `base`; the search ends above `enough`.
static ClearanceBounds bound_clearance(RefereeSearch *s, int64_t k, double base, double enough) {
    PairView v = view_pair(s, k);
    double padding = s->pairs[k].padding;
    if (is_plane(v.b)) {
        Direction n = plane_normal(v.b), d = {-n.x, -n.y, -n.z};
        s->directions[k] = (KnownDirection){d.x, d.y, d.z, 1.0};
        double gap = gap_along(v, d, padding);
        return (ClearanceBounds){gap, gap};
    }
    s->search_count++;
    s->chunk_searches++;
    if (is_compound(v.b)) return compound_clearance(s, k, base, enough);
    double off = rounding_of(v.a) + rounding_of(v.b) + padding;
    Separation found = separate(v.a, v.b, &s->gjk[k], base + off, enough + off);
    s->directions[k] = (KnownDirection){found.direction.x, found.direction.y, found.direction.z, 1.0};
    found = sign_clearance(v.a, v.b, found, off, s->touch);
    return (ClearanceBounds){found.upper, found.lower};
}

// The smallest clearance of a group that has to be proven on an interval [m]; one below `touch` counts as contact.
static inline double needed_clearance(const RefereeSearch *s, int64_t group) {
    double smallest = s->smallest[group];
    if (!s->with_clearance) return s->touch;
    return smallest < INFINITY ? greater(s->touch, smallest - greater(s->tolerance, s->share * smallest)) : smallest;
}

// Index where the nearest pair of a group is stored, after the pairs of the chunk; and of a temporary pair.
static inline int64_t nearest_pair(const RefereeSearch *s, int64_t group) { return s->pair_room + group; }

static inline int64_t spare_pair(const RefereeSearch *s) { return s->pair_room + PAIR_GROUPS; }

// Note a clearance of a pair. Returns whether it is too small to be distinguished from contact.
static int note_clearance(RefereeSearch *s, int64_t k, double value, double time) {
    RefereePair *pair = &s->pairs[k];
    ElementPair *elements = &s->elements[pair->elements];
    if (value < elements->seen) {
        elements->pair = k;
        elements->seen = value;
        elements->when = time;
    }
    if (!(value > s->touch)) {
        elements->mark = PAIR_TOUCHES;
        elements->first = lesser(elements->first, time);
        // Once there is a contact to report, search for contacts only.
        for (int group = 0; group < PAIR_GROUPS; group++) s->smallest[group] = lesser(s->smallest[group], 0.0);
        return 1;
    }
    if (value < s->smallest[pair->group]) {
        int64_t best = nearest_pair(s, pair->group);
        s->smallest[pair->group] = value;
        s->has_nearest[pair->group] = 1;
        if (k != best) {
            s->pairs[best] = *pair;
            s->pairs[best].elements = best;
            s->elements[best] = *elements;
            s->elements[best].mark = PAIR_FREE;
            s->elements[best].pair = best;
            s->gjk[best].count = 0;
            s->directions[best].known = 0.0;
        }
        s->elements[best].seen = value;
        s->elements[best].when = time;
    }
    return 0;
}

// The lower bound that the stored direction of a pair proves [m].
static double known_bound(const RefereeSearch *s, int64_t k, PairView v, double half, double approach, double error,
                          double need) {
    const KnownDirection *known = &s->directions[k];
    Direction d = {known->x, known->y, known->z};
    double gap = gap_along(v, d, s->pairs[k].padding), least = gap - approach;
    if (least > need || gap - error <= need) return least;
    return greater(least, steady_gap(s, &s->pairs[k], v, half, d) - error);
}

typedef struct {
    double least;  // lower bound of a clearance on an interval [m]
    int settled;
} IntervalClearance;

static IntervalClearance compound_interval(RefereeSearch *s, int64_t k, double time, double half, double approach,
                                           double error);

// A lower bound of the clearance of a pair within `half` of the posed time, and whether it settles the pair.
static IntervalClearance interval_clearance(RefereeSearch *s, int64_t k, double time, double half) {
    const RefereePair *pair = &s->pairs[k];
    PairView v = view_pair(s, k);
    double need = needed_clearance(s, pair->group);
    double approach = carried_by(s, pair->arm_a, pair->body_a, pair->shared) +
                      carried_by(s, pair->arm_b, pair->body_b, pair->shared);
    BallGap ball = ball_gap(v.a, v.b, pair->padding);
    double least = ball.gap - approach;
    if (least > need) return (IntervalClearance){least, 1};
    least = greater(least, box_gap(v.a, v.b, pair->padding) - ball.rounding - approach);
    if (least > need) return (IntervalClearance){least, 1};
    // No direction can prove more than the distance between some points of the bodies.
    double most = ball.gap + radius_of(v.a);
    if (!is_plane(v.b)) most += radius_of(v.b);
    double error = unsteadiness(s, pair->arm_a, pair->body_a, pair->shared) + ball.rounding +
                   unsteadiness(s, pair->arm_b, pair->body_b, pair->shared);
    if (is_compound(v.b)) return compound_interval(s, k, time, half, approach, error);
    if (lesser(approach, error) > greater(COARSE, most - need)) return (IntervalClearance){least, 0};
    approach += ball.rounding;
    if (s->directions[k].known > 0.0) {
        least = greater(least, known_bound(s, k, v, half, approach, error, need));
        if (least > need) return (IntervalClearance){least, 1};
    }
    ClearanceBounds bounds = bound_clearance(s, k, need, need + approach);
    if (note_clearance(s, k, bounds.upper, time)) return (IntervalClearance){0.0, 1};
    need = needed_clearance(s, pair->group);
    least = greater(least, bounds.lower - approach);
    if (least <= need && bounds.lower - error > need) {
        const KnownDirection *known = &s->directions[k];
        least = greater(least, steady_gap(s, pair, v, half, (Direction){known->x, known->y, known->z}) - error);
    }
    return (IntervalClearance){least, least > need};
}

// For a pair in contact, minus the largest depth seen, lowered by the tolerance or a twentieth of it [m].
static inline double enough_depth(const RefereeSearch *s, const ElementPair *elements) {
    if (!(elements->seen < INFINITY)) return 1e300;
    return elements->seen - greater(s->tolerance, 0.05 * fabs(elements->seen));
}

// A lower bound of the clearance of a pair in contact on the interval around the posed time, and whether it excludes
// depths that exceed the largest one seen by more than the tolerance and a twentieth.
static IntervalClearance depth_interval(RefereeSearch *s, int64_t k, double time) {
    const RefereePair *pair = &s->pairs[k];
    const ElementPair *elements = &s->elements[pair->elements];
    PairView v = view_pair(s, k);
    double approach = carried_by(s, pair->arm_a, pair->body_a, pair->shared) +
                      carried_by(s, pair->arm_b, pair->body_b, pair->shared);
    double enough = enough_depth(s, elements);
    double least = greater(ball_gap(v.a, v.b, pair->padding).gap, box_gap(v.a, v.b, pair->padding)) - approach;
    if (least >= enough) return (IntervalClearance){least, 1};
    int64_t searches = s->search_count, chunk_searches = s->chunk_searches;
    double value = bound_clearance(s, k, 1e300, enough + approach).upper;
    s->depth_count += s->search_count - searches;
    s->chunk_depths += s->chunk_searches - chunk_searches;
    s->chunk_searches = chunk_searches;
    note_clearance(s, k, value, time);
    return (IntervalClearance){value - approach, value - approach >= enough_depth(s, elements)};
}
