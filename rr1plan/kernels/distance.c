// Distance of two bodies at one configuration: a quick lower bound, and exact bounds.
#include "scene_tables.h"

// A body at a pose, and the center of the ball around it.
typedef struct {
    const ExactTables *exact;
    int64_t body;
    const Pose *pose;
    const Vec3 *center;
} PlacedBody;

INLINE PlacedBody placed_body(int64_t body, const ExactTables *exact, const ExactScratch *scratch) {
    return (PlacedBody){exact, body, &scratch->poses[body], &scratch->centers[body]};
}

INLINE const ExactShape *shape_of(PlacedBody placed) { return &placed.exact->shapes[placed.body]; }

INLINE int is_point(PlacedBody placed) { return placed.exact->bodies[placed.body].kind == BODY_POINT; }

INLINE Core core_of(PlacedBody placed) {
    const ExactTables *exact = placed.exact;
    const ExactBody *of = &exact->bodies[placed.body];
    return (Core){of->kind, shape_of(placed)->size, placed.pose, exact->corners, exact->links, of->first_corner};
}

// Distance of two points [m].
INLINE double point_distance(const Vec3 *a, const Vec3 *b) {
    Vec3 d = vec_sub(*a, *b);
    return sqrt_number(vec_dot(d, d));
}

// Distance of a point to the box around a body [m].
static double distance_to_box(const Vec3 *point, PlacedBody placed) {
    const ExactShape *shape = shape_of(placed);
    const double *R = placed.pose->rotation, *o = placed.pose->origin;
    double dx = point->x - o[0], dy = point->y - o[1], dz = point->z - o[2], square = 0.0;
    for (int c = 0; c < 3; c++) {
        double along = R[c] * dx + R[3 + c] * dy + R[6 + c] * dz;
        double out = abs_number(along - shape->box_center[c]) - shape->box_half[c];
        if (out > 0.0) square += out * out;
    }
    return sqrt_number(square);
}

// A lower bound of the distance of two placed bodies from their balls and boxes [m]; it stops at `enough`. Inline,
// because passing both bodies in memory takes longer than the bound.
INLINE double bounding_gap(PlacedBody a, PlacedBody b, double enough) {
    double ra = shape_of(a)->ball_radius, rb = shape_of(b)->ball_radius;
    double gap = point_distance(a.center, b.center) - ra - rb;
    if (gap < enough && !is_point(b)) gap = max_number(gap, distance_to_box(a.center, b) - ra);
    if (gap < enough && !is_point(a)) gap = max_number(gap, distance_to_box(b.center, a) - rb);
    return gap;
}

// Likewise for the bodies of a pair; nothing is known of the distance from a half-space.
static double quick_gap(int64_t a, int64_t b, double enough, const ExactTables *exact, const ExactScratch *scratch) {
    if (exact->bodies[b].kind == BODY_HALF_SPACE) return -INFINITY;
    return bounding_gap(placed_body(a, exact, scratch), placed_body(b, exact, scratch), enough);
}

// Bounds of the distance of two convex bodies [m]; see `fine_gap`.
static GapBounds convex_gap(PlacedBody a, PlacedBody b, double least, double enough, Vec3 *direction) {
    if (direction->x == 0.0 && direction->y == 0.0 && direction->z == 0.0) {
        *direction = vec_sub(*a.center, *b.center);
        if (direction->x == 0.0 && direction->y == 0.0 && direction->z == 0.0) direction->z = 1.0;
    }
    double radius = shape_of(a)->radius + shape_of(b)->radius;
    Core one = core_of(a), two = core_of(b);
    GapBounds gap = core_gap(&one, &two, least + radius, enough + radius, direction);
    return (GapBounds){gap.lower - radius, gap.upper - radius};
}

// Exact distance of a body's core to the plane of half-space b [m].
static double half_space_gap(int64_t a, int64_t b, const ExactTables *exact, const ExactScratch *scratch) {
    const double *R = scratch->poses[b].rotation, *o = scratch->poses[b].origin, *normal = exact->shapes[b].size;
    Vec3 n = {
        R[0] * normal[0] + R[1] * normal[1] + R[2] * normal[2],
        R[3] * normal[0] + R[4] * normal[1] + R[5] * normal[2],
        R[6] * normal[0] + R[7] * normal[1] + R[8] * normal[2],
    };
    Core core = core_of(placed_body(a, exact, scratch));
    Vec3 p = farthest_point(&core, (Vec3){-n.x, -n.y, -n.z});
    return n.x * (p.x - o[0]) + n.y * (p.y - o[1]) + n.z * (p.z - o[2]) - exact->shapes[b].offset;
}

// Bounds of the distance of a body to the occupied cells of cloud b [m].
static GapBounds cells_gap(int64_t a, int64_t b, double least, double enough, Vec3 *direction,
                           const ExactTables *exact, const ExactScratch *scratch) {
    const Pose *pose = &scratch->poses[b];
    const double *R = pose->rotation, *o = pose->origin;
    const Vec3 *center = &scratch->centers[a];
    double half = exact->shapes[b].size[0], radius = exact->shapes[a].radius;
    double dx = center->x - o[0], dy = center->y - o[1], dz = center->z - o[2];
    double lx = R[0] * dx + R[3] * dy + R[6] * dz;
    double ly = R[1] * dx + R[4] * dy + R[7] * dz;
    double lz = R[2] * dx + R[5] * dy + R[8] * dz;
    double near = enough + exact->shapes[a].ball_radius;
    Pose cell = *pose;
    GapBounds gap = {__builtin_inf(), __builtin_inf()};
    for (int64_t i = exact->bodies[b].first_corner; i < exact->bodies[b].last_corner; i++) {
        const Vec3 *middle = &exact->corners[i];
        double ox = max_number(0.0, abs_number(lx - middle->x) - half);
        double oy = max_number(0.0, abs_number(ly - middle->y) - half);
        double oz = max_number(0.0, abs_number(lz - middle->z) - half);
        double square = ox * ox + oy * oy + oz * oz;
        if (near >= 0.0 && square >= near * near) continue;
        for (int r = 0; r < 3; r++)
            cell.origin[r] = o[r] + R[3 * r] * middle->x + R[3 * r + 1] * middle->y + R[3 * r + 2] * middle->z;
        *direction =
            (Vec3){center->x - cell.origin[0], center->y - cell.origin[1], center->z - cell.origin[2]};
        Core core = core_of(placed_body(a, exact, scratch));
        Core box = {BODY_BOX, exact->shapes[b].size, &cell, exact->corners, exact->links, 0};
        GapBounds found = core_gap(&core, &box, least + radius, enough + radius, direction);
        gap.lower = min_number(gap.lower, found.lower - radius);
        gap.upper = min_number(gap.upper, found.upper - radius);
        // If `least` equals `enough`, the distance itself is required: another cell may be nearer.
        if (least < enough && gap.upper <= least) return gap;
    }
    return gap;
}

// Bounds of the distance of a body to mesh b [m], -inf inside.
//
// A body that does not touch the surface is inside with all of its points or with none.
static GapBounds mesh_body_gap(int64_t a, int64_t b, double least, double enough, const ExactTables *exact,
                               const ExactScratch *scratch) {
    const ExactShape *shape = &exact->shapes[a];
    const double *A = scratch->poses[a].rotation, *o = scratch->poses[a].origin, *middle = shape->box_center;
    const Vec3 *ball = &scratch->centers[a];
    Pose frame = scratch->poses[b];
    const double *R = frame.rotation, *shift = exact->shapes[b].box_center;
    BodyBounds bounds = {.radius = shape->ball_radius};
    double box[3], point[3];
    for (int r = 0; r < 3; r++) {
        frame.origin[r] += R[3 * r] * shift[0] + R[3 * r + 1] * shift[1] + R[3 * r + 2] * shift[2];
        box[r] = A[3 * r] * middle[0] + A[3 * r + 1] * middle[1] + A[3 * r + 2] * middle[2] + o[r] - frame.origin[r];
    }
    double dx = ball->x - frame.origin[0], dy = ball->y - frame.origin[1], dz = ball->z - frame.origin[2];
    for (int r = 0; r < 3; r++) {
        double x = R[r], y = R[3 + r], z = R[6 + r];
        bounds.center[r] = x * box[0] + y * box[1] + z * box[2];
        bounds.ball[r] = x * dx + y * dy + z * dz;
        bounds.half[r] = shape->box_half[r];
        for (int k = 0; k < 3; k++) {
            double along = x * A[k] + y * A[3 + k] + z * A[6 + k];
            bounds.rotation[3 * r + k] = along;
            bounds.extent[r] += abs_number(along) * shape->box_half[k];
        }
    }
    Core core = core_of(placed_body(a, exact, scratch));
    int64_t mesh = exact->bodies[b].first_corner;
    GapBounds gap = surface_gap(&core, shape->radius, &bounds, mesh, &frame, least, enough, exact->meshes);
    if (!(gap.lower > 0.0)) return gap;
    Vec3 p = farthest_point(&core, (Vec3){0.0, 0.0, 1.0});
    dx = p.x - frame.origin[0];
    dy = p.y - frame.origin[1];
    dz = p.z - frame.origin[2];
    for (int r = 0; r < 3; r++) point[r] = R[r] * dx + R[3 + r] * dy + R[6 + r] * dz;
    if (mesh_holds(point, mesh, exact->meshes)) return (GapBounds){-__builtin_inf(), -__builtin_inf()};
    return gap;
}

// Bounds of the distance of two bodies [m], b being the half-space, cloud or mesh if there is one.
//
// The search may stop if the distance is proven to be at most `least`, if that is below `enough`, or at least `enough`.
// `direction`: the first one to try, zero if none is known; on return the last one.
static GapBounds fine_gap(int64_t a, int64_t b, double least, double enough, Vec3 *direction,
                          const ExactTables *exact, const ExactScratch *scratch) {
    if (exact->bodies[b].kind == BODY_HALF_SPACE) {
        double gap = half_space_gap(a, b, exact, scratch) - exact->shapes[a].radius;
        return (GapBounds){gap, gap};
    }
    if (exact->bodies[b].kind == BODY_CELLS) return cells_gap(a, b, least, enough, direction, exact, scratch);
    if (exact->bodies[b].kind == BODY_MESH) return mesh_body_gap(a, b, least, enough, exact, scratch);
    return convex_gap(placed_body(a, exact, scratch), placed_body(b, exact, scratch), least, enough, direction);
}
