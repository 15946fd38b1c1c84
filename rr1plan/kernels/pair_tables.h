// Pairs that must not collide, bodies and obstacles or two bodies, and the distances to keep.
#ifndef RR1_PAIR_TABLES_H
#define RR1_PAIR_TABLES_H

#include <stdint.h>

// Two elements, or two solids, by number.
typedef struct {
    int64_t one;
    int64_t other;
} NumberPair;

// Two bodies that move relative to each other.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t shared;   // number of joints of their chains that move both
    int64_t pair;     // of `padding`
    int64_t map;      // first entry of its clearance map in `maps`, -1: none
    int64_t width;    // columns of cells of the map
    int64_t column;   // of q, along the rows of the map
    int64_t column2;  // of q, along its columns
} BodyPair;

// Two groups with bodies that must not collide.
typedef struct {
    int64_t group;
    int64_t other;
    int64_t shared;
    int64_t first;  // of `body_pairs`
    int64_t last;
    int64_t map;  // for all its pairs together, shaped like that of the first; -1: none
} GroupPair;

// LANES consecutive obstacles or groups, and those of them with which a group must not collide.
typedef struct {
    int64_t first;
    int64_t lanes;  // a bit for each
    int64_t pair;   // for groups: the first of `group_pairs`, followed by the others
} NearBlock;

// Cells of a clearance map along each side.
enum { MAP_CELLS = 128 };

// Low end of each column of q [rad or m], and cells per rad or m.
typedef struct {
    double low;
    double per_unit;
    double low2;
    double per_unit2;
} MapRange;

typedef struct {
    const double *padding;       // distance that each pair has to keep [m]
    const int32_t *obstacle_pair;  // pair of a body and an obstacle, -1: none; shape (bodies, obstacles)
    // Blocks of obstacles and of groups, group after group: those of group g are entries `first_obstacle_block[g]` to
    // `first_obstacle_block[g + 1] - 1`; likewise for groups.
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
