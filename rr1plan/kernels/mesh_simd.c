// A body against a mesh, in eight configurations: spheres against boxes of the tree, then separating directions for the
// remaining triangles.
//
// A body that never touches the surface on the edge is always inside or always outside: one point at one time decides.
#include "mesh_tables.h"
#include "scene_tables.h"

// Spheres of a body are bits of a word.
#define MOST_MESH_SPHERES 64

// The points of an edge from a to a + e nearest to points p.
INLINE Vec8 nearest_on_edge(Vec8 p, const double a[3], const double e[3]) {
    double square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
    f64x8 along = (p.x - a[0]) * e[0] + (p.y - a[1]) * e[1] + (p.z - a[2]) * e[2];
    f64x8 part = max_lanes(min_lanes(along / max_number(square, 1e-300), splat(1.0)), splat(0.0));
    return (Vec8){a[0] + part * e[0], a[1] + part * e[1], a[2] + part * e[2]};
}

// The points of a triangle nearest to points p; if it is nearly a line, those of its edges.
INLINE Vec8 nearest_in_face(const double *t, Vec8 p, int *is_thin) {
    double e[3], f[3], g[3];
    for (int i = 0; i < 3; i++) {
        e[i] = t[3 + i] - t[i];
        f[i] = t[6 + i] - t[i];
        g[i] = t[6 + i] - t[3 + i];
    }
    Vec8 best = nearest_on_edge(p, t, e), others[2] = {nearest_on_edge(p, t, f), nearest_on_edge(p, t + 3, g)};
    Vec8 d = vec8_sub(p, best);
    f64x8 least = vec8_dot(d, d);
    for (int k = 0; k < 2; k++) {
        d = vec8_sub(p, others[k]);
        f64x8 square = vec8_dot(d, d);
        i64x8 nearer = square < least;
        best = vec8_select(nearer, others[k], best);
        least = select_mask(nearer, square, least);
    }
    double ee = e[0] * e[0] + e[1] * e[1] + e[2] * e[2], ff = f[0] * f[0] + f[1] * f[1] + f[2] * f[2];
    // `det` is ee ff sin^2 of the angle between e and f: below 3e-5 rad the normal is mostly rounding, and the nearest
    // point of the edges is taken.
    double ef = e[0] * f[0] + e[1] * f[1] + e[2] * f[2], det = ee * ff - ef * ef;
    *is_thin = !(det > 1e-9 * ee * ff);
    if (*is_thin) return best;
    d = (Vec8){p.x - t[0], p.y - t[1], p.z - t[2]};
    f64x8 along_e = d.x * e[0] + d.y * e[1] + d.z * e[2], along_f = d.x * f[0] + d.y * f[1] + d.z * f[2];
    f64x8 r = (along_e * ff - along_f * ef) / det, s = (along_f * ee - along_e * ef) / det, zero = splat(0.0);
    i64x8 within = (r >= zero) & (s >= zero) & (r + s <= splat(1.0));
    Vec8 inner = {t[0] + r * e[0] + s * f[0], t[1] + r * e[1] + s * f[1], t[2] + r * e[2] + s * f[2]};
    return vec8_select(within, inner, best);
}

// Square of the distance from points to a child of a node [m^2].
INLINE f64x8 square_to_child(const MeshNode *node, int64_t i, const f64x8 p[3]) {
    f64x8 square = splat(0.0), zero = square;
    for (int k = 0; k < 3; k++) {
        f64x8 out = max_lanes(max_lanes(node->low[LANES * k + i] - p[k], p[k] - node->high[LANES * k + i]), zero);
        square = square + out * out;
    }
    return square;
}

// Planes that separate a body from triangles are kept: most other triangles are beyond the last few.
enum { MESH_PLANES = 3 };

// In each lane, all points no higher than `level` along a direction in the mesh's frame are proven apart from the body.
typedef struct {
    Vec8 normal;
    f64x8 level;
} MeshPlane;

// State of the search of a mesh's tree for a body.
typedef struct {
    GjkQuery query;
    Separation8 found;
    MeshPlane planes[MESH_PLANES];
    int64_t plane_count;  // found so far; the last ones are kept
} MeshSearch;

typedef struct {
    int64_t node;
    uint64_t lanes;    // in which it may be near
    uint64_t spheres;  // that may be near it
} MeshVisit;

// Keep the plane with normal n, in world axes, below a body in its intervals, for all lanes that may need it.
static void add_mesh_plane(MeshSearch *search, Vec8 n, uint64_t lanes, f64x8 h, const ObstacleShape *shape,
                           const SceneTables *scene, const Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    int64_t core = search->query.core;
    const FrameLanes *frame = &scratch->frames[arm->cores[core].frame];
    Support8 low = lowest_of(arm, core, to_frame(frame, n), lanes);
    f64x8 lost = h * h * (0.5 * search->query.acceleration);
    f64x8 height = lowest_within(core, n, low.point, 0, lanes, h, scene, scratch) - lost;
    double needed = search->query.padding + scene->margin + arm->core_shapes[core].radius;
    f64x8 origin = n.x * shape->center[0] + n.y * shape->center[1] + n.z * shape->center[2];
    search->planes[search->plane_count++ % MESH_PLANES] = (MeshPlane){to_obstacle(shape, n), height - needed - origin};
}

// The given lanes in which no plane proves a triangle apart from the body.
INLINE uint64_t lanes_below_planes(const MeshSearch *search, const MeshTriangle *triangle, uint64_t lanes) {
    int64_t count = search->plane_count < MESH_PLANES ? search->plane_count : MESH_PLANES;
    for (int64_t i = 0; i < count && lanes; i++) {
        const MeshPlane *plane = &search->planes[i];
        f64x8 highest = splat(-INFINITY);
        for (int k = 0; k < 3; k++)
            highest = max_lanes(vec8_dot(plane->normal, vec8_splat(triangle->corners + 3 * k)), highest);
        lanes &= less_than(plane->level, highest);
    }
    return lanes;
}

// Likewise for a child of a node.
INLINE uint64_t lanes_below_child(const MeshSearch *search, const MeshNode *node, int64_t child, uint64_t lanes) {
    int64_t count = search->plane_count < MESH_PLANES ? search->plane_count : MESH_PLANES;
    for (int64_t i = 0; i < count && lanes; i++) {
        const MeshPlane *plane = &search->planes[i];
        const f64x8 normal[3] = {plane->normal.x, plane->normal.y, plane->normal.z};
        f64x8 highest = splat(0.0);
        for (int k = 0; k < 3; k++) {
            double low = node->low[LANES * k + child], high = node->high[LANES * k + child];
            highest = highest + max_lanes(normal[k] * low, normal[k] * high);
        }
        lanes &= less_than(plane->level, highest);
    }
    return lanes;
}

// Separate a body from a triangle in the lanes in which some sphere may be near it; adds the result to `found`.
static void meet_triangle(MeshSearch *search, const Candidate *candidate, const MeshTriangle *triangle, uint64_t lanes,
                          uint64_t spheres, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const Body *of = &scene->arm->bodies[candidate->body];
    const ObstacleShape *shape = &scene->obstacles->shapes[candidate->other];
    int64_t first = of->first_sphere + 1;
    uint64_t near = 0;
    double corners[9];
    MeshTriangle8 placed = {corners, {splat(0.0), splat(0.0), splat(0.0)}, 0, {splat(0.0), splat(0.0), splat(0.0)}};
    lanes = lanes_below_planes(search, triangle, lanes);
    if (lanes == 0) return;
    f64x8 least = splat(INFINITY);
    Vec8 apart = placed.begin;
    for (; spheres; spheres &= spheres - 1) {
        int64_t i = first_bit(spheres);
        const MeshSphere *sphere = &scratch->mesh_spheres[i];
        Vec8 p = {sphere->center[0], sphere->center[1], sphere->center[2]};
        int is_thin;
        Vec8 d = vec8_sub(p, nearest_in_face(triangle->corners, p, &is_thin));
        f64x8 square = vec8_dot(d, d);
        near |= is_thin ? lanes : less_than(square, sphere->limit * sphere->limit) & lanes;
        // Begin from the sphere with the smallest squared distance less squared radius.
        f64x8 gap = square - splat(scene->arm->spheres[first + i].radius * scene->arm->spheres[first + i].radius);
        i64x8 nearer = gap < least;
        apart = vec8_select(nearer, d, apart);
        least = select_mask(nearer, gap, least);
    }
    if (near == 0) return;
    const double *R = shape->rotation, *o = shape->center;
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 3; r++) {
            const double *c = triangle->corners + 3 * k;
            corners[3 * k + r] = R[3 * r] * c[0] + R[3 * r + 1] * c[1] + R[3 * r + 2] * c[2] + o[r];
        }
    placed.begin = (Vec8){
        apart.x * R[0] + apart.y * R[1] + apart.z * R[2],
        apart.x * R[3] + apart.y * R[4] + apart.z * R[5],
        apart.x * R[6] + apart.y * R[7] + apart.z * R[8],
    };
    search->query.triangle = &placed;
    Separation8 one = gjk_simd(&search->query, near, h, scene, scratch);
    search->found.open |= one.open;
    search->found.stuck |= one.stuck;
    search->found.touching |= one.touching;
    if (near & ~one.open) add_mesh_plane(search, placed.found, candidate->lanes, h, shape, scene, scratch);
}

// 1 if a mesh contains a point of a body at the middle of the first interval.
static int holds_body(const Candidate *candidate, int64_t mesh, const SceneTables *scene, const Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const ObstacleShape *shape = &scene->obstacles->shapes[candidate->other];
    const FrameLanes *frame = &scratch->frames[arm->cores[candidate->body].frame];
    Vec8 middle = to_world(frame, vec8_splat(arm->core_shapes[candidate->body].middle));
    Vec8 local = to_obstacle(shape, from_center(shape, middle));
    double point[3] = {local.x[0], local.y[0], local.z[0]};
    return mesh_holds(point, mesh, scene->exact->meshes);
}

// Place the spheres of a body in the mesh's frame, and set their limits. Returns lanes and bits of those near its box.
static MeshVisit place_mesh_spheres(const Candidate *candidate, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const Body *of = &scene->arm->bodies[candidate->body];
    const ObstacleShape *shape = &scene->obstacles->shapes[candidate->other];
    double kept = scene->pairs->padding[candidate->pair] + scene->margin;
    MeshVisit visit = {0, 0, 0};
    for (int64_t i = of->first_sphere + 1; i < of->last_sphere; i++) {
        MeshSphere *sphere = &scratch->mesh_spheres[i - of->first_sphere - 1];
        Vec8 p = to_obstacle(shape, from_center(shape, center_of(&scratch->spheres[i])));
        sphere->center[0] = p.x;
        sphere->center[1] = p.y;
        sphere->center[2] = p.z;
        sphere->limit = travel_of(sphere_in(of, i), h, scene, scratch) + (scene->arm->spheres[i].radius + kept);
        f64x8 a = max_lanes(abs_lanes(p.x) - shape->half[0], splat(0.0));
        f64x8 b = max_lanes(abs_lanes(p.y) - shape->half[1], splat(0.0));
        f64x8 c = max_lanes(abs_lanes(p.z) - shape->half[2], splat(0.0));
        uint64_t near = less_than(a * a + b * b + c * c, sphere->limit * sphere->limit) & candidate->lanes;
        if (near) visit.spheres |= (uint64_t)1 << (i - of->first_sphere - 1);
        visit.lanes |= near;
    }
    return visit;
}

// Separate a body from a mesh in the open lanes of the candidate.
static Separation8 separate_mesh(const Candidate *candidate, f64x8 h, const SceneTables *scene, Scratch *scratch) {
    const ArmGeometry *arm = scene->arm;
    const MeshTables *meshes = scene->exact->meshes;
    const Body *of = &arm->bodies[candidate->body];
    int64_t mesh = scene->exact->bodies[scene->exact->pairs[candidate->pair].other].first_corner;
    if (of->last_sphere - of->first_sphere - 1 > MOST_MESH_SPHERES)
        return (Separation8){candidate->lanes, candidate->lanes, 0};
    // A body that is apart from the box around the mesh at some time is outside.
    if (scratch->batches == 1 && candidate->lanes == ALL_LANES && holds_body(candidate, mesh, scene, scratch))
        return (Separation8){candidate->lanes, candidate->lanes, 1};
    MeshSearch search;
    search.query = (GjkQuery){
        .core = candidate->body,
        .other_core = CORE_CLOSED_FORM,
        .obstacle = candidate->other,
        .pair = candidate->pair,
        .sphere = candidate->sphere,
        .other_sphere = candidate->other_sphere,
        .padding = scene->pairs->padding[candidate->pair],
        .acceleration = scratch->accelerations[of->group],
    };
    search.found = (Separation8){0, 0, 0};
    search.plane_count = 0;
    MeshVisit stack[MESH_STACK] = {place_mesh_spheres(candidate, h, scene, scratch)};
    stack[0].node = meshes->ranges[mesh].root;
    for (int64_t count = stack[0].lanes != 0; count > 0;) {
        MeshVisit visit = stack[--count];
        const MeshNode *node = &meshes->nodes[visit.node];
        int64_t first = meshes->children[visit.node];
        for (int64_t i = 0; i < LANES && node->low[i] < MESH_NOWHERE; i++) {
            // In lanes that are open already, no other triangle can prove anything.
            uint64_t lanes = visit.lanes & ~search.found.open;
            if (lanes == 0) break;
            lanes = lanes_below_child(&search, node, i, lanes);
            if (lanes == 0) continue;
            MeshVisit child = {first + i, 0, 0};
            for (uint64_t spheres = visit.spheres; spheres; spheres &= spheres - 1) {
                const MeshSphere *sphere = &scratch->mesh_spheres[first_bit(spheres)];
                uint64_t any = less_than(square_to_child(node, i, sphere->center), sphere->limit * sphere->limit) & lanes;
                child.lanes |= any;
                if (any) child.spheres |= spheres & -spheres;
            }
            if (child.lanes == 0) continue;
            if (first >= 0) {
                stack[count++] = child;
                continue;
            }
            meet_triangle(&search, candidate, &meshes->triangles[-1 - first + i], child.lanes, child.spheres, h, scene,
                          scratch);
            if (search.found.touching) return search.found;
        }
    }
    return search.found;
}
