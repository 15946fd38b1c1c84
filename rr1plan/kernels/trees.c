// Two trees of configurations: vertices, nearest neighbors, the path through both.
//
// In joints that wrap, a vertex is less than half a turn from its parent, with any number of whole turns from zero;
// differences are the shorter ones.
#include "trees.h"

// Vertices whose distances are computed in one block.
#define TREE_BLOCK 64

// The whole turns nearest to a difference; 0 for a joint that does not wrap, whose turn is 0.
INLINE double nearest_turns(double difference, double turn) {
    // Half a turn is rounded to even multiples: the same in both directions.
    return turn > 0.0 ? turn * __builtin_rint(difference / turn) : 0.0;
}

// The nearest vertex from which q is reached within a length, ties by index; -1 if there is none.
//
// Only the first `count` vertices are considered. `turns` is 2 pi for joints that wrap, 0 for the others, shape (nq,).
static int64_t nearest_vertex(const Tree *tree, int64_t count, const double *q, int64_t nq, int64_t capacity,
                              double max_length, const double *turns, double *distance) {
    double best = INFINITY, squares[TREE_BLOCK];
    int64_t index = -1;
    for (int64_t first = 0; first < count; first += TREE_BLOCK) {
        int64_t size = count - first < TREE_BLOCK ? count - first : TREE_BLOCK;
        for (int64_t i = 0; i < size; i++) squares[i] = 0.0;
        for (int64_t j = 0; j < nq; j++) {
            const double *row = tree->vertices + j * capacity + first;
            double value = q[j], turn = turns[j];
            if (turn > 0.0) {
                for (int64_t i = 0; i < size; i++) {
                    double difference = row[i] - value;
                    difference -= nearest_turns(difference, turn);
                    squares[i] += difference * difference;
                }
            } else {
                for (int64_t i = 0; i < size; i++) {
                    double difference = row[i] - value;
                    squares[i] += difference * difference;
                }
            }
        }
        for (int64_t i = 0; i < size; i++) {
            if (squares[i] >= best) continue;
            double left = max_length - tree->lengths[first + i];
            if (left >= 0.0 && squares[i] <= left * left) {
                best = squares[i];
                index = first + i;
            }
        }
    }
    *distance = sqrt_number(best);
    return index;
}

// Subtract whole turns from q, so that the straight line from a vertex is the shorter way.
static void wrap_near(double *q, const Tree *tree, int64_t index, const double *turns, int64_t nq, int64_t capacity) {
    for (int64_t j = 0; j < nq; j++)
        if (turns[j] > 0.0) q[j] += nearest_turns(tree->vertices[j * capacity + index] - q[j], turns[j]);
}

static void add_vertex(Tree *tree, const double *q, int64_t nq, int64_t capacity, int64_t parent, double length) {
    int64_t i = tree->size++;
    for (int64_t j = 0; j < nq; j++) tree->vertices[j * capacity + i] = q[j];
    tree->parents[i] = parent;
    tree->lengths[i] = length;
}

// Reset both trees to their roots.
static void init_trees(Trees *trees, const TreeQuery *query) {
    int64_t nq = trees->column_count, capacity = trees->capacity;
    const double *roots[2] = {query->start, query->goals};
    trees->samples = trees->edges = trees->skipped = trees->idle = trees->path_rows = 0;
    for (int side = 0; side < 2; side++) {
        Tree *tree = &trees->sides[side];
        tree->size = tree->connection = 0;
        tree->root_count = side == START_SIDE ? 1 : query->goal_count;
        for (int64_t i = 0; i < capacity; i++) tree->blocked[i] = 0;
        for (int64_t i = 0; i < tree->root_count; i++) add_vertex(tree, roots[side] + i * nq, nq, capacity, -1, 0.0);
    }
}

// Shift the goal tree by whole turns to align with the start tree at the connecting edge.
static void align_turns(Trees *trees, const double *turns) {
    Tree *one = &trees->sides[START_SIDE], *two = &trees->sides[GOAL_SIDE];
    for (int64_t j = 0; j < trees->column_count; j++) {
        int64_t row = j * trees->capacity;
        double move = nearest_turns(one->vertices[row + one->connection] - two->vertices[row + two->connection], turns[j]);
        if (move == 0.0) continue;
        for (int64_t i = 0; i < two->size; i++) two->vertices[row + i] += move;
    }
}

INLINE void write_waypoint(Trees *trees, int side, int64_t vertex, int64_t row) {
    int64_t nq = trees->column_count;
    for (int64_t j = 0; j < nq; j++)
        trees->path[row * nq + j] = trees->sides[side].vertices[j * trees->capacity + vertex];
}

// Write the path from the start to a goal through the connecting edge.
static void trace_path(Trees *trees) {
    const Tree *one = &trees->sides[START_SIDE], *two = &trees->sides[GOAL_SIDE];
    int64_t rows = 0;
    for (int64_t i = one->connection; i >= 0; i = one->parents[i]) rows++;
    int64_t row = rows;
    for (int64_t i = one->connection; i >= 0; i = one->parents[i]) write_waypoint(trees, START_SIDE, i, --row);
    for (int64_t i = two->connection; i >= 0; i = two->parents[i]) write_waypoint(trees, GOAL_SIDE, i, rows++);
    trees->path_rows = rows;
}
