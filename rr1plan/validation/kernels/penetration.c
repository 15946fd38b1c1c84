// Penetration depth of two convex bodies: the smallest overlap along any direction.
//
// A polytope inside the difference a - b grows (expanding polytope algorithm): in each step it gets the farthest point
// along the normal of its face nearest to the origin, until that point lies on the face. Offsets of faces are signed,
// so the polytope need not contain the origin at first. The overlap along any direction is an upper bound of the depth,
// whatever the polytope is.
//
// van den Bergen (2001), Proximity queries and penetration depth computation on 3D game objects, Game Developers
// Conference.

enum { POLYTOPE_CORNERS = 96, POLYTOPE_FACES = 2 * POLYTOPE_CORNERS };
// Tolerance of the depth [m], and relative to it.
#define DEPTH_TOLERANCE 1e-8
#define DEPTH_SHARE 1e-6

typedef struct {
    int corner[3];  // counter-clockwise from outside
    Direction normal;
    double offset;  // of its plane from the origin [m]; INFINITY where it has no area
} PolytopeFace;

typedef struct {
    BodyView a, b;
    Direction corners[POLYTOPE_CORNERS];
    PolytopeFace faces[POLYTOPE_FACES];
    int edges[3 * POLYTOPE_FACES][2];
    int corner_count, face_count;
    Direction inside;
    double depth;  // smallest overlap found [m]
} Polytope;

static inline Direction minus(Direction a, Direction b) { return (Direction){a.x - b.x, a.y - b.y, a.z - b.z}; }

// The farthest point of the difference of the bodies along a unit direction; updates the smallest overlap.
static Direction farthest_difference(Polytope *p, Direction d) {
    PointPair pair;
    add_point(p->a, p->b, d, &pair);
    Direction at = position_of(&pair);
    p->depth = lesser(p->depth, dot_product(at, d));
    return at;
}

static void add_face(Polytope *p, int i, int j, int k) {
    Direction at = p->corners[i], one = minus(p->corners[j], at), two = minus(p->corners[k], at);
    Direction n = cross_product(one, two);
    double length = sqrt(dot_product(n, n));
    PolytopeFace *face = &p->faces[p->face_count++];
    if (dot_product(n, minus(at, p->inside)) < 0.0) {
        length = -length;
        int other = j;
        j = k;
        k = other;
    }
    *face = (PolytopeFace){{i, j, k}, {0.0, 0.0, 0.0}, INFINITY};
    if (!(length * length > 1e-28 * dot_product(one, one) * dot_product(two, two))) return;
    face->normal = (Direction){n.x / length, n.y / length, n.z / length};
    face->offset = dot_product(face->normal, at);
}

// Add the point farthest from the first corner, along a direction or against it, as a corner. Returns its distance [m].
static double add_farthest(Polytope *p, int corner, Direction normal) {
    double length = sqrt(dot_product(normal, normal)), far = 0.0;
    if (!(length > 0.0)) return 0.0;
    for (int side = -1; side < 2; side += 2) {
        double scale = side / length;
        Direction d = {scale * normal.x, scale * normal.y, scale * normal.z}, at = farthest_difference(p, d);
        double away = dot_product(minus(at, p->corners[0]), d);
        if (away <= far) continue;
        far = away;
        p->corners[corner] = at;
    }
    return far;
}

// Begin with a tetrahedron of points far from each other. Returns 0 if the difference is flat.
static int begin_polytope(Polytope *p) {
    Direction axes[3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}, *c = p->corners;
    double longest = 0.0;
    p->corner_count = p->face_count = 0;
    p->depth = INFINITY;
    for (int i = 0; i < 3; i++) {
        Direction d = axes[i], high = farthest_difference(p, d);
        Direction low = farthest_difference(p, (Direction){-d.x, -d.y, -d.z}), edge = minus(high, low);
        double square = dot_product(edge, edge);
        if (square <= longest) continue;
        longest = square;
        c[0] = low;
        c[1] = high;
    }
    // The point farthest from the line, along one of two directions across it, then the point farthest from the plane.
    Direction edge = minus(c[1], c[0]), across = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        Direction d = cross_product(edge, axes[i]);
        if (dot_product(d, d) > dot_product(across, across)) across = d;
    }
    double least = 1e-12 * sqrt(longest);
    if (!(add_farthest(p, 2, across) > least) && !(add_farthest(p, 2, cross_product(edge, across)) > least)) return 0;
    if (!(add_farthest(p, 3, cross_product(edge, minus(c[2], c[0]))) > least)) return 0;
    p->inside = (Direction){0.25 * (c[0].x + c[1].x + c[2].x + c[3].x), 0.25 * (c[0].y + c[1].y + c[2].y + c[3].y),
                            0.25 * (c[0].z + c[1].z + c[2].z + c[3].z)};
    p->corner_count = 4;
    add_face(p, 0, 1, 2);
    add_face(p, 0, 1, 3);
    add_face(p, 0, 2, 3);
    add_face(p, 1, 2, 3);
    return 1;
}

// Replace the faces below a new corner by faces between it and their outline. Returns 0 if there is no room.
static int add_corner(Polytope *p, Direction at) {
    int edges = 0, kept = 0, corner = p->corner_count;
    for (int f = 0; f < p->face_count; f++) {
        PolytopeFace face = p->faces[f];
        if (!(dot_product(face.normal, at) > face.offset)) {
            p->faces[kept++] = face;
            continue;
        }
        for (int side = 0; side < 3; side++) {
            int from = face.corner[side], to = face.corner[(side + 1) % 3], e = 0;
            while (e < edges && !(p->edges[e][0] == to && p->edges[e][1] == from)) e++;
            if (e < edges) {
                edges--;
                p->edges[e][0] = p->edges[edges][0];
                p->edges[e][1] = p->edges[edges][1];
            } else {
                p->edges[edges][0] = from;
                p->edges[edges++][1] = to;
            }
        }
    }
    p->face_count = kept;
    if (kept + edges > POLYTOPE_FACES) return 0;
    p->corners[p->corner_count++] = at;
    for (int e = 0; e < edges; e++) add_face(p, p->edges[e][0], p->edges[e][1], corner);
    return 1;
}

// Penetration depth of two bodies in contact, without their rounding radii [m].
static double penetration(BodyView a, BodyView b) {
    Polytope p = {.a = a, .b = b};
    if (!begin_polytope(&p)) return greater(0.0, p.depth);
    while (p.corner_count < POLYTOPE_CORNERS) {
        int nearest = 0;
        for (int f = 1; f < p.face_count; f++)
            if (p.faces[f].offset < p.faces[nearest].offset) nearest = f;
        PolytopeFace face = p.faces[nearest];
        if (!(face.offset < p.depth - greater(DEPTH_TOLERANCE, DEPTH_SHARE * p.depth))) break;
        Direction at = farthest_difference(&p, face.normal);
        if (!(dot_product(at, face.normal) - face.offset > 1e-12) || !add_corner(&p, at) || p.face_count == 0) break;
    }
    return greater(0.0, p.depth);
}
