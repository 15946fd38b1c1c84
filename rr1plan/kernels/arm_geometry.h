// What moves: joints, the convex bodies they carry, and what encloses those. Made once for an arm and what it holds.
//
// Rows are read from C arrays of int64 or double as they are; SI units, lengths in m, angles in rad.
#ifndef RR1_ARM_GEOMETRY_H
#define RR1_ARM_GEOMETRY_H

#include <stdint.h>

// A driven joint; row 0 is the world. Parents come before children.
typedef struct {
    int64_t parent;
    int64_t prismatic;  // 1 if it slides along its z axis, 0 if it turns about it
    int64_t column;     // of q
} Joint;

// Where a joint's frame is in its parent's at zero; its own axis is z.
typedef struct {
    double rotation[9];  // row by row
    double origin[3];    // [m]
    double gain;         // of the column of q; a mimic joint's multiplier
} JointPlacement;

// A convex body. Its first sphere is the ball around all of it, the others fill it and together contain it.
typedef struct {
    int64_t joint;
    int64_t first_sphere;
    int64_t last_sphere;  // one past
    int64_t group;
} Body;

// Bodies that one joint carries.
typedef struct {
    int64_t joint;
    int64_t ball;  // sphere around all of it; of a single body its own
    int64_t first_body;
    int64_t last_body;
    int64_t first_link;  // of `chain`
    int64_t last_link;
} Group;

// The box around all of a group, in the joint's axes, from the center of its ball [m].
typedef struct {
    double low[3];
    double high[3];
} GroupBox;

// LANES groups that follow each other. The joints that carry any of them lie in a range.
typedef struct {
    int64_t first_joint;
    int64_t last_joint;  // one past
    int64_t first_row;   // of `reach`
} GroupBlock;

typedef struct {
    double center[3];  // in the joint's frame [m]
    double radius;
    double inner_radius;  // of a ball of that center inside the body; far below zero: none
    double apart;         // distance of the center from that of the body's ball [m]
} LinkSphere;

enum { CORE_POINTS, CORE_CYLINDER };

// The core of a body: the hull of points, or a cylinder; the body is all within a radius of its core.
typedef struct {
    int64_t frame;        // joint that carries it, 0: the world
    int64_t first_point;  // of a cylinder: center, axis, (half length, radius, 0)
    int64_t last_point;
    int64_t kind;
    int64_t first_block;  // of `blocks`
    int64_t first_word;   // of `lowest`
    int64_t per_bit;      // corners that share a bit of a word there, 0: no table
} CoreRange;

typedef struct {
    double middle[3];  // a point of the core, in its frame [m]
    double radius;     // around the core
    double reach;      // how far the core reaches from the point
    double axes[9];    // rotation from the axes of `lowest`, row by row
} CoreShape;

typedef struct {
    double x, y, z;
} Point;

// A ball around `BLOCK_POINTS` consecutive points of a core.
typedef struct {
    double center[3];
    double radius;
} PointBlock;

typedef struct {
    int64_t joint_count;
    int64_t body_count;
    int64_t group_count;
    int64_t sphere_count;
    const Joint *joints;
    const JointPlacement *placements;
    const Body *bodies;
    const Group *groups;
    const GroupBox *group_boxes;
    const LinkSphere *spheres;
    const int64_t *chain;  // joints above each group, root first
    const int64_t *depths;  // of each joint: how many driven joints are above it
    const GroupBlock *group_blocks;
    // How far any point of a group can be from a joint's axis, prismatic joints at zero [m]; -1 where the joint does not
    // carry the group. Rows of LANES groups, a row for each joint of each of `group_blocks`.
    const double *reach;
    int64_t group_stride;  // number of groups rounded up to a multiple of LANES
    // Cores of the bodies, then those of obstacles without a closed form.
    const CoreRange *cores;
    const CoreShape *core_shapes;
    const Point *points;
    const PointBlock *blocks;
    // Which points can be the lowest along the directions of a cell: see support_table.h.
    const uint64_t *lowest;
} ArmGeometry;

#endif
