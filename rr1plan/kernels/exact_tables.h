// Input of the exact kernel, and the memory it writes: bodies of arms, then obstacles, as cores with a radius.
#ifndef RR1_EXACT_TABLES_H
#define RR1_EXACT_TABLES_H

#include <stdint.h>

#include "mesh_tables.h"
#include "vectors.h"

// Row 0 is the world.
typedef struct {
    int64_t parent;
    int64_t prismatic;
    int64_t column;  // of q, -1: none
    int64_t driven;  // 1 if it or a joint above it is driven
} ExactJoint;

typedef struct {
    double rotation[9];
    double origin[3];
    double axis[3];
    double gain;
    double offset;  // value of the joint at q = 0 [rad or m]
} ExactPlacement;

enum {
    BODY_POINT,
    BODY_SEGMENT,
    BODY_BOX,
    BODY_CYLINDER,
    BODY_CORNERS,
    BODY_HALF_SPACE,
    BODY_CELLS,
    BODY_MESH,      // its first corner is a row of `MeshTables.ranges`
    BODY_TRIANGLE,  // of a mesh
};

typedef struct {
    int64_t kind;
    int64_t joint;
    int64_t first_corner;
    int64_t last_corner;
    int64_t first_link;  // of `chain`
    int64_t last_link;
} ExactBody;

typedef struct {
    double rotation[9];  // in the joint's frame
    double origin[3];
    double ball_center[3];  // of the ball around it, in the joint's frame
    double ball_radius;
    double radius;         // around the core
    double box_center[3];  // of the box around it, in its own frame
    double box_half[3];
    double size[3];  // half sizes of the core; a half-space's normal; a cell's half size
    double offset;   // of a half-space
} ExactShape;

// The half-space, cloud or mesh, if there is one, comes second.
typedef struct {
    int64_t body;
    int64_t other;
    int64_t shared;  // number of joints that move both
} ExactPair;

// A pair that is open on an interval of a curve.
typedef struct {
    double middle;
    double half;
    int64_t pair;
} OpenInterval;

typedef struct {
    int64_t joint_count;
    int64_t body_count;
    int64_t pair_count;
    int64_t column_count;  // of q
    const ExactJoint *joints;
    const ExactPlacement *placements;
    const ExactBody *bodies;
    const ExactShape *shapes;
    const Vec3 *corners;  // of bodies of kind CORNERS, centers of the cells of CELLS [m]
    const int64_t *links;       // neighbors of corner i are links[links[i]] to links[links[i + 1] - 1]
    const int64_t *chain;       // driven joints above each body, root first
    const double *chain_reach;  // for each, bound of the distance of the body's ball center from its axis [m]
    const ExactPair *pairs;
    const double *padding;
    const MeshTables *meshes;
} ExactTables;

typedef struct {
    Pose *joint_poses;       // in the world; those of joints that are not driven are constant
    Pose *poses;             // of bodies
    Vec3 *centers;     // of the balls around bodies
    Vec3 *directions;  // for each pair, where its last search ended
    // Entry (b, k): bound of the displacement of body b's points by the k-th and later joints of its chain [m].
    double *travel;
    int64_t travel_stride;
    double *coefficients;  // of a curve at the middle of an interval, shape (most terms of a curve, columns of q)
    double *q;
    double *reach;       // largest change of each column of q from there
    int64_t *placed_at;  // number of the interval for which each body was last placed
    OpenInterval *queue;
    int64_t queue_size;  // a power of two
} ExactScratch;

#endif
