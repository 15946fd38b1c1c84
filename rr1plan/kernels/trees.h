// Two trees of configurations that grow toward each other, and the search that grows them.
#ifndef RR1_TREES_H
#define RR1_TREES_H

#include <stdint.h>

enum { START_SIDE, GOAL_SIDE };

// The roots are the first vertices.
typedef struct {
    double *vertices;  // one a column, so that distances to many are computed side by side; shape (nq, capacity)
    int64_t *parents;  // of each vertex, -1 for a root; shape (capacity,)
    double *lengths;   // of the path to each vertex from its root; shape (capacity,)
    uint8_t *blocked;  // whether an edge from a vertex toward a sample was in collision; shape (capacity,)
    int64_t size;
    int64_t root_count;
    int64_t meeting;  // the vertex that the connecting edge starts from, once the trees have met
} Tree;

typedef struct {
    Tree sides[2];
    int64_t column_count;  // nq
    int64_t capacity;      // of either tree
    int64_t samples;       // drawn so far
    int64_t edges;         // checked so far
    int64_t skipped;       // samples in a row that were skipped
    int64_t idle;          // samples in a row since a tree has grown
    double *path;          // from the start to a goal, once the trees have met; shape (2 capacity, nq)
    int64_t path_rows;
    double *scratch;  // shape (6, nq)
} Trees;

// What is searched for, and where.
typedef struct {
    const double *start;   // shape (nq,)
    const double *goals;   // shape (goal_count, nq), 2 goal_count <= capacity
    const double *lower;   // corner of the box to sample, shape (nq,)
    const double *extent;  // its sides, infinite for a joint that wraps, shape (nq,)
    int64_t goal_count;
    double step;    // longest edge of a tree
    double domain;  // a vertex with a blocked edge takes only samples that are nearer than this
    double bound;   // longest path (inf: any)
} TreeQuery;

// Goals to which the straight line is tried before anything else.
enum { STRAIGHT_LINES = 8 };

enum { SEARCH_GOING, SEARCH_SOLVED, SEARCH_FULL };

#endif
