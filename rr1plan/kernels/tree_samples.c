// Sampling for RRT-Connect.
//
// Every second sample is drawn from a box around the start and a goal, the others from the whole space, because few
// paths need the full range of a joint. After many consecutive samples without growth of a tree, every fourth one is
// replaced by a configuration close to a vertex (escape sample): next to obstacles, most edges toward distant samples
// are blocked.
//
// Under a bound, samples are drawn from the informed set of paths shorter than the bound (Gammell, Srinivasa,
// Barfoot, Informed RRT*, 2014). Continuous joints are sampled from one turn.
#include "random.h"
#include "trees.h"

// After PATIENCE consecutive samples without growth, every ESCAPE_PERIOD-th is an escape sample, while the smaller tree
// has fewer than SMALL_TREE vertices: in larger trees they would only fill the local region.
enum { PATIENCE = 20, ESCAPE_PERIOD = 4, SMALL_TREE = 96 };
// Most draws of a sample in the informed set.
enum { SAMPLE_TRIES = 16 };
// How far the box around a start and a goal extends beyond them, relative to their distance.
#define BOX_MARGIN 0.25

// The sampling box, with continuous joints limited to one turn and wide ranges to what is around the roots; `turns`:
// 2 pi for joints that wrap, 0 for others.
typedef struct {
    const double *lower, *extent, *turns;
    int64_t nq;
} SampleBox;

// A point of the informed ellipsoid: points on paths from the start to a goal no longer than a bound.
//
// The distribution is not uniform, but has positive density everywhere. Returns 0 if the point
// is outside the box.
static int draw_in_ellipsoid(const Trees *trees, int64_t goal, double bound, uint64_t *random, const SampleBox *box,
                             double *q) {
    int64_t nq = box->nq, capacity = trees->capacity;
    const double *start_vertices = trees->sides[START_SIDE].vertices;
    const double *goal_vertices = trees->sides[GOAL_SIDE].vertices + goal;
    double radius = 0.0, square = 0.0, focal = 0.0;
    for (int64_t j = 0; j < nq; j++) {
        q[j] = 0.0;
        if (box->extent[j] > 0.0) {
            // The sum of four uniform numbers is nearly normal; the largest of n is the radius of a uniform point of a
            // ball.
            q[j] = draw_uniform(random) + draw_uniform(random) + draw_uniform(random) + draw_uniform(random) - 2.0;
            radius = max_number(radius, draw_uniform(random));
            square += q[j] * q[j];
        }
        double difference = goal_vertices[j * capacity] - start_vertices[j * capacity];
        focal += difference * difference;
    }
    if (square == 0.0 || focal == 0.0 || focal >= bound * bound) return 0;
    // Half axes: `across` orthogonal to the line between the foci, bound / 2 along it.
    double across = 0.5 * sqrt_number(bound * bound - focal);
    focal = sqrt_number(focal);
    double scale = radius / sqrt_number(square), along = 0.0;
    for (int64_t j = 0; j < nq; j++) {
        q[j] *= scale;
        along += q[j] * (goal_vertices[j * capacity] - start_vertices[j * capacity]) / focal;
    }
    double stretch = along * (0.5 * bound - across) / focal;
    int inside = 1;
    for (int64_t j = 0; j < nq; j++) {
        double a = start_vertices[j * capacity], b = goal_vertices[j * capacity], low = box->lower[j];
        q[j] = box->extent[j] == 0.0 ? low : 0.5 * (a + b) + across * q[j] + stretch * (b - a);
        inside = inside && (box->turns[j] > 0.0 || (low <= q[j] && q[j] <= low + box->extent[j]));
    }
    return inside;
}

// A point of the enlarged box around the start and a goal.
static void draw_between_roots(const Trees *trees, int64_t goal, uint64_t *random, const SampleBox *box, double *q) {
    int64_t nq = box->nq, capacity = trees->capacity;
    const double *start_vertices = trees->sides[START_SIDE].vertices;
    const double *goal_vertices = trees->sides[GOAL_SIDE].vertices + goal;
    double square = 0.0;
    for (int64_t j = 0; j < nq; j++) {
        double difference = goal_vertices[j * capacity] - start_vertices[j * capacity];
        square += difference * difference;
    }
    double margin = BOX_MARGIN * sqrt_number(square);
    for (int64_t j = 0; j < nq; j++) {
        double a = start_vertices[j * capacity], b = goal_vertices[j * capacity];
        double low = min_number(a, b) - margin, high = max_number(a, b) + margin;
        if (box->turns[j] == 0.0) {
            low = max_number(box->lower[j], low);
            high = min_number(box->lower[j] + box->extent[j], high);
        }
        q[j] = low + draw_uniform(random) * (high - low);
    }
}

// A configuration that a path shorter than the bound may pass, and its distances from the roots of both trees.
//
// Returns 0 if none was found; without a bound both distances are 0.
static int draw_sample(const Trees *trees, double bound, uint64_t *random, const SampleBox *box, double *q,
                       double root_distances[2]) {
    const Tree *goals = &trees->sides[GOAL_SIDE];
    root_distances[0] = root_distances[1] = 0.0;
    if (bound == INFINITY) {
        if (trees->samples % 2 == 0) {
            draw_between_roots(trees, draw_index(random, goals->root_count), random, box, q);
        } else {
            draw_in_box(random, box->lower, box->extent, box->nq, q);
        }
        return 1;
    }
    for (int attempt = 0; attempt < SAMPLE_TRIES; attempt++) {
        if (attempt % 2 == 0) {
            draw_in_box(random, box->lower, box->extent, box->nq, q);
        } else {
            int64_t goal = draw_index(random, goals->root_count);
            if (!draw_in_ellipsoid(trees, goal, bound, random, box, q)) continue;
        }
        for (int side = 0; side < 2; side++) {
            const Tree *tree = &trees->sides[side];
            nearest_vertex(tree, tree->root_count, q, box->nq, trees->capacity, INFINITY, box->turns,
                           &root_distances[side]);
        }
        if (root_distances[0] + root_distances[1] < bound) return 1;
    }
    return 0;
}

// Count a sample without growth. Returns whether to replace it by an escape sample.
static int is_stalled(Trees *trees, double bound) {
    trees->idle++;
    int64_t one = trees->sides[START_SIDE].size, two = trees->sides[GOAL_SIDE].size;
    return (one < two ? one : two) < SMALL_TREE && bound == INFINITY && trees->idle > PATIENCE &&
           trees->samples % ESCAPE_PERIOD == 0;
}

// A configuration at most a step from a vertex, in a random direction, within limits. Returns its distance.
static double escape_sample(const Tree *tree, int64_t capacity, int64_t index, double step, uint64_t *random,
                            const SampleBox *box, double *q) {
    double square = 0.0;
    for (int64_t j = 0; j < box->nq; j++) {
        q[j] = box->extent[j] > 0.0 ? draw_uniform(random) + draw_uniform(random) - 1.0 : 0.0;
        square += q[j] * q[j];
    }
    double scale = step * draw_uniform(random) / sqrt_number(square);
    square = 0.0;
    for (int64_t j = 0; j < box->nq; j++) {
        double from = tree->vertices[j * capacity + index];
        q[j] = from + scale * q[j];
        if (box->turns[j] == 0.0)
            q[j] = min_number(max_number(q[j], box->lower[j]), box->lower[j] + box->extent[j]);
        square += (q[j] - from) * (q[j] - from);
    }
    return sqrt_number(square);
}
