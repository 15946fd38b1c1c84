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
    RefereeBodies own, triangles;  // with the corners of the body, and of the triangles
    PairView view;
    const RefereeBody *surface;
    double off;       // rounding of the body and distance to keep [m]
    double rounding;  // of coordinates [m]
    double padding;   // distance to keep [m]
    BodyPlane planes[MOST_PLANES];
    int64_t plane_count;  // found so far; the last ones are kept
} SurfacePair;

static void turn_into(const PlacedBody *frame, const double *world, double *local) {
    for (int i = 0; i < 3; i++)
        local[i] = frame->rotation[i] * world[0] + frame->rotation[3 + i] * world[1] + frame->rotation[6 + i] * world[2];
}

static void place_in_surface(PairView v, double padding, SurfacePair *pair) {
    const PlacedBody *body = v.a.placed, *frame = v.b.placed;
    pair->view = v;
    pair->surface = &v.b.all->bodies[v.b.index];
    pair->bodies[0] = v.a.all->bodies[v.a.index];
    pair->sizes[0] = v.a.all->sizes[v.a.index];
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
    pair->own = *v.a.all;
    pair->own.bodies = pair->bodies;
    pair->own.sizes = pair->sizes;
    pair->triangles = *v.b.all;
    pair->triangles.bodies = pair->bodies;
    pair->triangles.sizes = pair->sizes;
    pair->padding = padding;
    pair->off = pair->sizes[0].rounding + pair->padding;
    pair->plane_count = 0;
    pair->rounding = RELATIVE_ROUNDING * (far + pair->sizes[0].radius + radius_of(v.b));
}

static void add_plane(SurfacePair *pair, Direction d) {
    const double *origin = pair->placed[0].origin;
    double edge = body_reach((BodyView){&pair->own, 0, pair->placed}, d) + d.x * origin[0] + d.y * origin[1] + d.z * origin[2];
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
static double beyond_planes(const SurfacePair *pair, int64_t triangle) {
    int64_t count_of_corners = pair->triangles.corner_count;
    const double *x = pair->triangles.corners + pair->surface->first_corner + 3 * triangle;
    const double *y = x + count_of_corners, *z = y + count_of_corners;
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
static Separation triangle_clearance(SurfacePair *pair, int64_t triangle, double base, double enough) {
    int64_t first = pair->surface->first_corner + 3 * triangle, count = pair->triangles.corner_count;
    GjkState state = {.count = 0};
    pair->bodies[1].first_corner = first;
    for (int i = 0; i < 3; i++) {
        const double *row = pair->triangles.corners + i * count + first;
        pair->placed[1].middle[i] = (row[0] + row[1] + row[2]) / 3.0;
    }
    BodyView body = {&pair->own, 0, &pair->placed[0]}, other = {&pair->triangles, 1, &pair->placed[1]};
    Separation found = separate(body, other, &state, base + pair->off, enough + pair->off);
    if (found.lower > 0.0) add_plane(pair, found.direction);
    found.upper -= pair->off;
    found.lower -= pair->off;
    return found;
}

// Lower bound of the clearance of a node's box [m].
static double node_clearance(const SurfacePair *pair, int64_t node) {
    const SurfaceBox *box = &pair->triangles.boxes[pair->surface->first_node + node];
    double around = upright_box_gap(&pair->own, pair->placed, box->center, box->half), total = 0.0;
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
    SurfacePair pair;
    place_in_surface(view_pair(s, k), s->pairs[k].padding, &pair);
    const SurfaceNode *nodes = pair.triangles.nodes + pair.surface->first_node;
    ClearanceBounds bounds = {INFINITY, INFINITY};
    int64_t nearest = remembered_triangle(s, k);
    if (nearest >= 0) {
        Separation found = triangle_clearance(&pair, nearest, base, enough);
        bounds = (ClearanceBounds){found.upper, found.lower};
    }
    for (int64_t i = 0; i < nodes[0].next;) {
        double limit = lesser(enough, bounds.upper), bound = node_clearance(&pair, i);
        if (bound >= limit) {
            bounds.lower = lesser(bounds.lower, bound);
            i = nodes[i].next;
            continue;
        }
        for (int64_t t = nodes[i].first; t < nodes[i].last; t++) {
            limit = lesser(enough, bounds.upper);
            bound = beyond_planes(&pair, t);
            if (bound >= limit) {
                bounds.lower = lesser(bounds.lower, bound);
                continue;
            }
            Separation found = triangle_clearance(&pair, t, base, limit);
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

// Least clearance of the triangle looked at last along a direction of the surface's frame, both bodies at their steady
// velocities [m].
static double steady_triangle_gap(const RefereeSearch *s, const RefereePair *of, const SurfacePair *pair, double half,
                                  Direction local) {
    PairView v = pair->view;
    const double *R = v.b.placed->rotation;
    Direction d = {
        R[0] * local.x + R[1] * local.y + R[2] * local.z,
        R[3] * local.x + R[4] * local.y + R[5] * local.z,
        R[6] * local.x + R[7] * local.y + R[8] * local.z,
    };
    double least = 1e300;
    for (int end = 0; end < 2; end++) {
        double time = end ? half : -half;
        double gap = origin_gap(v.a, v.b, d) - steady_reach(s, v.a, of->last_a, of->before, time, d);
        SteadyTurn turn = steady_turn(s, v.b, of->last_b, of->before, time, (Direction){-d.x, -d.y, -d.z});
        int64_t first = pair->bodies[1].first_corner;
        Direction own = in_frame(v.b.placed, turn.direction);
        gap -= turn.moved + corner_reach(&pair->triangles, (CornerRange){first, first + 3}, own);
        least = lesser(least, gap);
    }
    return least - of->padding;
}

// The clearance of a pair with a surface within `half` of the posed time; see `interval_clearance`.
//
// `approach` is what the distance can shrink, `error` what bodies can move beside their steady velocities.
static IntervalClearance surface_interval(RefereeSearch *s, int64_t k, double time, double half, double approach,
                                          double error) {
    const RefereePair *of = &s->pairs[k];
    SurfacePair pair;
    place_in_surface(view_pair(s, k), of->padding, &pair);
    const SurfaceNode *nodes = pair.triangles.nodes + pair.surface->first_node;
    int64_t known = remembered_triangle(s, k);
    double least = INFINITY, nearest = INFINITY;
    if (known >= 0) add_plane(&pair, (Direction){s->directions[k].x, s->directions[k].y, s->directions[k].z});
    s->search_count++;
    s->chunk_searches++;
    // The triangle that was nearest last comes first: it is the most likely to leave the pair open.
    for (int64_t i = known >= 0 ? -1 : 0; i < nodes[0].next;) {
        SurfaceNode node = {i + 1, known, known + 1};
        double need = needed_clearance(s, of->group);
        if (i >= 0) {
            node = nodes[i];
            double bound = node_clearance(&pair, i) - approach;
            if (bound > need) {
                least = lesser(least, bound);
                i = node.next;
                continue;
            }
        }
        for (int64_t t = node.first; t < node.last; t++) {
            double bound = beyond_planes(&pair, t) - approach;
            if (bound > need) {
                least = lesser(least, bound);
                continue;
            }
            Separation found = triangle_clearance(&pair, t, need, need + approach);
            if (note_clearance(s, k, found.upper, time)) return (IntervalClearance){0.0, 1};
            if (found.upper < nearest) {
                nearest = found.upper;
                remember_triangle(s, k, t, found.direction);
            }
            need = needed_clearance(s, of->group);
            bound = found.lower - pair.rounding - approach;
            if (bound <= need) {
                double steady = steady_triangle_gap(s, of, &pair, half, found.direction) - pair.rounding - error;
                bound = greater(bound, steady);
            }
            least = lesser(least, bound);
            if (bound <= need) return (IntervalClearance){least, 0};
        }
        i++;
    }
    return (IntervalClearance){least, 1};
}

// ---- inside ------------------------------------------------------------------------------------

// Half the solid angle of a triangle, seen from a point (van Oosterom, Strackee 1983, The solid angle of a plane triangle).
static double half_solid_angle(const double *x, const double *y, const double *z, const double p[3]) {
    double d[3][3], length[3];
    for (int c = 0; c < 3; c++) {
        d[c][0] = x[c] - p[0];
        d[c][1] = y[c] - p[1];
        d[c][2] = z[c] - p[2];
        length[c] = sqrt(d[c][0] * d[c][0] + d[c][1] * d[c][1] + d[c][2] * d[c][2]);
    }
    double volume = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) + d[0][1] * (d[1][2] * d[2][0] - d[1][0] * d[2][2]) +
                    d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
    double base = length[0] * length[1] * length[2];
    for (int c = 0; c < 3; c++) {
        const double *one = d[c], *two = d[(c + 1) % 3];
        base += (one[0] * two[0] + one[1] * two[1] + one[2] * two[2]) * length[(c + 2) % 3];
    }
    return atan2(volume, base);
}

// Whether closed parts of a surface wind around a point of a body, where both are placed.
//
// A body that touches the surface at no time of the motion is inside always or never, and so are all of its points.
static int encloses(const RefereeSearch *s, int64_t arm_a, int64_t a, int64_t arm_b, int64_t b) {
    BodyView body = view_of(s, arm_a, a), surface = view_of(s, arm_b, b);
    if (!is_surface(surface) || is_plane(body)) return 0;
    const RefereeBodies *all = surface.all;
    const RefereeBody *of = &all->bodies[b];
    const SurfaceBox *box = &all->boxes[of->first_node];
    double point[3], world[3], local[3];
    farthest_point(body.all, a, (Direction){0.0, 0.0, 1.0}, point);
    const double *R = body.placed->rotation, *o = body.placed->origin;
    for (int i = 0; i < 3; i++)
        world[i] = R[3 * i] * point[0] + R[3 * i + 1] * point[1] + R[3 * i + 2] * point[2] + o[i] - surface.placed->origin[i];
    turn_into(surface.placed, world, local);
    for (int i = 0; i < 3; i++)
        if (fabs(local[i] - box->center[i]) > box->half[i]) return 0;
    const double *x = all->corners + of->first_corner, *y = x + all->corner_count, *z = y + all->corner_count;
    const double *closed = z + all->corner_count;
    double total = 0.0;
    for (int64_t c = 0; c < of->corner_count; c += 3)
        if (closed[c] > 0.0) total += half_solid_angle(x + c, y + c, z + c, local);
    return fabs(total) > 3.0;
}
