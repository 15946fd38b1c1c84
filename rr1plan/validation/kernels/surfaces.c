// Bodies of many convex parts: the triangles of a surface, the cells of a point cloud.
//
// The second body of a pair is of this kind, the first one may be. Everything is computed in the frame of the second
// body. A stack holds pairs of nodes whose boxes may come near each other; of two inner nodes the larger one is opened.
// The search of `referee_gjk.c` finds the distance of two parts, and the bound that its direction proves holds for a
// whole interval. The planes that separated the last parts separate most others.

// Planes that are stored; stacked pairs of nodes, at most the depths of both trees, which are split at medians.
enum { MOST_PLANES = 4, WALK_DEPTH = 160 };

// All points of a body are below `edge` along a unit direction [m]; for a body of many parts, `edge` is unknown.
typedef struct {
    Direction normal;
    double edge;
} BodyPlane;

// A body of a pair in the frame of the second one, and its current part, which is the whole of a convex body.
typedef struct {
    BodyView whole;  // in the world
    const RefereeBody *body;
    const SurfaceBox *boxes;
    const SurfaceNode *nodes;  // NULL: convex
    RefereeBody part;
    BodySizes sizes;   // of the part
    PlacedBody placed;  // the part
    double origin[3];   // of the body
    RefereeBodies all;  // the part alone, with the corners of the body
} Side;

typedef struct {
    Side sides[2];
    double off;       // rounding of the first body and distance to keep [m]
    double rounding;  // of coordinates [m]
    BodyPlane planes[MOST_PLANES];
    int64_t plane_count;  // found so far; the last ones are stored
} CompoundPair;

// A node or a part of each body; -1 for a convex one.
typedef struct {
    int64_t a, b;
} TwoOf;

static void turn_into(const PlacedBody *frame, const double *world, double *local) {
    for (int i = 0; i < 3; i++)
        local[i] = frame->rotation[i] * world[0] + frame->rotation[3 + i] * world[1] + frame->rotation[6 + i] * world[2];
}

static void turn_from(const PlacedBody *frame, const double *local, double *world) {
    for (int i = 0; i < 3; i++)
        world[i] = frame->rotation[3 * i] * local[0] + frame->rotation[3 * i + 1] * local[1] +
                   frame->rotation[3 * i + 2] * local[2];
}

static void place_side(Side *side, BodyView whole, const PlacedBody *frame) {
    const PlacedBody *body = whole.placed;
    double origin[3], middle[3];
    side->whole = whole;
    side->body = &whole.all->bodies[whole.index];
    side->nodes = is_compound(whole) ? whole.all->nodes + side->body->first_node : NULL;
    side->boxes = whole.all->boxes + (side->nodes ? side->body->first_node : 0);
    side->part = *side->body;
    side->sizes = whole.all->sizes[whole.index];
    for (int c = 0; c < 3; c++) {
        double column[3] = {body->rotation[c], body->rotation[3 + c], body->rotation[6 + c]}, local[3];
        turn_into(frame, column, local);
        for (int i = 0; i < 3; i++) side->placed.rotation[3 * i + c] = local[i];
        origin[c] = body->origin[c] - frame->origin[c];
        middle[c] = body->middle[c] - frame->origin[c];
    }
    if (body == frame) side->placed = (PlacedBody){.rotation = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}};
    turn_into(frame, origin, side->origin);
    turn_into(frame, middle, side->placed.middle);
    for (int i = 0; i < 3; i++) side->placed.origin[i] = side->origin[i];
    side->all = *whole.all;
    side->all.bodies = &side->part;
    side->all.sizes = &side->sizes;
    if (side->body->shape == SHAPE_SURFACE) side->part = (RefereeBody){.shape = SHAPE_HULL, .corner_count = 3};
    if (side->body->shape == SHAPE_CELLS) side->part = (RefereeBody){.shape = SHAPE_BOX};
}

static void place_compound(PairView v, double padding, CompoundPair *pair) {
    double far = 0.0;
    place_side(&pair->sides[0], v.a, v.b.placed);
    place_side(&pair->sides[1], v.b, v.b.placed);
    for (int i = 0; i < 3; i++) far += fabs(v.a.placed->origin[i]) + fabs(v.b.placed->origin[i]);
    pair->off = pair->sides[0].sizes.rounding + padding;
    pair->rounding = RELATIVE_ROUNDING * (far + radius_of(v.a) + radius_of(v.b));
    pair->plane_count = 0;
}

// The center of a cell, or the first corner of a triangle, in the frame of the body.
static inline void corner_of(const Side *side, int64_t corner, double point[3]) {
    for (int i = 0; i < 3; i++) point[i] = side->all.corners[i * side->all.corner_count + side->body->first_corner + corner];
}

// Select a part of a body.
static void choose_part(Side *side, int64_t part) {
    if (!side->nodes) return;
    double at[3] = {0.0, 0.0, 0.0}, corner[3];
    int triangle = side->body->shape == SHAPE_SURFACE;
    if (triangle) {
        side->part.first_corner = side->body->first_corner + 3 * part;
        for (int c = 0; c < 3; c++) {
            corner_of(side, 3 * part + c, corner);
            for (int i = 0; i < 3; i++) at[i] += corner[i] / 3.0;
        }
    } else {
        corner_of(side, part, at);
    }
    turn_from(&side->placed, at, side->placed.middle);
    for (int i = 0; i < 3; i++) {
        side->placed.middle[i] += side->origin[i];
        if (!triangle) side->placed.origin[i] = side->placed.middle[i];
    }
}

static inline BodyView part_view(const Side *side) { return (BodyView){&side->all, 0, &side->placed}; }

// Support of a part along a direction in the frame of its body, relative to that frame's origin.
static double part_reach(const Side *side, int64_t part, Direction own) {
    const RefereeBody *body = side->body;
    int cells = body->shape == SHAPE_CELLS;
    int64_t first = body->first_corner + (cells ? part : 3 * part);
    double reach = corner_reach(&side->all, (CornerRange){first, first + (cells ? 1 : 3)}, own);
    return cells ? reach + side->sizes.half[0] * (fabs(own.x) + fabs(own.y) + fabs(own.z)) : reach;
}

static void add_plane(CompoundPair *pair, Direction d) {
    const Side *a = &pair->sides[0];
    double edge = 0.0;
    if (!a->nodes) edge = body_reach(part_view(a), d) + d.x * a->origin[0] + d.y * a->origin[1] + d.z * a->origin[2];
    pair->planes[pair->plane_count++ % MOST_PLANES] = (BodyPlane){d, edge};
}

// Lower bound of the clearance of two parts from the stored planes [m].
static double beyond_planes(const CompoundPair *pair, TwoOf parts) {
    const Side *a = &pair->sides[0];
    double best = -1e300;
    int64_t count = lesser_index(pair->plane_count, MOST_PLANES);
    for (int64_t i = 0; i < count; i++) {
        Direction d = pair->planes[i].normal;
        double edge = pair->planes[i].edge;
        if (a->nodes)
            edge = part_reach(a, parts.a, in_frame(&a->placed, d)) + d.x * a->origin[0] + d.y * a->origin[1] +
                   d.z * a->origin[2];
        best = greater(best, -part_reach(&pair->sides[1], parts.b, (Direction){-d.x, -d.y, -d.z}) - edge);
    }
    return best - (pair->off - pair->sides[0].sizes.rounding) - pair->rounding;
}

// The box around a node, in the frame of its body.
static inline SurfaceBox node_box(const Side *side, int64_t node) {
    if (side->nodes) return side->boxes[node];
    const double *box = side->sizes.box;
    return (SurfaceBox){{0.0, 0.0, 0.0}, {box[0], box[1], box[2]}};
}

// Lower bound of the clearance of two nodes [m]; if their boxes overlap, minus the overlap.
static double node_clearance(const CompoundPair *pair, TwoOf nodes) {
    const Side *a = &pair->sides[0];
    const double *R = a->placed.rotation;
    SurfaceBox one = node_box(a, nodes.a), two = node_box(&pair->sides[1], nodes.b);
    double at[3], x[3], outside[2] = {0.0, 0.0}, most = -1e300, ball = 0.0;
    turn_from(&a->placed, one.center, at);
    for (int i = 0; i < 3; i++) {
        at[i] = a->nodes ? at[i] + a->origin[i] : a->placed.middle[i];
        x[i] = two.center[i] - at[i];
    }
    for (int i = 0; i < 3; i++) {
        const double *row = &R[3 * i];
        double gaps[2] = {
            fabs(R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2]) - one.half[i] -
                (fabs(R[i]) * two.half[0] + fabs(R[3 + i]) * two.half[1] + fabs(R[6 + i]) * two.half[2]),
            fabs(x[i]) - two.half[i] - (fabs(row[0]) * one.half[0] + fabs(row[1]) * one.half[1] + fabs(row[2]) * one.half[2]),
        };
        for (int k = 0; k < 2; k++) {
            most = greater(most, gaps[k]);
            if (gaps[k] > 0.0) outside[k] += gaps[k] * gaps[k];
        }
        double out = fabs(x[i]) - two.half[i];
        if (out > 0.0) ball += out * out;
    }
    double around = greater(outside[0], outside[1]);
    around = around > 0.0 ? sqrt(around) : most;
    if (!a->nodes) around = greater(around, sqrt(ball) - a->sizes.radius);
    int64_t count = lesser_index(pair->plane_count, MOST_PLANES);
    for (int64_t i = 0; i < count; i++) {
        Direction d = pair->planes[i].normal, own = in_frame(&a->placed, d);
        double edge = pair->planes[i].edge;
        if (a->nodes)
            edge = d.x * at[0] + d.y * at[1] + d.z * at[2] + fabs(own.x) * one.half[0] + fabs(own.y) * one.half[1] +
                   fabs(own.z) * one.half[2];
        around = greater(around, d.x * two.center[0] + d.y * two.center[1] + d.z * two.center[2] - edge -
                                     (fabs(d.x) * two.half[0] + fabs(d.y) * two.half[1] + fabs(d.z) * two.half[2]));
    }
    return around - (pair->off - a->sizes.rounding) - pair->rounding;
}

// ---- parts near each other ---------------------------------------------------------------------

typedef struct {
    TwoOf waiting[WALK_DEPTH];
    int64_t count;
    TwoOf first, last, at;  // parts of two leaves, and the next pair of them
    double passed;           // smallest bound of the nodes and parts that were not searched [m]
} Walk;

static void begin_walk(const CompoundPair *pair, Walk *walk) {
    walk->waiting[0] = (TwoOf){pair->sides[0].nodes ? 0 : -1, 0};
    walk->count = 1;
    walk->first = walk->last = walk->at = (TwoOf){0, 0};
    walk->passed = INFINITY;
}

static inline int is_leaf(const Side *side, int64_t node) {
    return node < 0 || side->nodes[node].last > side->nodes[node].first;
}

// Open one of two nodes, which are not both leaves.
static void open_nodes(const CompoundPair *pair, Walk *walk, TwoOf nodes) {
    const Side *a = &pair->sides[0], *b = &pair->sides[1];
    int open_b = !is_leaf(b, nodes.b);
    if (open_b && !is_leaf(a, nodes.a)) {
        const double *one = a->boxes[nodes.a].half, *two = b->boxes[nodes.b].half;
        open_b = two[0] + two[1] + two[2] >= one[0] + one[1] + one[2];
    }
    TwoOf low = nodes, high = nodes;
    if (open_b) {
        low.b = nodes.b + 1;
        high.b = b->nodes[low.b].next;
    } else {
        low.a = nodes.a + 1;
        high.a = a->nodes[low.a].next;
    }
    walk->waiting[walk->count++] = high;
    walk->waiting[walk->count++] = low;
}

// Find the next two parts that may be nearer than `limit`. Returns whether there are any.
static int next_parts(const CompoundPair *pair, Walk *walk, double limit, TwoOf *parts) {
    const Side *sides = pair->sides;
    for (;;) {
        while (walk->at.a < walk->last.a) {
            *parts = walk->at;
            if (++walk->at.b == walk->last.b) walk->at = (TwoOf){walk->at.a + 1, walk->first.b};
            double bound = beyond_planes(pair, *parts);
            if (!(bound >= limit)) return 1;
            walk->passed = lesser(walk->passed, bound);
        }
        if (walk->count == 0) return 0;
        TwoOf nodes = walk->waiting[--walk->count];
        double bound = node_clearance(pair, nodes);
        if (bound >= limit) {
            walk->passed = lesser(walk->passed, bound);
        } else if (is_leaf(&sides[0], nodes.a) && is_leaf(&sides[1], nodes.b)) {
            const SurfaceNode *b = &sides[1].nodes[nodes.b];
            walk->first = (TwoOf){0, b->first};
            walk->last = (TwoOf){1, b->last};
            if (sides[0].nodes) {
                walk->first.a = sides[0].nodes[nodes.a].first;
                walk->last.a = sides[0].nodes[nodes.a].last;
            }
            walk->at = walk->first;
        } else {
            open_nodes(pair, walk, nodes);
        }
    }
}

// ---- clearances --------------------------------------------------------------------------------

// Store the indices of the nearest parts and their direction, from which the next search starts.
static void remember_parts(RefereeSearch *s, int64_t k, const CompoundPair *pair, TwoOf parts, Direction d) {
    double number = (double)parts.a * (double)pair->sides[1].body->corner_count + (double)parts.b;
    s->directions[k] = (KnownDirection){d.x, d.y, d.z, 1.0 + number};
}

static TwoOf remembered_parts(const RefereeSearch *s, int64_t k, const CompoundPair *pair) {
    int64_t number = (int64_t)s->directions[k].known - 1, count = pair->sides[1].body->corner_count;
    return (TwoOf){number / count, number % count};
}

// Bounds of the clearance of two parts [m]; see `bound_clearance`.
static Separation part_clearance(CompoundPair *pair, TwoOf parts, double touch, double base, double enough) {
    GjkState state = {.count = 0};
    choose_part(&pair->sides[0], parts.a);
    choose_part(&pair->sides[1], parts.b);
    BodyView a = part_view(&pair->sides[0]), b = part_view(&pair->sides[1]);
    Separation found = separate(a, b, &state, base + pair->off, enough + pair->off);
    if (found.lower > 0.0) add_plane(pair, found.direction);
    return sign_clearance(a, b, found, pair->off, touch);
}

static int encloses(BodyView body, BodyView surface);

// Bounds of the clearance of a pair [m]; see `bound_clearance`. The nearest parts are stored.
static ClearanceBounds compound_clearance(RefereeSearch *s, int64_t k, double base, double enough) {
    PairView v = view_pair(s, k);
    CompoundPair pair;
    Walk walk;
    place_compound(v, s->pairs[k].padding, &pair);
    ClearanceBounds bounds = {INFINITY, INFINITY};
    int inside = encloses(v.a, v.b) || encloses(v.b, v.a), known = s->directions[k].known > 0.0;
    if (inside) base = enough = 1e300;
    TwoOf parts = remembered_parts(s, k, &pair);
    begin_walk(&pair, &walk);
    while (known || next_parts(&pair, &walk, lesser(enough, bounds.upper), &parts)) {
        known = 0;
        Separation found = part_clearance(&pair, parts, s->touch, base, lesser(enough, bounds.upper));
        if (found.upper < bounds.upper) {
            bounds.upper = found.upper;
            remember_parts(s, k, &pair, parts, found.direction);
        }
        bounds.lower = lesser(bounds.lower, found.lower);
    }
    bounds.lower = lesser(bounds.lower, walk.passed) - pair.rounding;
    if (inside && bounds.upper > s->touch) return (ClearanceBounds){-bounds.upper, -bounds.upper};
    return bounds;
}

// Support of a body of a pair, or of one part of it, along a world direction after `time` at its steady velocity [m].
static double steady_part_reach(const RefereeSearch *s, const Side *side, int64_t part, int64_t last, int64_t before,
                                double time, Direction d) {
    if (!side->nodes) return steady_reach(s, side->whole, last, before, time, d);
    SteadyTurn turn = steady_turn(s, side->whole, last, before, time, d);
    return turn.moved + part_reach(side, part, in_frame(side->whole.placed, turn.direction));
}

// Smallest clearance of two parts along a direction in the second body's frame, both at their steady velocities [m].
static double steady_part_gap(const RefereeSearch *s, const RefereePair *of, const CompoundPair *pair, TwoOf parts,
                              double half, Direction local) {
    const Side *a = &pair->sides[0], *b = &pair->sides[1];
    double along[3] = {local.x, local.y, local.z}, world[3], least = 1e300;
    turn_from(b->whole.placed, along, world);
    Direction d = {world[0], world[1], world[2]}, back = {-d.x, -d.y, -d.z};
    for (int end = 0; end < 2; end++) {
        double time = end ? half : -half;
        double gap = origin_gap(a->whole, b->whole, d) - steady_part_reach(s, a, parts.a, of->last_a, of->before, time, d);
        gap -= steady_part_reach(s, b, parts.b, of->last_b, of->before, time, back);
        least = lesser(least, gap);
    }
    return least - of->padding;
}

// A bound of the clearance of a pair within `half` of the posed time; see `interval_clearance`.
//
// `approach` is how much the distance can shrink, `error` how far bodies can deviate from their steady velocities.
static IntervalClearance compound_interval(RefereeSearch *s, int64_t k, double time, double half, double approach,
                                           double error) {
    const RefereePair *of = &s->pairs[k];
    CompoundPair pair;
    Walk walk;
    place_compound(view_pair(s, k), of->padding, &pair);
    // The previously nearest parts come first, as they are the most likely to leave the pair open.
    int known = s->directions[k].known > 0.0;
    TwoOf parts = remembered_parts(s, k, &pair);
    double least = INFINITY, nearest = INFINITY;
    if (known) add_plane(&pair, (Direction){s->directions[k].x, s->directions[k].y, s->directions[k].z});
    s->search_count++;
    s->chunk_searches++;
    begin_walk(&pair, &walk);
    while (known || next_parts(&pair, &walk, needed_clearance(s, of->group) + approach, &parts)) {
        known = 0;
        double need = needed_clearance(s, of->group);
        Separation found = part_clearance(&pair, parts, s->touch, need, need + approach);
        if (found.upper < nearest) {
            nearest = found.upper;
            remember_parts(s, k, &pair, parts, found.direction);
        }
        if (note_clearance(s, k, found.upper, time)) return (IntervalClearance){0.0, 1};
        need = needed_clearance(s, of->group);
        double bound = found.lower - pair.rounding - approach;
        if (bound <= need)
            bound = greater(bound, steady_part_gap(s, of, &pair, parts, half, found.direction) - pair.rounding - error);
        least = lesser(least, bound);
        if (bound <= need) return (IntervalClearance){least, 0};
    }
    return (IntervalClearance){lesser(least, walk.passed - approach), 1};
}

// ---- enclosure ---------------------------------------------------------------------------------

// The corners of a triangle relative to a point.
typedef struct {
    Direction of[3];
} Corners;

// Half the solid angle of a triangle, seen from the origin (van Oosterom, Strackee 1983, The solid angle of a plane
// triangle).
static double half_solid_angle(const Corners *c) {
    double length[3], volume = dot_product(c->of[0], cross_product(c->of[1], c->of[2]));
    for (int i = 0; i < 3; i++) length[i] = sqrt(dot_product(c->of[i], c->of[i]));
    double base = length[0] * length[1] * length[2];
    for (int i = 0; i < 3; i++) base += dot_product(c->of[i], c->of[(i + 1) % 3]) * length[(i + 2) % 3];
    return atan2(volume, base);
}

// Whether a ray from the origin intersects a triangle.
static int meets_ray(const Corners *c, Direction ray) {
    double sides[3], sum = 0.0;
    for (int i = 0; i < 3; i++) {
        sides[i] = dot_product(cross_product(c->of[i], c->of[(i + 1) % 3]), ray);
        sum += sides[i];
    }
    int through = (sides[0] > 0.0 && sides[1] > 0.0 && sides[2] > 0.0) || (sides[0] < 0.0 && sides[1] < 0.0 && sides[2] < 0.0);
    return through && dot_product(c->of[0], cross_product(c->of[1], c->of[2])) * sum > 0.0;
}

// Whether closed parts of a surface enclose a point of its frame: by winding number or, if faces are inconsistently
// oriented, if one of three rays intersects an odd number of triangles.
static int surrounds(const RefereeBodies *all, const RefereeBody *of, const double point[3]) {
    static const Direction rays[3] = {{0.5257, 0.3141, 0.7905}, {-0.7071, 0.6612, 0.2503}, {0.1732, -0.866, -0.4691}};
    const double *x = all->corners + of->first_corner, *y = x + all->corner_count, *z = y + all->corner_count;
    const double *bits = z + all->corner_count;
    double total = 0.0;
    int64_t met[3] = {0, 0, 0};
    for (int64_t c = 0; c < of->corner_count; c += 3) {
        if (!((int64_t)bits[c] & FACE_CLOSED)) continue;
        Corners corners;
        for (int i = 0; i < 3; i++)
            corners.of[i] = (Direction){x[c + i] - point[0], y[c + i] - point[1], z[c + i] - point[2]};
        if ((int64_t)bits[c] & FACE_MIXED) {
            for (int i = 0; i < 3; i++) met[i] += meets_ray(&corners, rays[i]);
        } else {
            total += half_solid_angle(&corners);
        }
    }
    return fabs(total) > 3.0 || met[0] % 2 || met[1] % 2 || met[2] % 2;
}

// Whether closed parts of a surface enclose a part of a body, at their current poses.
//
// A part that never touches the surface during the motion is inside always or never, and so are all of its points.
static int encloses(BodyView body, BodyView surface) {
    const RefereeBody *own = &body.all->bodies[body.index], *of = &surface.all->bodies[surface.index];
    if (of->shape != SHAPE_SURFACE || is_plane(body)) return 0;
    const SurfaceBox *box = &surface.all->boxes[of->first_node];
    int64_t rows = body.all->corner_count, step = own->shape == SHAPE_SURFACE ? 3 : 1;
    int64_t count = is_compound(body) ? own->corner_count : 1;
    for (int64_t c = 0; c < count; c += step) {
        const double *corner = body.all->corners + own->first_corner + c;
        double point[3], world[3], local[3];
        int outside = 0;
        if (own->shape == SHAPE_SURFACE && !((int64_t)corner[3 * rows] & FACE_FIRST)) continue;
        if (is_compound(body)) {
            for (int i = 0; i < 3; i++) point[i] = corner[i * rows];
        } else {
            farthest_point(body.all, body.index, (Direction){0.0, 0.0, 1.0}, point);
        }
        turn_from(body.placed, point, world);
        for (int i = 0; i < 3; i++) world[i] += body.placed->origin[i] - surface.placed->origin[i];
        turn_into(surface.placed, world, local);
        for (int i = 0; i < 3; i++) outside |= fabs(local[i] - box->center[i]) > box->half[i];
        if (!outside && surrounds(surface.all, of, local)) return 1;
    }
    return 0;
}
