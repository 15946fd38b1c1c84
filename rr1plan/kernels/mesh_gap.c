// Distance of a convex body from the nearest triangle of a mesh, and whether the mesh contains a point.
//
// The nearest boxes of the tree come first. The gaps between two boxes along the axes of either one are the sides of a
// box between them that is free of both, so its diagonal is a lower bound of their distance.
#include "mesh_tables.h"
#include "scene_tables.h"

// Bounds of a body in a mesh's frame.
typedef struct {
    double rotation[9];  // its axes are the columns
    double center[3];    // of the box around it
    double half[3];      // half sizes of that box along its axes
    double extent[3];    // half sizes of the axis-aligned box around that box
    double ball[3];
    double radius;
} BodyBounds;

// Lower bounds of the distance of a body to the children of a node [m].
INLINE f64x8 gaps_to_children(const BodyBounds *body, const MeshNode *node) {
    const double *R = body->rotation;
    f64x8 d[3], half[3], zero = splat(0.0), upright = zero, own = zero, ball = zero;
    for (int k = 0; k < 3; k++) {
        f64x8 low = load_lanes(node->low + LANES * k), high = load_lanes(node->high + LANES * k);
        d[k] = 0.5 * (low + high) - body->center[k];
        half[k] = 0.5 * (high - low);
        f64x8 out = max_lanes(abs_lanes(d[k]) - half[k] - body->extent[k], zero);
        upright = upright + out * out;
        out = max_lanes(max_lanes(low - body->ball[k], body->ball[k] - high), zero);
        ball = ball + out * out;
    }
    for (int k = 0; k < 3; k++) {
        f64x8 along = abs_lanes(R[k] * d[0] + R[3 + k] * d[1] + R[6 + k] * d[2]) - body->half[k];
        along = along - (abs_number(R[k]) * half[0] + abs_number(R[3 + k]) * half[1] + abs_number(R[6 + k]) * half[2]);
        f64x8 out = max_lanes(along, zero);
        own = own + out * out;
    }
    return max_lanes(sqrt_lanes(max_lanes(upright, own)), sqrt_lanes(ball) - body->radius);
}

typedef struct {
    double gap;    // lower bound of the distance [m]
    int64_t item;  // a node, or -1 - a triangle
} MeshEntry;

// Add the children of a node that may be nearer than `limit`, the nearest last. Returns the new number of entries.
INLINE int64_t push_children(const BodyBounds *body, int64_t node, double limit, const MeshTables *meshes,
                             MeshEntry *stack, int64_t count) {
    f64x8 gaps = gaps_to_children(body, &meshes->nodes[node]);
    int64_t first = meshes->children[node], begin = count;
    for (uint64_t near = less_than(gaps, splat(limit)); near; near &= near - 1) {
        int64_t i = first_bit(near), at = count++;
        MeshEntry entry = {gaps[i], first < 0 ? first - i : first + i};
        for (; at > begin && stack[at - 1].gap < entry.gap; at--) stack[at] = stack[at - 1];
        stack[at] = entry;
    }
    return count;
}

// Bounds of the distance of a core with a radius from the surface of a mesh [m], whose surrounding box is at `frame`.
//
// The search may stop if the distance is proven to be at most `least`, or to lie between `least` and `enough`, but not
// if these are equal.
static GapBounds surface_gap(Core *core, double radius, const BodyBounds *body, int64_t mesh, const Pose *frame,
                             double least, double enough, const MeshTables *meshes) {
    const double *R = frame->rotation, *c = body->center;
    GapBounds gap = {__builtin_inf(), __builtin_inf()};
    MeshEntry stack[MESH_STACK] = {{0.0, meshes->ranges[mesh].root}};
    for (int64_t count = 1; count > 0;) {
        MeshEntry entry = stack[--count];
        double limit = min_number(min_number(enough, gap.lower), 0.5 * MESH_NOWHERE);
        if (entry.gap >= limit) continue;
        if (entry.item >= 0) {
            count = push_children(body, entry.item, limit, meshes, stack, count);
            continue;
        }
        const double *t = meshes->triangles[-1 - entry.item].corners;
        Core triangle = {BODY_TRIANGLE, 0, frame, (const Vec3 *)t, 0, 0};
        double x = c[0] - (t[0] + t[3] + t[6]) / 3.0, y = c[1] - (t[1] + t[4] + t[7]) / 3.0;
        double z = c[2] - (t[2] + t[5] + t[8]) / 3.0;
        Vec3 direction = {
            R[0] * x + R[1] * y + R[2] * z,
            R[3] * x + R[4] * y + R[5] * z,
            R[6] * x + R[7] * y + R[8] * z,
        };
        if (direction.x == 0.0 && direction.y == 0.0 && direction.z == 0.0) direction.z = 1.0;
        GapBounds found = core_gap(core, &triangle, least + radius, limit + radius, &direction);
        gap.lower = min_number(gap.lower, found.lower - radius);
        gap.upper = min_number(gap.upper, found.upper - radius);
        if (least < enough && (gap.upper <= least || (gap.lower > least && gap.upper < enough))) break;
    }
    return gap;
}

// ---- interior ------------------------------------------------------------------------------------------------------

// Crossings of closed surfaces by a ray: outward minus inward ones, and whether they are certain.
typedef struct {
    int64_t outwards;
    int certain;
} Crossings;

// Add a triangle to the crossings of the ray from p along an axis; u and v are the other axes.
//
// On which side the ray passes an edge is computed from the edge alone. So of two triangles with a common edge the ray
// crosses one or the other, whatever the rounding: it never slips between them.
INLINE void cross_triangle(const double *t, const double p[3], int axis, Crossings *crossings) {
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    int64_t turn = 0;
    for (int k = 0; k < 3; k++) {
        const double *a = t + 3 * k, *b = t + 3 * ((k + 1) % 3);
        if ((a[v] > p[v]) == (b[v] > p[v])) continue;
        int up = b[v] > p[v];
        const double *low = up ? a : b, *high = up ? b : a;
        double beside = (high[u] - low[u]) * (p[v] - low[v]) - (high[v] - low[v]) * (p[u] - low[u]);
        if (beside > 0.0) turn += up ? 1 : -1;
    }
    if (turn == 0) return;
    // The side of the triangle's plane on which p is: the volume of a tetrahedron, and a bound of its rounding error.
    double d[9], length[3], far = abs_number(p[0]) + abs_number(p[1]) + abs_number(p[2]);
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) d[3 * k + i] = t[3 * k + i] - p[i];
        length[k] = abs_number(d[3 * k]) + abs_number(d[3 * k + 1]) + abs_number(d[3 * k + 2]);
        far = max_number(far, length[k]);
    }
    double volume = d[0] * (d[4] * d[8] - d[5] * d[7]) + d[1] * (d[5] * d[6] - d[3] * d[8]) +
                    d[2] * (d[3] * d[7] - d[4] * d[6]);
    // The products of two edges add up to at most `areas`, each with a few rounding errors. If the sign of the volume
    // is uncertain, the triangle counts if it is entirely ahead of p and does not count if it is entirely behind;
    // otherwise the result is uncertain.
    double areas = length[0] * length[1] + length[1] * length[2] + length[2] * length[0];
    if (abs_number(volume) <= 1e-14 * far * areas) {
        double low = min_number(d[axis], min_number(d[3 + axis], d[6 + axis]));
        double high = max_number(d[axis], max_number(d[3 + axis], d[6 + axis]));
        if (high < 0.0) return;
        if (low <= 0.0) {
            crossings->certain = 0;
            return;
        }
    } else if ((volume > 0.0) != (turn > 0)) {
        return;
    }
    crossings->outwards += turn;
}

// Crossings of a mesh by the ray from p along an axis.
static Crossings cast_ray(const double p[3], int axis, int64_t mesh, const MeshTables *meshes) {
    Crossings crossings = {0, 1};
    int64_t stack[MESH_STACK] = {meshes->ranges[mesh].root};
    for (int64_t count = 1; count > 0 && crossings.certain;) {
        int64_t at = stack[--count], first = meshes->children[at];
        const MeshNode *node = &meshes->nodes[at];
        i64x8 apart = load_lanes(node->high + LANES * axis) < splat(p[axis]);
        for (int k = 1; k < 3; k++) {
            int other = (axis + k) % 3;
            f64x8 x = splat(p[other]);
            apart |= (load_lanes(node->low + LANES * other) > x) | (load_lanes(node->high + LANES * other) < x);
        }
        for (uint64_t near = bits_of(~apart); near; near &= near - 1) {
            int64_t i = first_bit(near);
            if (first >= 0) {
                stack[count++] = first + i;
                continue;
            }
            int64_t triangle = -1 - first + i;
            if (meshes->is_closed[triangle])
                cross_triangle(meshes->triangles[triangle].corners, p, axis, &crossings);
        }
    }
    return crossings;
}

// Returns 1 if a mesh contains a point, in the frame of its box, that is not on its surface.
//
// A point that is within rounding of planes of triangles ahead of it along all three axes counts as inside.
static int mesh_holds(const double p[3], int64_t mesh, const MeshTables *meshes) {
    if (!meshes->ranges[mesh].closed) return 0;
    for (int axis = 0; axis < 3; axis++) {
        Crossings crossings = cast_ray(p, axis, mesh, meshes);
        if (crossings.certain) return crossings.outwards != 0;
    }
    return 1;
}

// The vector from a point to the nearest point of the surface of a mesh, in the frame of its box.
static Vec3 to_surface(const double p[3], int64_t mesh, const MeshTables *meshes) {
    BodyBounds point = {
        .rotation = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, .center = {p[0], p[1], p[2]}, .ball = {p[0], p[1], p[2]}};
    MeshEntry stack[MESH_STACK] = {{0.0, meshes->ranges[mesh].root}};
    double least = 0.5 * MESH_NOWHERE;
    Vec3 nearest = {0.0, 0.0, 0.0};
    for (int64_t count = 1; count > 0;) {
        MeshEntry entry = stack[--count];
        if (entry.gap >= least) continue;
        if (entry.item >= 0) {
            count = push_children(&point, entry.item, least, meshes, stack, count);
            continue;
        }
        const double *t = meshes->triangles[-1 - entry.item].corners;
        Vec3 corners[3];
        for (int k = 0; k < 3; k++) corners[k] = (Vec3){t[3 * k] - p[0], t[3 * k + 1] - p[1], t[3 * k + 2] - p[2]};
        Vec3 found = nearest_on_triangle(corners, 0, 1, 2).point;
        double distance = sqrt_number(vec_dot(found, found));
        if (distance < least) {
            least = distance;
            nearest = found;
        }
    }
    return nearest;
}

// Depths of points inside the first mesh, negative for the distance outside, shape (count,); and the vectors to the
// nearest points of its surface, shape (count, 3) [m]. Points are in the frame of its box, shape (count, 3).
EXPORT void rr1_mesh_depths(const MeshTables *meshes, const double *points, int64_t count, double *depths,
                            double *vectors) {
    for (int64_t i = 0; i < count; i++) {
        Vec3 v = to_surface(points + 3 * i, 0, meshes);
        double distance = sqrt_number(vec_dot(v, v));
        vectors[3 * i] = v.x;
        vectors[3 * i + 1] = v.y;
        vectors[3 * i + 2] = v.z;
        depths[i] = mesh_holds(points + 3 * i, 0, meshes) ? distance : -distance;
    }
}
