// A path of one or several arms as a tree of intervals; each interval has its bodies at one configuration and a bound
// of their displacements from there.
#ifndef RR1_COORDINATION_H
#define RR1_COORDINATION_H

#include "exact_tables.h"

// Bodies that one joint carries, one after the other.
typedef struct {
    int64_t joint;
    int64_t first_body;
    int64_t last_body;
} BodyGroup;

// Node 1 is the whole path, nodes 2 i and 2 i + 1 are the halves of node i. Leaves begin at `leaf_count`; the last
// leaves may be empty. The two nodes after them are the ends of the path, of zero length.
typedef struct {
    const ExactTables *exact;
    const BodyGroup *groups;
    const Ball *group_balls;  // around the bodies of each group, in the frame of its joint
    int64_t group_count;
    int64_t leaf_count;        // a power of two
    const int64_t *is_empty;   // shape (2 leaf_count + 2,)
    const int64_t *cell;       // for leaves and ends: row of the coordination diagram, shape (leaf_count + 2,)
    int64_t cell_count;
    Pose *poses;               // shape (nodes, bodies)
    Vec3 *centers;       // of balls around bodies, shape (nodes, bodies)
    double *travel;            // largest displacement of any point of a body from there [m], shape (nodes, bodies)
    Vec3 *group_centers; // shape (nodes, groups)
    double *group_travel;      // [m], shape (nodes, groups)
} PlacedPath;

typedef struct {
    int64_t one;
    int64_t two;
} CrossGroups;

// Pairs that must not touch between the bodies of two paths.
typedef struct {
    const double *padding;       // for each two bodies [m], -inf: not checked, shape (bodies, bodies)
    const CrossGroups *group_pairs;  // groups with checked bodies
    int64_t group_pair_count;
    double max_padding;
} CrossPairs;

#endif
