// A proven gap between two convex bodies at one configuration.
//
// Any direction n proves a gap: the smallest value of n over one body minus the largest over the other never exceeds
// the distance. The iteration of Gilbert, Johnson and Keerthi (1988) searches for the best n. Because the gap is
// measured rather than inferred, rounding errors or an early end can only lower the bound.
#include "scene_tables.h"

#define GJK_ITERATIONS 48

// The core of a body in world coordinates; `corner` is where a climb along its edges begins.
typedef struct {
    int64_t kind;
    const double *size;
    const Pose *pose;
    const Vec3 *corners;
    const int64_t *links;
    int64_t corner;
} Core;

// Bounds of a distance [m]: a proven lower one, and an upper one from points; it is 0 if the cores overlap.
typedef struct {
    double lower;
    double upper;
} GapBounds;

INLINE Vec3 vec_sub(Vec3 a, Vec3 b) { return (Vec3){a.x - b.x, a.y - b.y, a.z - b.z}; }

INLINE double vec_dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

INLINE Vec3 vec_cross(Vec3 a, Vec3 b) {
    return (Vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// On a convex body, a corner that is farther out than its neighbors is farther out than all corners.
INLINE Vec3 climb(Core *core, Vec3 n) {
    const Vec3 *corners = core->corners;
    int64_t at = core->corner;
    double best = vec_dot(corners[at], n);
    for (int climbs = 1; climbs;) {
        climbs = 0;
        int64_t first = core->links[at], last = core->links[at + 1];
        for (int64_t k = first; k < last; k++) {
            int64_t i = core->links[k];
            double along = vec_dot(corners[i], n);
            if (along > best) {
                best = along;
                at = i;
                climbs = 1;
            }
        }
    }
    core->corner = at;
    return corners[at];
}

// The farthest point of a core along a world direction.
static Vec3 farthest_point(Core *core, Vec3 n) {
    const double *R = core->pose->rotation, *o = core->pose->origin, *size = core->size;
    Vec3 d = {
        R[0] * n.x + R[3] * n.y + R[6] * n.z,
        R[1] * n.x + R[4] * n.y + R[7] * n.z,
        R[2] * n.x + R[5] * n.y + R[8] * n.z,
    };
    Vec3 p = {0.0, 0.0, 0.0};
    if (core->kind == BODY_BOX) {
        p.x = d.x >= 0.0 ? size[0] : -size[0];
        p.y = d.y >= 0.0 ? size[1] : -size[1];
        p.z = d.z >= 0.0 ? size[2] : -size[2];
    } else if (core->kind == BODY_CORNERS) {
        p = climb(core, d);
    } else if (core->kind == BODY_TRIANGLE) {
        const Vec3 *c = core->corners;
        double a = vec_dot(c[0], d), b = vec_dot(c[1], d);
        if (b > a) {
            a = b;
            c++;
        }
        p = vec_dot(core->corners[2], d) > a ? core->corners[2] : *c;
    } else if (core->kind == BODY_SEGMENT) {
        p.z = d.z >= 0.0 ? size[2] : -size[2];
    } else if (core->kind == BODY_CYLINDER) {
        double across = sqrt_number(d.x * d.x + d.y * d.y);
        if (across > 0.0) {
            p.x = size[0] * d.x / across;
            p.y = size[0] * d.y / across;
        }
        p.z = d.z >= 0.0 ? size[2] : -size[2];
    }
    return (Vec3){
        R[0] * p.x + R[1] * p.y + R[2] * p.z + o[0],
        R[3] * p.x + R[4] * p.y + R[5] * p.z + o[1],
        R[6] * p.x + R[7] * p.y + R[8] * p.z + o[2],
    };
}

// The point of a simplex nearest to the origin, and the corners that carry it (bits).
typedef struct {
    int corners;
    Vec3 point;
} NearestOf;

static NearestOf nearest_on_segment(const Vec3 *s, int i, int j) {
    Vec3 a = s[i], d = vec_sub(s[j], a);
    double along = -vec_dot(a, d), square = vec_dot(d, d);
    if (along <= 0.0) return (NearestOf){1 << i, a};
    if (along >= square) return (NearestOf){1 << j, s[j]};
    double u = along / square;
    return (NearestOf){(1 << i) | (1 << j), {a.x + u * d.x, a.y + u * d.y, a.z + u * d.z}};
}

static NearestOf nearest_on_triangle(const Vec3 *s, int i, int j, int k) {
    Vec3 a = s[i], u = vec_sub(s[j], a), v = vec_sub(s[k], a), n = vec_cross(u, v);
    double square = vec_dot(n, n);
    if (square > 0.0) {
        // Barycentric coordinates of the origin's projection, times square.
        double bj = -vec_dot(vec_cross(a, v), n), bk = -vec_dot(vec_cross(u, a), n);
        if (bj >= 0.0 && bk >= 0.0 && bj + bk <= square) {
            double height = vec_dot(a, n) / square;
            return (NearestOf){(1 << i) | (1 << j) | (1 << k), {height * n.x, height * n.y, height * n.z}};
        }
    }
    NearestOf nearest = nearest_on_segment(s, i, j);
    double best = vec_dot(nearest.point, nearest.point);
    for (int edge = 0; edge < 2; edge++) {
        NearestOf found = nearest_on_segment(s, edge ? j : i, k);
        double found_square = vec_dot(found.point, found.point);
        if (found_square < best) {
            best = found_square;
            nearest = found;
        }
    }
    return nearest;
}

// All bits are set if the origin is inside.
static NearestOf nearest_on_tetrahedron(const Vec3 *s) {
    static const int faces[4][4] = {{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}};
    NearestOf nearest = {15, {0.0, 0.0, 0.0}};
    double best = __builtin_inf();
    for (int f = 0; f < 4; f++) {
        int i = faces[f][0], j = faces[f][1], k = faces[f][2], other = faces[f][3];
        Vec3 n = vec_cross(vec_sub(s[j], s[i]), vec_sub(s[k], s[i]));
        double origin = -vec_dot(s[i], n), corner = vec_dot(vec_sub(s[other], s[i]), n);
        if (origin * corner <= 0.0) {
            NearestOf found = nearest_on_triangle(s, i, j, k);
            double square = vec_dot(found.point, found.point);
            if (square < best) {
                best = square;
                nearest = found;
            }
        }
    }
    return nearest;
}

// Keep only the corners that carry the point nearest to the origin. Returns their number, 0 if the origin is inside.
static int reduce_simplex(Vec3 *s, int count, Vec3 *point) {
    NearestOf nearest = {1, s[0]};
    if (count == 2) nearest = nearest_on_segment(s, 0, 1);
    if (count == 3) nearest = nearest_on_triangle(s, 0, 1, 2);
    if (count == 4) nearest = nearest_on_tetrahedron(s);
    *point = nearest.point;
    if (nearest.corners == 15) return 0;
    int kept = 0;
    for (int i = 0; i < count; i++)
        if (nearest.corners >> i & 1) s[kept++] = s[i];
    return kept;
}

// Bounds of the distance between two cores [m].
//
// The search ends as soon as the gap is proven to be `enough`, or to lie between `least` and `enough`. `direction`: the
// first one to try, not zero; on return the best one found.
static GapBounds core_gap(Core *a, Core *b, double least, double enough, Vec3 *direction) {
    Vec3 n = *direction, simplex[4];
    GapBounds gap = {-__builtin_inf(), __builtin_inf()};
    int count = 0;
    for (int step = 0; step < GJK_ITERATIONS; step++) {
        double length = sqrt_number(vec_dot(n, n));
        // A shorter vector has no usable direction: the cores touch. [m]
        if (length < 1e-12) return (GapBounds){gap.lower, max_number(gap.lower, 0.0)};
        Vec3 w = farthest_point(a, (Vec3){-n.x, -n.y, -n.z});
        w = vec_sub(w, farthest_point(b, n));
        double found = vec_dot(w, n) / length;
        if (found > gap.lower) {
            gap.lower = found;
            *direction = (Vec3){n.x / length, n.y / length, n.z / length};
            if (gap.lower >= enough || (gap.lower > least && gap.upper < enough)) return gap;
        }
        // The duality gap, between the nearest point so far and the best plane, is within rounding.
        if (count > 0 && length - found <= 1e-10 * length + 1e-13) return gap;
        for (int i = 0; i < count; i++)
            if (simplex[i].x == w.x && simplex[i].y == w.y && simplex[i].z == w.z) return gap;
        simplex[count] = w;
        count = reduce_simplex(simplex, count + 1, &n);
        // A tetrahedron so flat that rounding puts the origin inside does not refute a proven gap.
        if (count == 0) return (GapBounds){gap.lower, gap.lower > 0.0 ? gap.upper : 0.0};
        double nearer = sqrt_number(vec_dot(n, n));
        if (nearer >= gap.upper) return gap;
        gap.upper = nearer;
        if (gap.lower > least && gap.upper < enough) return gap;
    }
    return gap;
}
