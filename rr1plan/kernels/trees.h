// Two trees of configurations that grow toward each other, and the search that grows them.
#ifndef RR1_TREES_H
#define RR1_TREES_H

#include <stdint.h>

enum { START_SIDE, GOAL_SIDE };

// The roots are the first vertices.
typedef struct {
    double *vertices;  // one per column, for SIMD distances to many vertices; shape (nq, capacity)
    int64_t *parents;  // of each vertex, -1 for a root; shape (capacity,)
    double *lengths;   // of the path to each vertex from its root; shape (capacity,)
    uint8_t *blocked;  // whether an edge from a vertex toward a sample was in collision; shape (capacity,)
    int64_t size;
    int64_t root_count;
    int64_t connection;  // vertex at the end of the edge that connects both trees
} Tree;

typedef struct {
    Tree sides[2];
    int64_t column_count;  // nq
    int64_t capacity;      // of either tree
    int64_t samples;       // drawn so far
    int64_t edges;         // checked so far
    int64_t skipped;       // consecutive skipped samples
    int64_t idle;          // consecutive samples without growth
    double *path;          // from the start to a goal, once the trees are connected; shape (2 capacity, nq)
    int64_t path_rows;
    double *scratch;  // shape (6, nq)
} Trees;

// A planning query.
typedef struct {
    const double *start;   // shape (nq,)
    const double *goals;   // shape (goal_count, nq), 2 goal_count <= capacity
    const double *lower;   // lower corner of the sampling box, shape (nq,)
    const double *extent;  // its side lengths, infinite for a joint that wraps, shape (nq,)
    int64_t goal_count;
    double step;    // longest edge of a tree
    double domain;  // sampling radius around a vertex with a blocked edge
    double bound;   // longest path (inf: any)
} TreeQuery;

// Number of nearest goals to which the straight line is checked before planning.
enum { STRAIGHT_LINES = 8 };

// Joints with a range of more turns are searched near the roots first.
enum { WIDE_TURNS = 4 };

enum { SEARCH_GOING, SEARCH_SOLVED, SEARCH_FULL };

#endif
