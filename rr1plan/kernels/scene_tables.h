// All that a certificate of an edge reads and writes. Tables are shared and constant; each thread has its own scratch.
#ifndef RR1_SCENE_TABLES_H
#define RR1_SCENE_TABLES_H

#include "arm_geometry.h"
#include "exact_tables.h"
#include "fixed_solids.h"
#include "obstacle_tables.h"
#include "pair_tables.h"
#include "simd.h"

typedef struct {
    const ArmGeometry *arm;
    const ObstacleTables *obstacles;
    const PairTables *pairs;
    const ExactTables *exact;
    const FixedSolids *fixed;  // of obstacles; null if none can be moved
    int64_t column_count;  // of q
    double margin;         // gap beyond all other terms that a proof requires [m]
    double bare_margin;    // likewise, with all obstacles at the origin [m]
    double max_padding;    // [m]
} SceneTables;

// World pose and velocity of a joint's frame in eight configurations; velocities are derivatives by t, 0 <= t <= 1.
typedef struct {
    f64x8 rotation[9];  // row by row
    f64x8 origin[3];
    f64x8 angular[3];
    f64x8 linear[3];
} FrameLanes;

typedef struct {
    f64x8 center[3];
} SphereLanes;

// Motion of a sphere in its interval, for tests.
typedef struct {
    f64x8 center[3];
    f64x8 travel;       // bound of its displacement [m]
    f64x8 velocity[3];  // of the center
} SphereProbe;

// A sphere in the frame of a mesh.
typedef struct {
    f64x8 center[3];
    f64x8 limit;  // distance that suffices for a proof [m]
} MeshSphere;

// Motion of a joint on an edge: its value is (bend t + rate) t + begin.
typedef struct {
    double begin;
    double rate;
    double bend;
    double max_rate;
    double max_value;
} JointMotion;

// A near object, and the lanes in which it is near.
typedef struct {
    int64_t index;
    uint64_t lanes;
} Near;

// A body that is near an obstacle or another body, and the lanes in which it is.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t pair;
    int64_t body_pair;  // -1: `other` is an obstacle
    uint64_t lanes;
} NearBody;

// A body and an obstacle, or two bodies, that are not proven apart yet.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t body_pair;  // -1: `other` is an obstacle
    int64_t pair;
    uint64_t lanes;  // in which it is open
    int64_t sphere;  // one of each body, too near each other; equal for an obstacle
    int64_t other_sphere;
    uint64_t stuck;  // open lanes in which even the middle of the interval is not proven
} Candidate;

typedef struct {
    double middle;
    double half;
    uint64_t candidates;  // bits of those that are open on it
} Interval;

// Direction with which the last search for a pair ended, and the number of its edge.
typedef struct {
    double direction[3];
    int64_t edge;
} DirectionSeed;

// Result of a certificate. `fraction` and `pair`: where the edge is not proven free.
typedef struct {
    int64_t status;
    int64_t pair;
    double fraction;
} EdgeResult;

// Work done so far.
typedef struct {
    int64_t edges;
    int64_t exact_edges;
    int64_t configurations;
    int64_t gaps;
} Counters;

typedef struct {
    FrameLanes *frames;
    SphereLanes *spheres;
    int64_t *placed_batch;  // last batch for which a body was placed, below zero: only the ball around it
    // Boxes around the balls of groups on the whole edge, enlarged by the largest distance that any pair has to keep
    // [m]: rows low x, y, z, high x, y, z of `group_stride` numbers each.
    double *group_boxes;
    Near *near_obstacles;
    int64_t *near_groups;  // of `group_pairs`
    NearBody *near_bodies;
    Near *near_spheres;
    MeshSphere *mesh_spheres;  // of one body
    uint64_t *group_lanes;  // lanes in which a body may be near the current group
    // Bounds over the edge for the points of groups. Row k ignores the first k joints of the chain (for two groups:
    // those that move both); shape (longest chain + 1, `group_stride` of the arm).
    double *speeds;
    double *accelerations;
    int64_t bound_rows;
    JointMotion *joint_motions;
    Candidate *candidates;
    Interval *intervals;
    OpenInterval *open;
    int64_t interval_size;  // capacity of each of the two
    DirectionSeed *seeds;
    double *curve;       // q(t) = curve[0] + curve[1] t + curve[2] t^2, 0 <= t <= 1, shape (3, columns of q)
    ExactScratch *exact;
    int64_t edge;        // number of the current edge
    int64_t has_free_end;  // 1 if an end of the edge is known to be free: so are pairs without relative motion
    // Columns of the only arm whose pairs are open, all other pairs are known to be free; last column 0: any pair is.
    int64_t first_open_column;
    int64_t last_open_column;  // one past
    const uint8_t *left_out;   // 1 for columns of arms that this arm may touch; only if there is such an arm
    int64_t open_count;  // of `open`; -1: the whole edge is left to the exact kernel
    int64_t batches;     // of eight intervals
    double middles[8];
    double halves[8];
    uint64_t lane_candidates[8];
    EdgeResult result;
    Counters done;
} Scratch;

enum { EDGE_FREE, EDGE_CONTACT, EDGE_GRAZING };

// Factor for bounds that are sums of products in floating point.
#define SLACK (1.0 + 1e-9)

#endif
