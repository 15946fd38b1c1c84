// RRT-Connect for any path, or for a path shorter than a bound.
//
// Two trees, one rooted in the start, one in all goals. The smaller one takes a step toward a random configuration; the
// other one then advances toward the new vertex, step by step, until it reaches it or is blocked (Kuffner and LaValle,
// RRT-Connect: an efficient approach to single-query path planning, 2000). A vertex with a blocked edge is extended
// only to samples within its domain: others would lead into the same obstacle again (Yershova et al., Dynamic-domain
// RRTs, 2005).
//
// Continuous joints wrap. When the trees connect, the goal tree is shifted by whole turns to align with the start tree.
//
// Under a bound, a sample also has a cost-to-come. It is joined to the nearest of the vertices
// that reach it within that cost, so samples are drawn from the space of configurations and costs (Hauser and Zhou,
// Asymptotically optimal planning by feasible kinodynamic planning in a state-cost space, 2016; Wilson et al., AORRTC,
// 2025).
//
// Probabilistic completeness: let a path shorter than the bound have clearance d. Cover it by balls with radii and
// distances below d. Let a vertex be in the k-th ball, with a cost at most epsilon above the length of the path up to
// there. Each sample has the same positive probability of falling into the next ball with a cost epsilon above that.
// The nearest vertex that reaches it within its cost is no farther than that vertex, which is closer than d; so the
// edge is free, and the new vertex is reached within its cost. The box of samples grows until it is the whole space, and
// from then on this holds.
//
// The search stops after a given number of samples and can be resumed: its whole state is in `Trees`.
#include "random.h"
#include "trees.h"

// Most consecutive skipped samples: in high-dimensional spaces few samples are near a vertex.
enum { MAX_SKIPPED = 4 };
#define WHOLE_TURN 6.283185307179586
// Longest edge in joints that wrap: less than half a turn, so that its ends determine the direction.
#define MAX_WRAPPED_STEP 3.0
// Samples after which wide ranges are searched within two turns of the roots; then twice as far for twice as many.
enum { FIRST_WIDENING = 1000 };

// Whether an edge of a tree is free, checked in the direction of the path, so that a repeated check agrees.
static int tree_edge_is_free(Trees *trees, int side, const double *from, const double *to, const SceneTables *scene,
                             Scratch *scratch) {
    trees->edges++;
    if (side == GOAL_SIDE) return edge_from_free_is_free(scene, scratch, to, from);
    return edge_from_free_is_free(scene, scratch, from, to);
}

// Whether a sample is too far from a nearest vertex that has a blocked edge.
static int skip_sample(Trees *trees, const Tree *tree, int64_t index, double distance, double domain) {
    int skip = tree->blocked[index] && distance > domain && trees->skipped < MAX_SKIPPED;
    trees->skipped = skip ? trees->skipped + 1 : 0;
    return skip;
}

// Advance from a vertex toward a target in steps of equal length. Returns whether it was reached.
//
// Reached configurations become vertices, except for the target, so the last vertex connects the trees.
static int connect_trees(Trees *trees, int side, int64_t index, double distance, const double *target, double step,
                         double *a, double *b, const SceneTables *scene, Scratch *scratch) {
    int64_t nq = trees->column_count, capacity = trees->capacity;
    Tree *tree = &trees->sides[side];
    if (distance == 0.0 && tree->parents[index] >= 0) {
        // Both trees contain the connecting configuration; it becomes one waypoint.
        tree->connection = tree->parents[index];
        return 1;
    }
    int64_t steps = (int64_t)__builtin_ceil(distance / step);
    if (steps < 1) steps = 1;
    for (int64_t j = 0; j < nq; j++) a[j] = tree->vertices[j * capacity + index];
    for (int64_t k = 1; k <= steps; k++) {
        double fraction = (double)k / (double)steps;
        for (int64_t j = 0; j < nq; j++) {
            double from = tree->vertices[j * capacity + index];
            b[j] = k == steps ? target[j] : from + (target[j] - from) * fraction;
        }
        if (!tree_edge_is_free(trees, side, a, b, scene, scratch)) return 0;
        int64_t parent = k == 1 ? index : tree->size - 1;
        if (k == steps) {
            tree->connection = parent;
            return 1;
        }
        add_vertex(tree, b, nq, capacity, parent, tree->lengths[index] + distance * fraction);
        for (int64_t j = 0; j < nq; j++) a[j] = b[j];
    }
    return 0;
}

// Limit the sampling box in joints with a wide range to a distance from the roots that grows with the samples drawn.
//
// Returns the number of samples after which to call again. A revolute joint has the same poses in each turn, so that
// hardly any path leads far beyond its ends, and a box of hundreds of turns would leave few samples between them.
static int64_t limit_box(const Trees *trees, const TreeQuery *query, double *lower, double *extent) {
    int64_t next = FIRST_WIDENING;
    double margin = WHOLE_TURN;
    for (; next <= trees->samples; next *= 2) margin *= 2.0;
    for (int64_t j = 0; j < trees->column_count; j++) {
        if (query->extent[j] == INFINITY || query->extent[j] <= WIDE_TURNS * WHOLE_TURN) continue;
        double low = query->start[j], high = low;
        for (int64_t k = 0; k < query->goal_count; k++) {
            double goal = query->goals[k * trees->column_count + j];
            low = min_number(low, goal);
            high = max_number(high, goal);
        }
        lower[j] = max_number(query->lower[j], low - margin);
        extent[j] = min_number(query->lower[j] + query->extent[j], high + margin) - lower[j];
    }
    return next;
}

// Largest number of vertices that one sample can add to a tree.
static double most_new_vertices(const double *extent, int64_t nq, double step) {
    double most = 3.0;
    for (int64_t j = 0; j < nq; j++) most += extent[j] / step;
    return most;
}

// Grow both trees until `samples` are drawn in all, or until they connect in a path no longer than the bound.
//
// Trees of size 0 begin with their roots. Returns SEARCH_GOING, SEARCH_SOLVED, or SEARCH_FULL if the arrays have to be
// enlarged.
EXPORT int64_t rr1_grow_trees(Trees *trees, const TreeQuery *query, uint64_t *random, int64_t samples,
                              const SceneTables *scene, Scratch *scratch) {
    int64_t nq = trees->column_count, capacity = trees->capacity;
    double *q = trees->scratch, *a = q + nq, *b = a + nq, *lower = b + nq, *extent = lower + nq, *turns = extent + nq;
    double step = query->step, bound = query->bound, steps_across = 0.0;
    int64_t next_widening = 0;
    for (int64_t j = 0; j < nq; j++) {
        int wraps = query->extent[j] == INFINITY;
        lower[j] = wraps ? -0.5 * WHOLE_TURN : query->lower[j];
        extent[j] = wraps ? WHOLE_TURN : query->extent[j];
        turns[j] = wraps ? WHOLE_TURN : 0.0;
        if (wraps) step = min_number(step, MAX_WRAPPED_STEP);
    }
    SampleBox box = {lower, extent, turns, nq};
    if (trees->sides[START_SIDE].size == 0) init_trees(trees, query);
    while (trees->samples < samples) {
        if (trees->samples >= next_widening) {
            next_widening = limit_box(trees, query, lower, extent);
            steps_across = most_new_vertices(extent, nq, step);
        }
        int64_t sizes[2] = {trees->sides[START_SIDE].size, trees->sides[GOAL_SIDE].size};
        if ((double)(sizes[0] > sizes[1] ? sizes[0] : sizes[1]) + steps_across > (double)capacity) return SEARCH_FULL;
        int side = sizes[START_SIDE] <= sizes[GOAL_SIDE] ? START_SIDE : GOAL_SIDE;
        Tree *tree = &trees->sides[side], *other = &trees->sides[1 - side];
        trees->samples++;
        double root_distances[2], distance;
        if (!draw_sample(trees, bound, random, &box, q, root_distances)) continue;
        double max_length = INFINITY;
        if (bound < INFINITY) {
            double slack = bound - root_distances[0] - root_distances[1];
            max_length = root_distances[side] + draw_uniform(random) * slack;
        }
        int64_t index = nearest_vertex(tree, tree->size, q, nq, capacity, max_length, turns, &distance);
        if (index < 0 || distance == 0.0) continue;
        if (is_stalled(trees, bound)) {
            if (draw_uniform(random) < 0.5) index = draw_index(random, tree->size);
            distance = escape_sample(tree, capacity, index, step, random, &box, q);
            if (distance == 0.0) continue;
        } else if (skip_sample(trees, tree, index, distance, query->domain)) {
            continue;
        }
        wrap_near(q, tree, index, turns, nq, capacity);
        double fraction = min_number(1.0, step / distance);
        for (int64_t j = 0; j < nq; j++) {
            a[j] = tree->vertices[j * capacity + index];
            if (fraction < 1.0) q[j] = a[j] + (q[j] - a[j]) * fraction;
        }
        if (!tree_edge_is_free(trees, side, a, q, scene, scratch)) {
            tree->blocked[index] = 1;
            continue;
        }
        trees->idle = 0;
        double length = tree->lengths[index] + fraction * distance;
        add_vertex(tree, q, nq, capacity, index, length);
        index = nearest_vertex(other, other->size, q, nq, capacity, bound - length, turns, &distance);
        if (index < 0) continue;
        wrap_near(q, other, index, turns, nq, capacity);
        if (connect_trees(trees, 1 - side, index, distance, q, step, a, b, scene, scratch)) {
            tree->connection = tree->size - 1;
            align_turns(trees, turns);
            trace_path(trees);
            return SEARCH_SOLVED;
        }
    }
    return SEARCH_GOING;
}
