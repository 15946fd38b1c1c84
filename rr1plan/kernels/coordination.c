// The certified coordination diagram of two paths (O'Donnell and Lozano-Perez, Deadlock-free and collision-free
// coordination of two robot manipulators, 1989). A cell consists of one interval of each path. It is free only if no
// configuration of one interval touches any configuration of the other.
//
// The certificate is that of certify_curve.c with independent motions: two bodies stay apart if their distance exceeds
// the sum of their largest displacements. Intervals are halved until that is proven, or until they are leaves.
#include "coordination.h"
#include "scene_tables.h"

// Place the bodies of all nodes that are not empty.
//
// q: a configuration of each node; reach: largest change of each column from it; shapes (nodes, nq). stop: if it
// becomes nonzero, the remaining nodes are not placed; any thread may set it.
EXPORT void rr1_place_path(const PlacedPath *path, ExactScratch *scratch, const double *q, const double *reach,
                           const int64_t *stop) {
    const ExactTables *exact = path->exact;
    int64_t bodies = exact->body_count, groups = path->group_count, nq = exact->column_count;
    const volatile int64_t *stopped = stop;
    for (int64_t node = 1; node < 2 * path->leaf_count + 2 && !*stopped; node++) {
        if (path->is_empty[node]) continue;
        place_joints(q + node * nq, exact, scratch);
        for (int64_t b = 0; b < bodies; b++) {
            double travel = 0.0;
            if (moves(&exact->bodies[b])) {
                place_body(b, exact, scratch);
                bound_travel(b, reach + node * nq, exact, scratch);
                travel = scratch->travel[b * scratch->travel_stride];
            }
            path->poses[node * bodies + b] = scratch->poses[b];
            path->centers[node * bodies + b] = scratch->centers[b];
            path->travel[node * bodies + b] = travel;
        }
        for (int64_t g = 0; g < groups; g++) {
            const BodyGroup *group = &path->groups[g];
            const Pose *joint = &scratch->joint_poses[group->joint];
            const double *R = joint->rotation, *c = path->group_balls[g].center;
            ExactPoint *center = &path->group_centers[node * groups + g];
            center->x = R[0] * c[0] + R[1] * c[1] + R[2] * c[2] + joint->origin[0];
            center->y = R[3] * c[0] + R[4] * c[1] + R[5] * c[2] + joint->origin[1];
            center->z = R[6] * c[0] + R[7] * c[1] + R[8] * c[2] + joint->origin[2];
            double most = 0.0;
            for (int64_t b = group->first_body; b < group->last_body; b++)
                most = max_number(most, path->travel[node * bodies + b]);
            path->group_travel[node * groups + g] = most;
        }
    }
}

// If the groups of two nodes move less than this, their bodies are tested one by one [m].
#define FINE 0.03

typedef struct {
    const PlacedPath *one;
    const PlacedPath *two;
    const CrossPairs *pairs;
    ExactPoint *directions;  // for each two bodies, where their last search ended
    uint8_t *blocked;
    int64_t last[2];  // bodies that blocked the last cell: they are likely to block the next one
    int64_t tests;
    const volatile int64_t *stop;  // not 0: stop immediately; any thread may set it
    const int64_t *wanted;         // see rr1_coordinate_paths
    int64_t last_leaf[2];          // for each path the last leaf that is not empty
} Coordination;

INLINE double point_distance(const ExactPoint *a, const ExactPoint *b) {
    double x = a->x - b->x, y = a->y - b->y, z = a->z - b->z;
    return sqrt_number(x * x + y * y + z * z);
}

// Distance of a point to the box around a body at a pose [m].
static double box_distance(const ExactPoint *point, const ExactShape *shape, const Pose *pose) {
    const double *R = pose->rotation, *o = pose->origin;
    double dx = point->x - o[0], dy = point->y - o[1], dz = point->z - o[2], square = 0.0;
    for (int c = 0; c < 3; c++) {
        double along = R[c] * dx + R[3 + c] * dy + R[6 + c] * dz;
        double out = abs_number(along - shape->box_center[c]) - shape->box_half[c];
        if (out > 0.0) square += out * out;
    }
    return sqrt_number(square);
}

INLINE Core placed_core(const ExactTables *exact, int64_t body, const Pose *pose) {
    const ExactBody *of = &exact->bodies[body];
    return (Core){of->kind, exact->shapes[body].size, pose, exact->corners, exact->links, of->first_corner};
}

// Whether two bodies are proven apart in all configurations of two nodes; `quick`: from their balls and boxes only.
static int bodies_are_apart(int64_t a, int64_t b, int64_t i, int64_t j, int quick, Coordination *of) {
    const ExactTables *one = of->one->exact, *two = of->two->exact;
    double padding = of->pairs->padding[i * two->body_count + j];
    if (padding == -__builtin_inf()) return 1;
    int64_t at = a * one->body_count + i, to = b * two->body_count + j;
    double enough = padding + (of->one->travel[at] + of->two->travel[to]) * SLACK + ROUNDING;
    const ExactPoint *center = &of->one->centers[at], *other = &of->two->centers[to];
    const ExactShape *shape = &one->shapes[i], *other_shape = &two->shapes[j];
    if (point_distance(center, other) - shape->ball_radius - other_shape->ball_radius >= enough) return 1;
    const Pose *pose = &of->one->poses[at], *other_pose = &of->two->poses[to];
    if (two->bodies[j].kind != BODY_POINT &&
        box_distance(center, other_shape, other_pose) - shape->ball_radius >= enough)
        return 1;
    if (one->bodies[i].kind != BODY_POINT && box_distance(other, shape, pose) - other_shape->ball_radius >= enough)
        return 1;
    if (quick) return 0;
    of->tests++;
    ExactPoint *direction = &of->directions[i * two->body_count + j];
    if (direction->x == 0.0 && direction->y == 0.0 && direction->z == 0.0) {
        *direction = (ExactPoint){center->x - other->x, center->y - other->y, center->z - other->z};
        if (direction->x == 0.0 && direction->y == 0.0 && direction->z == 0.0) direction->z = 1.0;
    }
    double radius = shape->radius + other_shape->radius;
    Core core = placed_core(one, i, pose), other_core = placed_core(two, j, other_pose);
    // The search may end as soon as the gap is known to be sufficient, or not to be.
    GapBounds gap = core_gap(&core, &other_core, -__builtin_inf(), enough + radius, direction);
    return gap.lower - radius >= enough;
}

// Whether all bodies of two groups are proven apart; stores two bodies that are not.
static int groups_are_apart(int64_t a, int64_t b, const CrossGroups *pair, int quick, Coordination *of) {
    const BodyGroup *one = &of->one->groups[pair->one], *two = &of->two->groups[pair->two];
    for (int64_t i = one->first_body; i < one->last_body; i++)
        for (int64_t j = two->first_body; j < two->last_body; j++)
            if (!bodies_are_apart(a, b, i, j, quick, of)) {
                of->last[0] = quick ? of->last[0] : i;
                of->last[1] = quick ? of->last[1] : j;
                return 0;
            }
    return 1;
}

// Write the pairs of groups that balls and boxes do not prove apart in two nodes to `near`. Returns their number.
static int64_t near_groups(int64_t a, int64_t b, const int64_t *open, int64_t count, int64_t *near, Coordination *of) {
    const PlacedPath *one = of->one, *two = of->two;
    int64_t kept = 0;
    for (int64_t k = 0; k < count; k++) {
        const CrossGroups *pair = &of->pairs->group_pairs[open[k]];
        int64_t at = a * one->group_count + pair->one, to = b * two->group_count + pair->two;
        double enough = of->pairs->max_padding + (one->group_travel[at] + two->group_travel[to]) * SLACK + ROUNDING;
        double gap = point_distance(&one->group_centers[at], &two->group_centers[to]);
        if (gap - one->group_balls[pair->one].radius - two->group_balls[pair->two].radius >= enough) continue;
        if (enough < FINE && groups_are_apart(a, b, pair, 1, of)) continue;
        near[kept++] = open[k];
    }
    return kept;
}

INLINE int is_leaf(const PlacedPath *path, int64_t node) { return node >= path->leaf_count; }

static double node_travel(const PlacedPath *path, int64_t node) {
    double most = 0.0;
    for (int64_t g = 0; g < path->group_count; g++)
        most = max_number(most, path->group_travel[node * path->group_count + g]);
    return most;
}

// First row of the coordination diagram that a node covers, and one past its last row.
static void node_rows(const PlacedPath *path, int64_t node, int64_t last_leaf, int64_t rows[2]) {
    int64_t first = node, last = node;
    while (first < path->leaf_count) {
        first = 2 * first;
        last = 2 * last + 1;
    }
    if (node < path->leaf_count && last > last_leaf) last = last_leaf;
    rows[0] = path->cell[first - path->leaf_count];
    rows[1] = path->cell[last - path->leaf_count] + 1;
}

// Whether any cell of two nodes is needed.
static int is_wanted(int64_t a, int64_t b, const Coordination *of) {
    if (!of->wanted) return 1;
    int64_t rows[2], columns[2], width = of->two->cell_count + 1;
    node_rows(of->one, a, of->last_leaf[0], rows);
    node_rows(of->two, b, of->last_leaf[1], columns);
    const int64_t *low = of->wanted + rows[0] * width, *high = of->wanted + rows[1] * width;
    return high[columns[1]] - high[columns[0]] - low[columns[1]] + low[columns[0]] > 0;
}

static int64_t last_leaf(const PlacedPath *path) {
    int64_t node = 2 * path->leaf_count - 1;
    while (node > path->leaf_count && path->is_empty[node]) node--;
    return node;
}

// Block the cells of two nodes that are not proven free, halving the node in which bodies move farther.
static void coordinate(int64_t a, int64_t b, const int64_t *open, int64_t count, Coordination *of) {
    const PlacedPath *one = of->one, *two = of->two;
    if (*of->stop || one->is_empty[a] || two->is_empty[b] || !is_wanted(a, b, of)) return;
    int leaf = is_leaf(one, a) && is_leaf(two, b);
    uint8_t *cell = 0;
    if (leaf) {
        cell = of->blocked + one->cell[a - one->leaf_count] * two->cell_count + two->cell[b - two->leaf_count];
        if (*cell) return;
        if (!bodies_are_apart(a, b, of->last[0], of->last[1], 0, of)) {
            *cell = 1;
            return;
        }
    }
    int64_t near[count + 1];
    int64_t left = near_groups(a, b, open, count, near, of);
    if (left == 0) return;
    if (leaf) {
        for (int64_t k = 0; k < left && !*cell; k++)
            *cell = !groups_are_apart(a, b, &of->pairs->group_pairs[near[k]], 0, of);
        return;
    }
    int halve_one = !is_leaf(one, a) && (is_leaf(two, b) || node_travel(one, a) >= node_travel(two, b));
    for (int64_t k = 0; k < 2; k++)
        coordinate(halve_one ? 2 * a + k : a, halve_one ? b : 2 * b + k, near, left, of);
}

// The coordination diagram of two paths: 1 for each cell that is not proven free, shape (cells of one, cells of two).
//
// directions: scratch memory, shape (bodies of one, bodies of two). stop: if it becomes nonzero, the remaining cells
// are skipped, so that cells that are not blocked prove nothing. wanted: number of needed cells in all rows before a
// row and all columns before a column, shape (cells of one + 1, cells of two + 1); other cells are not blocked, which
// proves nothing. NULL: all cells are needed. Returns the number of searches for a separating direction.
EXPORT int64_t rr1_coordinate_paths(const PlacedPath *one, const PlacedPath *two, const CrossPairs *pairs,
                                    ExactPoint *directions, const int64_t *stop, const int64_t *wanted,
                                    uint8_t *blocked) {
    Coordination of = {one,    two, pairs, directions, blocked,
                       {0, 0}, 0,   stop,  wanted,     {last_leaf(one), last_leaf(two)}};
    for (int64_t k = 0; k < one->exact->body_count * two->exact->body_count; k++)
        directions[k] = (ExactPoint){0.0, 0.0, 0.0};
    int64_t all[pairs->group_pair_count + 1];
    for (int64_t k = 0; k < pairs->group_pair_count; k++) all[k] = k;
    int64_t from[3] = {1, 2 * one->leaf_count, 2 * one->leaf_count + 1};
    int64_t to[3] = {1, 2 * two->leaf_count, 2 * two->leaf_count + 1};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) coordinate(from[i], to[j], all, pairs->group_pair_count, &of);
    return of.tests;
}
