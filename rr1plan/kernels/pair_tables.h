// Who must not meet whom, and how far apart: bodies and obstacles, bodies and bodies.
#ifndef RR1_PAIR_TABLES_H
#define RR1_PAIR_TABLES_H

#include <stdint.h>

// Two elements, or two solids, by number.
typedef struct {
    int64_t one;
    int64_t other;
} NumberPair;

// Two bodies that move against each other.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t shared;   // how many joints of their chains move both
    int64_t pair;     // of `padding`
    int64_t map;      // first entry of its clearance map in `maps`, -1: none
    int64_t width;    // columns of cells of the map
    int64_t column;   // of q, along the rows of the map
    int64_t column2;  // of q, along its columns
} BodyPair;

// The entries of `BodyPair` before those of its clearance map.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t shared;
    int64_t pair;
} ListedBodyPair;

// Two groups some bodies of which must not meet.
typedef struct {
    int64_t group;
    int64_t other;
    int64_t shared;
    int64_t first;  // of `body_pairs`
    int64_t last;
    int64_t map;  // of all its pairs together, shaped like that of the first; -1: none
} GroupPair;

// The entries of `GroupPair` before its clearance map.
typedef struct {
    int64_t group;
    int64_t other;
    int64_t shared;
    int64_t first;
    int64_t last;
} ListedGroupPair;

// LANES obstacles or groups in a row, and which of them a group must not meet.
typedef struct {
    int64_t first;
    int64_t lanes;  // a bit for each
    int64_t pair;   // of groups: the first of `group_pairs`, which has the others behind it
} NearBlock;

// Cells of a clearance map along each side.
enum { MAP_CELLS = 128 };

// Low end of either column of q [rad or m], and cells per rad or m.
typedef struct {
    double low;
    double per_unit;
    double low2;
    double per_unit2;
} MapRange;

typedef struct {
    int64_t pair_count;
    int64_t body_pair_count;
    const double *padding;       // distance to keep of each pair [m]
    const int64_t *obstacle_pair;  // pair of a body and an obstacle, -1: none; shape (bodies, obstacles)
    // Blocks of obstacles and of groups, group after group: those of group g are entries `first_obstacle_block[g]` to
    // `first_obstacle_block[g + 1] - 1`, and the same of groups.
    const NearBlock *obstacle_blocks;
    const int64_t *first_obstacle_block;
    const NearBlock *group_blocks;
    const int64_t *first_group_block;
    const BodyPair *body_pairs;
    const GroupPair *group_pairs;  // sorted by both groups
    const MapRange *map_ranges;  // of each body pair
    const int16_t *maps;         // clearance maps: see clearance_map.c
} PairTables;

#endif
