// How near a convex body comes to the triangles of a surface.
//
// Nodes are looked at in order, each before those below it; one that is too far away is left with all of them. The
// search of `gjk.c` finds the distance to a triangle, and what its direction proves holds for a whole interval. The planes
// that separated the body from the last triangles separate it from most others.

enum { MOST_PLANES = 4 };

// All points of a body are below `edge` along a unit direction [m].
typedef struct {
    Direction normal;
    double edge;
} BodyPlane;

// A body and a triangle of the surface in the frame of the surface.
typedef struct {
    RefereeBody bodies[2];
    BodySizes sizes[2];
    PlacedBody placed[2];
    RefereeBodies all;
    double off;       // rounding of the body and distance to keep [m]
    double rounding;  // of coordinates [m]
    double padding;   // distance to keep [m]
    BodyPlane planes[MOST_PLANES];
    int64_t plane_count;  // found so far; the last ones are kept
} SurfacePair;

static inline int is_surface(const RefereeSearch *s, int64_t b) {
    return s->bodies->bodies[b].shape == SHAPE_SURFACE;
}

static void turn_into(const PlacedBody *frame, const double *world, double *local) {
    for (int i = 0; i < 3; i++)
        local[i] = frame->rotation[i] * world[0] + frame->rotation[3 + i] * world[1] + frame->rotation[6 + i] * world[2];
}

static void place_in_surface(const RefereeSearch *s, int64_t k, SurfacePair *pair) {
    int64_t a = s->pairs[k].a, b = s->pairs[k].b;
    const PlacedBody *body = &s->placed[a], *frame = &s->placed[b];
    pair->bodies[0] = s->bodies->bodies[a];
    pair->sizes[0] = s->bodies->sizes[a];
    pair->bodies[1] = (RefereeBody){.shape = SHAPE_HULL, .corner_count = 3};
    pair->sizes[1] = (BodySizes){.rounding = 0.0};
    pair->placed[1] = (PlacedBody){.rotation = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}};
    for (int c = 0; c < 3; c++) {
        double column[3] = {body->rotation[c], body->rotation[3 + c], body->rotation[6 + c]}, local[3];
        turn_into(frame, column, local);
        for (int i = 0; i < 3; i++) pair->placed[0].rotation[3 * i + c] = local[i];
    }
    double origin[3], middle[3], far = 0.0;
    for (int i = 0; i < 3; i++) {
        origin[i] = body->origin[i] - frame->origin[i];
        middle[i] = body->middle[i] - frame->origin[i];
        far += fabs(body->origin[i]) + fabs(frame->origin[i]);
    }
    turn_into(frame, origin, pair->placed[0].origin);
    turn_into(frame, middle, pair->placed[0].middle);
    pair->all = (RefereeBodies){.bodies = pair->bodies,
                                .sizes = pair->sizes,
                                .corners = s->bodies->corners,
                                .body_count = 2,
                                .corner_count = s->bodies->corner_count};
    pair->padding = s->padding[k];
    pair->off = pair->sizes[0].rounding + pair->padding;
    pair->plane_count = 0;
    pair->rounding = RELATIVE_ROUNDING * (far + pair->sizes[0].radius + s->bodies->sizes[b].radius);
}

static void add_plane(SurfacePair *pair, Direction d) {
    const double *origin = pair->placed[0].origin;
    double edge = body_reach(&pair->all, pair->placed, 0, d) + d.x * origin[0] + d.y * origin[1] + d.z * origin[2];
    pair->planes[pair->plane_count++ % MOST_PLANES] = (BodyPlane){d, edge};
}

// The number and the direction that are remembered of the nearest triangle: that is where the next search begins.
static void remember_triangle(RefereeSearch *s, int64_t k, int64_t triangle, Direction d) {
    s->directions[k] = (KnownDirection){d.x, d.y, d.z, 1.0 + (double)triangle};
}

static inline int64_t remembered_triangle(const RefereeSearch *s, int64_t k) {
    return (int64_t)s->directions[k].known - 1;
}

// Lower bound of the clearance of a triangle by the planes known [m].
static double beyond_planes(const RefereeSearch *s, const SurfacePair *pair, int64_t first) {
    const double *x = s->bodies->corners + first, *y = x + s->bodies->corner_count, *z = y + s->bodies->corner_count;
    double best = -1e300;
    int64_t count = pair->plane_count < MOST_PLANES ? pair->plane_count : MOST_PLANES;
    for (int64_t i = 0; i < count; i++) {
        const BodyPlane *plane = &pair->planes[i];
        Direction d = plane->normal;
        double least = 1e300;
        for (int c = 0; c < 3; c++) least = lesser(least, d.x * x[c] + d.y * y[c] + d.z * z[c]);
        best = greater(best, least - plane->edge);
    }
    return best - pair->padding - pair->rounding;
}

// Bounds of the clearance of a triangle [m]; see `bound_clearance`.
static Separation triangle_clearance(const RefereeSearch *s, int64_t k, SurfacePair *pair, int64_t triangle,
                                     double base, double enough) {
    int64_t first = s->bodies->bodies[s->pairs[k].b].first_corner + 3 * triangle, count = s->bodies->corner_count;
    GjkState state = {.count = 0};
    pair->bodies[1].first_corner = first;
    for (int i = 0; i < 3; i++) {
        const double *row = s->bodies->corners + i * count + first;
        pair->placed[1].middle[i] = (row[0] + row[1] + row[2]) / 3.0;
    }
    Separation found = separate(&pair->all, pair->placed, 0, 1, &state, base + pair->off, enough + pair->off);
    if (found.lower > 0.0) add_plane(pair, found.direction);
    found.upper -= pair->off;
    found.lower -= pair->off;
    return found;
}

// Lower bound of the clearance of a node's box [m].
static double node_clearance(const RefereeSearch *s, const SurfacePair *pair, int64_t node) {
    const SurfaceBox *box = &s->bodies->boxes[node];
    double around = upright_box_gap(&pair->all, pair->placed, box->center, box->half), total = 0.0;
    for (int i = 0; i < 3; i++) {
        double out = fabs(pair->placed[0].middle[i] - box->center[i]) - box->half[i];
        if (out > 0.0) total += out * out;
    }
    around = greater(around, sqrt(total) - pair->sizes[0].radius);
    int64_t count = pair->plane_count < MOST_PLANES ? pair->plane_count : MOST_PLANES;
    for (int64_t i = 0; i < count; i++) {
        Direction d = pair->planes[i].normal;
        double low = d.x * box->center[0] + d.y * box->center[1] + d.z * box->center[2] -
                     (fabs(d.x) * box->half[0] + fabs(d.y) * box->half[1] + fabs(d.z) * box->half[2]);
        around = greater(around, low - pair->planes[i].edge);
    }
    return around - pair->padding - pair->rounding;
}

// Bounds of the clearance of a pair [m]; see `bound_clearance`. The nearest triangle is remembered.
static ClearanceBounds surface_clearance(RefereeSearch *s, int64_t k, double base, double enough) {
    const RefereeBody *surface = &s->bodies->bodies[s->pairs[k].b];
    SurfacePair pair;
    place_in_surface(s, k, &pair);
    ClearanceBounds bounds = {1e300, 1e300};
    int64_t root = surface->corner_count, nearest = remembered_triangle(s, k);
    if (nearest >= 0) {
        Separation found = triangle_clearance(s, k, &pair, nearest, base, enough);
        bounds = (ClearanceBounds){found.upper, found.lower};
    }
    s->search_count++;
    for (int64_t i = 0; i < s->bodies->nodes[root].next;) {
        const SurfaceNode *node = &s->bodies->nodes[root + i];
        double limit = lesser(enough, bounds.upper), bound = node_clearance(s, &pair, root + i);
        if (bound >= limit) {
            bounds.lower = lesser(bounds.lower, bound);
            i = node->next;
            continue;
        }
        for (int64_t t = node->first; t < node->last; t++) {
            limit = lesser(enough, bounds.upper);
            bound = beyond_planes(s, &pair, surface->first_corner + 3 * t);
            if (bound >= limit) {
                bounds.lower = lesser(bounds.lower, bound);
                continue;
            }
            Separation found = triangle_clearance(s, k, &pair, t, base, limit);
            if (found.upper < bounds.upper) {
                bounds.upper = found.upper;
                remember_triangle(s, k, t, found.direction);
            }
            bounds.lower = lesser(bounds.lower, found.lower);
            if (!(bounds.upper > s->touch)) return bounds;
        }
        i++;
    }
    bounds.lower -= pair.rounding;
    return bounds;
}

// Least clearance of a triangle along a direction of the surface's frame, both bodies at their steady velocities [m].
static double steady_triangle_gap(const RefereeSearch *s, int64_t k, const SurfacePair *pair, double half,
                                  Direction local) {
    const RefereePair *of = &s->pairs[k];
    const PlacedBody *frame = &s->placed[of->b];
    const double *R = frame->rotation;
    Direction d = {
        R[0] * local.x + R[1] * local.y + R[2] * local.z,
        R[3] * local.x + R[4] * local.y + R[5] * local.z,
        R[6] * local.x + R[7] * local.y + R[8] * local.z,
    };
    int64_t before = of->shared > 0 ? s->chains[s->bodies->bodies[of->a].first_joint + of->shared - 1] : -1;
    double least = 1e300;
    for (int end = 0; end < 2; end++) {
        double time = end ? half : -half;
        double gap = origin_gap(s, of->a, of->b, d) - steady_reach(s, of->a, of->last_a, before, time, d);
        Turned turned = steady_turn(s, of->b, of->last_b, before, time, (Direction){-d.x, -d.y, -d.z});
        Direction own = in_frame(frame, turned.direction);
        int64_t first = pair->bodies[1].first_corner;
        gap -= turned.moved + corner_reach(s->bodies, (CornerRange){first, first + 3}, own);
        least = lesser(least, gap);
    }
    return least - s->padding[k];
}

// The clearance of a pair with a surface within `half` of the posed time; see `interval_clearance`.
//
// `approach` is what the distance can shrink, `error` what bodies can move beside their steady velocities.
static IntervalClearance surface_interval(RefereeSearch *s, int64_t k, double time, double half, double approach,
                                          double error) {
    const RefereePair *of = &s->pairs[k];
    SurfacePair pair;
    place_in_surface(s, k, &pair);
    const RefereeBody *surface = &s->bodies->bodies[of->b];
    int64_t root = surface->corner_count, known = remembered_triangle(s, k);
    double least = 1e300, nearest = 1e300;
    if (known >= 0) add_plane(&pair, (Direction){s->directions[k].x, s->directions[k].y, s->directions[k].z});
    s->search_count++;
    // The triangle that was nearest last comes first: it is the most likely to leave the pair open.
    for (int64_t i = known >= 0 ? -1 : 0; i < s->bodies->nodes[root].next;) {
        SurfaceNode node = {i + 1, known, known + 1};
        double need = greater(0.0, s->smallest[of->group] - s->tolerance);
        if (i >= 0) {
            node = s->bodies->nodes[root + i];
            double bound = node_clearance(s, &pair, root + i) - approach;
            if (bound > need) {
                least = lesser(least, bound);
                i = node.next;
                continue;
            }
        }
        for (int64_t t = node.first; t < node.last; t++) {
            double bound = beyond_planes(s, &pair, surface->first_corner + 3 * t) - approach;
            if (bound > need) {
                least = lesser(least, bound);
                continue;
            }
            Separation found = triangle_clearance(s, k, &pair, t, need, need + approach);
            if (note_clearance(s, k, found.upper, time)) return (IntervalClearance){0.0, 1};
            if (found.upper < nearest) {
                nearest = found.upper;
                remember_triangle(s, k, t, found.direction);
            }
            need = greater(0.0, s->smallest[of->group] - s->tolerance);
            bound = found.lower - pair.rounding - approach;
            if (bound <= need) {
                double steady = steady_triangle_gap(s, k, &pair, half, found.direction) - pair.rounding - error;
                bound = greater(bound, steady);
            }
            least = lesser(least, bound);
            if (bound <= need) return (IntervalClearance){least, 0};
        }
        i++;
    }
    return (IntervalClearance){least, 1};
}
