// Distance of two convex bodies, and a direction that separates them.
//
// The gap between the bodies along any direction is a lower bound of their distance. Proofs rest on this alone, so
// errors of the search below do no harm. Every point of the difference of the bodies gives an upper bound. The search
// ends when the bounds meet.
//
// Gilbert, Johnson, Keerthi (1988), A fast procedure for computing the distance between complex objects in
// three-dimensional space, IEEE J. Robotics and Automation 4.
#include "referee_tables.h"
#include "referee_simd.h"

// Bodies nearer than this touch [m].
#define CONTACT_DISTANCE 1e-8
enum { GJK_ROUNDS = 64 };

typedef struct {
    double x, y, z;
} Direction;

// A body at a pose.
typedef struct {
    const RefereeBodies *all;
    int64_t index;  // of `all`
    const PlacedBody *placed;
} BodyView;

// The same direction in the frame of a body.
static inline Direction in_frame(const PlacedBody *placed, Direction d) {
    const double *r = placed->rotation;
    return (Direction){
        r[0] * d.x + r[3] * d.y + r[6] * d.z,
        r[1] * d.x + r[4] * d.y + r[7] * d.z,
        r[2] * d.x + r[5] * d.y + r[8] * d.z,
    };
}

// The row or column of a face that contains a coordinate in [-1, 1]; valid even for NaN.
static inline int64_t face_step(double coordinate) {
    double step = (coordinate + 1.0) * (0.5 * SUPPORT_SIDE);
    return step < SUPPORT_SIDE ? (int64_t)step : SUPPORT_SIDE - 1;
}

// The cell of directions that contains a direction of any length.
static int64_t support_cell(Direction d) {
    double a = fabs(d.x), b = fabs(d.y), c = fabs(d.z), size, x, y;
    int64_t face;
    if (a >= b && a >= c) {
        face = d.x >= 0.0 ? 0 : 1;
        size = a;
        x = d.y;
        y = d.z;
    } else if (b >= c) {
        face = d.y >= 0.0 ? 2 : 3;
        size = b;
        x = d.x;
        y = d.z;
    } else {
        face = d.z >= 0.0 ? 4 : 5;
        size = c;
        x = d.x;
        y = d.y;
    }
    if (!(size > 0.0)) return 0;
    return (face * SUPPORT_SIDE + face_step(x / size)) * SUPPORT_SIDE + face_step(y / size);
}

typedef struct {
    int64_t first, stop;
} CornerRange;

// The range of corners that contains the farthest one along a direction in the body's frame.
static CornerRange corners_along(const RefereeBodies *all, int64_t b, Direction d) {
    const RefereeBody *body = &all->bodies[b];
    int64_t first = body->first_corner;
    if (body->shape != SHAPE_TABLE) return (CornerRange){first, first + body->corner_count};
    const double *starts = all->corners + 3 * all->corner_count + first + support_cell(d);
    return (CornerRange){first + (int64_t)starts[0], first + (int64_t)starts[1]};
}

// Largest d . p over some corners.
static double corner_reach(const RefereeBodies *all, CornerRange range, Direction d) {
    const double *x = all->corners, *y = x + all->corner_count, *z = y + all->corner_count;
    double best = -1e300;
    int64_t i = range.first;
    if (range.stop - i >= 8) {
        eight most = {best, best, best, best, best, best, best, best};
        for (; i + 8 <= range.stop; i += 8) {
            eight value = d.x * *(const eight_anywhere *)(x + i) + d.y * *(const eight_anywhere *)(y + i) +
                          d.z * *(const eight_anywhere *)(z + i);
            eight_integers more = value > most;
            most = (eight)((more & (eight_integers)value) | (~more & (eight_integers)most));
        }
        for (int lane = 0; lane < 8; lane++) best = greater(best, most[lane]);
    }
    for (; i < range.stop; i++) best = greater(best, d.x * x[i] + d.y * y[i] + d.z * z[i]);
    return best;
}

// Largest d . p over the points p of a body, relative to its frame's origin, for a world direction d of any length.
static double body_reach(BodyView view, Direction d) {
    const RefereeBodies *all = view.all;
    const BodySizes *size = &all->sizes[view.index];
    Direction own = in_frame(view.placed, d);
    int64_t shape = all->bodies[view.index].shape;
    double best;
    if (shape == SHAPE_BOX) {
        best = fabs(own.x) * size->half[0] + fabs(own.y) * size->half[1] + fabs(own.z) * size->half[2];
    } else if (shape == SHAPE_CYLINDER) {
        best = size->half[0] * sqrt(own.x * own.x + own.y * own.y) + size->half[2] * fabs(own.z);
    } else {
        best = corner_reach(all, corners_along(all, view.index, own), own);
        if (shape == SHAPE_CELLS) best += size->half[0] * (fabs(own.x) + fabs(own.y) + fabs(own.z));
    }
    if (size->rounding > 0.0) best += size->rounding * sqrt(own.x * own.x + own.y * own.y + own.z * own.z);
    return best;
}

// The farthest point of a body along a direction, without its rounding radius; both in the body's frame.
static void farthest_point(const RefereeBodies *all, int64_t b, Direction d, double point[3]) {
    const BodySizes *size = &all->sizes[b];
    int64_t shape = all->bodies[b].shape;
    if (shape == SHAPE_BOX || shape == SHAPE_CYLINDER) {
        point[2] = d.z >= 0.0 ? size->half[2] : -size->half[2];
        double across = sqrt(d.x * d.x + d.y * d.y);
        if (shape == SHAPE_BOX) {
            point[0] = d.x >= 0.0 ? size->half[0] : -size->half[0];
            point[1] = d.y >= 0.0 ? size->half[1] : -size->half[1];
        } else if (across <= 1e-300) {
            point[0] = size->half[0];
            point[1] = 0.0;
        } else {
            point[0] = size->half[0] * d.x / across;
            point[1] = size->half[0] * d.y / across;
        }
        return;
    }
    const double *x = all->corners, *y = x + all->corner_count, *z = y + all->corner_count;
    CornerRange range = corners_along(all, b, d);
    double best = -1e300;
    int64_t at = range.first;
    for (int64_t i = range.first; i < range.stop; i++) {
        double value = d.x * x[i] + d.y * y[i] + d.z * z[i];
        if (value > best) {
            best = value;
            at = i;
        }
    }
    point[0] = x[at];
    point[1] = y[at];
    point[2] = z[at];
}

// World coordinates of the point of a minus the point of b.
static void set_difference(const PlacedBody *a, const PlacedBody *b, PointPair *pair) {
    for (int i = 0; i < 3; i++)
        pair->difference[i] = (a->origin[i] - b->origin[i]) + a->rotation[3 * i] * pair->in_a[0] +
                              a->rotation[3 * i + 1] * pair->in_a[1] + a->rotation[3 * i + 2] * pair->in_a[2] -
                              b->rotation[3 * i] * pair->in_b[0] - b->rotation[3 * i + 1] * pair->in_b[1] -
                              b->rotation[3 * i + 2] * pair->in_b[2];
}

// The points of a and b that are farthest along d and -d.
static void add_point(BodyView a, BodyView b, Direction d, PointPair *pair) {
    Direction in_a = in_frame(a.placed, d), in_b = in_frame(b.placed, (Direction){-d.x, -d.y, -d.z});
    farthest_point(a.all, a.index, in_a, pair->in_a);
    farthest_point(b.all, b.index, in_b, pair->in_b);
    set_difference(a.placed, b.placed, pair);
}

// Barycentric coordinates of the point of a simplex that is nearest to the origin.
typedef struct {
    double of[4];
} Shares;

static inline Direction edge_between(const PointPair *from, const PointPair *to) {
    return (Direction){to->difference[0] - from->difference[0], to->difference[1] - from->difference[1],
                       to->difference[2] - from->difference[2]};
}

static inline Direction position_of(const PointPair *p) {
    return (Direction){p->difference[0], p->difference[1], p->difference[2]};
}

static inline double dot_product(Direction a, Direction b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Direction cross_product(Direction a, Direction b) {
    return (Direction){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// The point of a simplex with these barycentric coordinates.
static Direction shared_point(const PointPair *p, int64_t count, const Shares *shares) {
    Direction sum = {0.0, 0.0, 0.0};
    for (int64_t i = 0; i < count; i++) {
        sum.x += shares->of[i] * p[i].difference[0];
        sum.y += shares->of[i] * p[i].difference[1];
        sum.z += shares->of[i] * p[i].difference[2];
    }
    return sum;
}

// The point on a segment that is nearest to the origin. Returns its squared distance.
//
// Here and below, all is computed from edges, which are short where bodies are near each other, rather than from
// products of positions, which cancel.
static double nearest_on_segment(const PointPair *p, int i, int j, Shares *shares) {
    Direction from = position_of(&p[i]), edge = edge_between(&p[i], &p[j]);
    double square = dot_product(edge, edge), t = square > 0.0 ? -dot_product(from, edge) / square : 0.0;
    t = lesser(greater(t, 0.0), 1.0);
    *shares = (Shares){{0.0, 0.0, 0.0, 0.0}};
    shares->of[i] = 1.0 - t;
    shares->of[j] = t;
    Direction at = {from.x + t * edge.x, from.y + t * edge.y, from.z + t * edge.z};
    return dot_product(at, at);
}

// Likewise for a triangle: the point is inside it, or on its nearest side.
static double nearest_on_triangle(const PointPair *p, int i, int j, int k, Shares *shares) {
    Direction from = position_of(&p[i]), one = edge_between(&p[i], &p[j]), two = edge_between(&p[i], &p[k]);
    Direction normal = cross_product(one, two);
    double square = dot_product(normal, normal);
    if (square > 1e-28 * dot_product(one, one) * dot_product(two, two)) {
        // Barycentric coordinates of the foot of the perpendicular from the origin.
        double s = -dot_product(normal, cross_product(from, two)) / square;
        double t = -dot_product(normal, cross_product(one, from)) / square;
        if (s >= 0.0 && t >= 0.0 && s + t <= 1.0) {
            *shares = (Shares){{0.0, 0.0, 0.0, 0.0}};
            shares->of[i] = 1.0 - s - t;
            shares->of[j] = s;
            shares->of[k] = t;
            double height = dot_product(normal, from);
            return height * height / square;
        }
    }
    double least = nearest_on_segment(p, i, j, shares);
    int ends[2][2] = {{i, k}, {j, k}};
    for (int side = 0; side < 2; side++) {
        Shares other;
        double nearer = nearest_on_segment(p, ends[side][0], ends[side][1], &other);
        if (nearer < least) {
            least = nearer;
            *shares = other;
        }
    }
    return least;
}

// Six times the signed volume of the tetrahedron of the origin and a triangle.
static inline double volume_below(const PointPair *p, int i, int j, int k) {
    return dot_product(position_of(&p[i]), cross_product(edge_between(&p[i], &p[j]), edge_between(&p[i], &p[k])));
}

// Whether a tetrahedron contains the origin, by the origin's barycentric coordinates.
//
// In a thin tetrahedron these have few digits, so the point that they represent has to be near the origin.
static int holds_origin(const PointPair *p, Shares *shares) {
    *shares = (Shares){{volume_below(p, 1, 2, 3), -volume_below(p, 0, 2, 3), volume_below(p, 0, 1, 3),
                        -volume_below(p, 0, 1, 2)}};
    double sum = 0.0;
    for (int i = 0; i < 4; i++) sum += shares->of[i];
    if (sum == 0.0) return 0;
    for (int i = 0; i < 4; i++) {
        shares->of[i] /= sum;
        if (!(shares->of[i] > 0.0)) return 0;
    }
    Direction at = shared_point(p, 4, shares);
    return dot_product(at, at) <= CONTACT_DISTANCE * CONTACT_DISTANCE;
}

// The point of the hull of some points that is nearest to the origin. Returns whether the hull contains the origin.
//
// The last of four points is beyond the triangle of the others, so the nearest point is not on that triangle.
static int nearest_on_simplex(const PointPair *p, int64_t count, Shares *shares) {
    static const int sides[3][3] = {{0, 1, 3}, {0, 2, 3}, {1, 2, 3}};
    *shares = (Shares){{1.0, 0.0, 0.0, 0.0}};
    if (count == 2) nearest_on_segment(p, 0, 1, shares);
    if (count == 3) nearest_on_triangle(p, 0, 1, 2, shares);
    if (count < 4) return 0;
    if (holds_origin(p, shares)) return 1;
    double least = 1e300;
    for (int side = 0; side < 3; side++) {
        Shares other;
        double square = nearest_on_triangle(p, sides[side][0], sides[side][1], sides[side][2], &other);
        if (square < least) {
            least = square;
            *shares = other;
        }
    }
    return 0;
}

// The unit normal of a triangle toward the origin; `toward` is an estimate that may suffer from cancellation.
static Direction inward_normal(const PointPair *p, Direction toward) {
    Direction n = cross_product(edge_between(&p[0], &p[1]), edge_between(&p[0], &p[2]));
    double length = sqrt(dot_product(n, n));
    if (!(length > 0.0)) return toward;
    if (dot_product(n, toward) < 0.0) length = -length;
    return (Direction){n.x / length, n.y / length, n.z / length};
}

// Keep the points with positive coordinates. Returns their number.
static int64_t drop_points(PointPair *p, int64_t count, Shares *shares) {
    int64_t kept = 0;
    for (int64_t i = 0; i < count; i++) {
        if (!(shares->of[i] > 0.0)) continue;
        shares->of[kept] = shares->of[i];
        p[kept++] = p[i];
    }
    return kept;
}

static int is_known(const PointPair *p, int64_t count) {
    for (int64_t i = 0; i < count; i++) {
        const double *one = p[i].difference, *two = p[count].difference;
        if (one[0] == two[0] && one[1] == two[1] && one[2] == two[2]) return 1;
    }
    return 0;
}

// Bounds of the distance of two bodies without their rounding radii [m], and the direction that proves the lower bound,
// which is -1e300 if the bodies touch.
typedef struct {
    double upper, lower;
    Direction direction;
} Separation;

// Search for the direction from a to b with the largest gap.
//
// The bounds may differ by a quarter of the upper bound's distance from `base`; the search ends when the lower bound
// reaches `enough`. It starts from the points in `state`, and stores its last ones there.
static Separation separate(BodyView a, BodyView b, GjkState *state, double base, double enough) {
    PointPair *p = state->points;
    int64_t n = state->count;
    for (int64_t i = 0; i < n; i++) set_difference(a.placed, b.placed, &p[i]);
    if (n == 0) {
        const double *one = a.placed->middle, *two = b.placed->middle;
        add_point(a, b, (Direction){two[0] - one[0], two[1] - one[1], two[2] - one[2]}, &p[0]);
        n = 1;
    }
    Separation best = {1e300, -1e300, {0.0, 0.0, 1.0}};
    for (int round = 0; round < GJK_ROUNDS; round++) {
        Shares shares;
        int inside = nearest_on_simplex(p, n, &shares);
        n = drop_points(p, n, &shares);
        Direction at = shared_point(p, n, &shares);
        double length = sqrt(dot_product(at, at));
        if (inside || !(length > CONTACT_DISTANCE)) {
            state->count = 0;
            return (Separation){0.0, -1e300, best.direction};
        }
        best.upper = lesser(best.upper, length);
        Direction d = {-at.x / length, -at.y / length, -at.z / length};
        if (n == 3) d = inward_normal(p, d);
        add_point(a, b, d, &p[n]);
        const double *w = p[n].difference;
        double gap = -(d.x * w[0] + d.y * w[1] + d.z * w[2]);
        if (gap > best.lower) {
            best.lower = gap;
            best.direction = d;
        }
        if (best.upper - best.lower <= greater(1e-10, 0.25 * (best.upper - base)) || best.lower >= enough ||
            is_known(p, n))
            break;
        n++;
    }
    state->count = n < 3 ? n : 3;
    return best;
}
