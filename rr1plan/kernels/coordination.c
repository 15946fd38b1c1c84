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
            Vec3 *center = &path->group_centers[node * groups + g];
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
    Vec3 *directions;  // for each two bodies, where their last search ended
    uint8_t *blocked;
    int64_t last[2];  // bodies that blocked the last cell: they are likely to block the next one
    const volatile int64_t *stop;  // not 0: stop immediately; any thread may set it
    const int64_t *wanted;         // see rr1_coordinate_paths
    int64_t last_leaf[2];          // for each path the last leaf that is not empty
} Coordination;

INLINE PlacedBody body_in_node(const PlacedPath *path, int64_t node, int64_t body) {
    int64_t at = node * path->exact->body_count + body;
    return (PlacedBody){path->exact, body, &path->poses[at], &path->centers[at]};
}

// Whether two bodies are proven apart in all configurations of two nodes; `quick`: from their balls and boxes only.
static int bodies_are_apart(int64_t a, int64_t b, int64_t i, int64_t j, int quick, Coordination *of) {
    int64_t count = of->one->exact->body_count, other_count = of->two->exact->body_count;
    double padding = of->pairs->padding[i * other_count + j];
    if (padding == -INFINITY) return 1;
    double travel = of->one->travel[a * count + i] + of->two->travel[b * other_count + j];
    double enough = padding + travel * SLACK + ROUNDING;
    PlacedBody one = body_in_node(of->one, a, i), two = body_in_node(of->two, b, j);
    if (bounding_gap(one, two, enough) >= enough) return 1;
    if (quick) return 0;
    // The search may end as soon as the gap is known to be sufficient, or not to be.
    return convex_gap(one, two, -INFINITY, enough, &of->directions[i * other_count + j]).lower >= enough;
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

// Move the pairs of groups whose balls and boxes may touch in two nodes to the front. Returns their number.
static int64_t sort_near_groups(int64_t a, int64_t b, int64_t *open, int64_t count, Coordination *of) {
    const PlacedPath *one = of->one, *two = of->two;
    int64_t near = 0;
    for (int64_t k = 0; k < count; k++) {
        int64_t number = open[k];
        const CrossGroups *pair = &of->pairs->group_pairs[number];
        int64_t at = a * one->group_count + pair->one, to = b * two->group_count + pair->two;
        double enough = of->pairs->max_padding + (one->group_travel[at] + two->group_travel[to]) * SLACK + ROUNDING;
        double gap = point_distance(&one->group_centers[at], &two->group_centers[to]);
        if (gap - one->group_balls[pair->one].radius - two->group_balls[pair->two].radius >= enough) continue;
        if (enough < FINE && groups_are_apart(a, b, pair, 1, of)) continue;
        open[k] = open[near];
        open[near++] = number;
    }
    return near;
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
//
// The first `count` entries of `open` are the pairs of groups to test; their order changes.
static void coordinate(int64_t a, int64_t b, int64_t *open, int64_t count, Coordination *of) {
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
    int64_t left = sort_near_groups(a, b, open, count, of);
    if (left == 0) return;
    if (leaf) {
        for (int64_t k = 0; k < left && !*cell; k++)
            *cell = !groups_are_apart(a, b, &of->pairs->group_pairs[open[k]], 0, of);
        return;
    }
    int halve_one = !is_leaf(one, a) && (is_leaf(two, b) || node_travel(one, a) >= node_travel(two, b));
    for (int64_t k = 0; k < 2; k++)
        coordinate(halve_one ? 2 * a + k : a, halve_one ? b : 2 * b + k, open, left, of);
}

// The coordination diagram of two paths: 1 for each cell that is not proven free, shape (cells of one, cells of two).
//
// directions, open: scratch, shapes (bodies of one, bodies of two) and (group pairs,). stop: if it becomes nonzero, the
// remaining cells are skipped, so that cells that are not blocked prove nothing. wanted: number of needed cells in all
// rows before a row and all columns before a column, shape (cells of one + 1, cells of two + 1); other cells are not
// blocked, which proves nothing. NULL: all cells are needed.
EXPORT void rr1_coordinate_paths(const PlacedPath *one, const PlacedPath *two, const CrossPairs *pairs,
                                 Vec3 *directions, int64_t *open, const int64_t *stop, const int64_t *wanted,
                                 uint8_t *blocked) {
    Coordination of = {one,  two,    pairs, directions, blocked, {0, 0},
                       stop, wanted, {last_leaf(one), last_leaf(two)}};
    for (int64_t k = 0; k < one->exact->body_count * two->exact->body_count; k++)
        directions[k] = (Vec3){0.0, 0.0, 0.0};
    for (int64_t k = 0; k < pairs->group_pair_count; k++) open[k] = k;
    int64_t from[3] = {1, 2 * one->leaf_count, 2 * one->leaf_count + 1};
    int64_t to[3] = {1, 2 * two->leaf_count, 2 * two->leaf_count + 1};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) coordinate(from[i], to[j], open, pairs->group_pair_count, &of);
}
