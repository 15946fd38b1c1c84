// Geometry of an arm and the objects it holds: joints, the convex bodies they carry, and shapes that enclose these.
//
// Rows are read directly from C arrays of int64 or double; SI units, lengths in m, angles in rad.
#ifndef RR1_ARM_GEOMETRY_H
#define RR1_ARM_GEOMETRY_H

#include <stdint.h>

#include "vectors.h"

// A driven joint; row 0 is the world. Parents come before children.
typedef struct {
    int64_t parent;
    int64_t prismatic;  // 1 if it slides along its z axis, 0 if it turns about it
    int64_t column;     // of q
} Joint;

// Pose of a joint's frame in that of its parent when the joint is at zero; the axis of the joint is z.
typedef struct {
    double rotation[9];  // row by row
    double origin[3];    // [m]
    double gain;         // of the column of q; a mimic joint's multiplier
} JointPlacement;

// A convex body. Its first sphere is the ball around the whole body; the others fill it and together contain it.
typedef struct {
    int64_t joint;
    int64_t first_sphere;
    int64_t last_sphere;  // one past
    int64_t group;
} Body;

// Bodies that one joint carries.
typedef struct {
    int64_t joint;
    int64_t ball;  // sphere around the whole group; for a single body, that of the body
    int64_t first_body;
    int64_t last_body;
    int64_t first_link;  // of `chain`
    int64_t last_link;
} Group;

// LANES consecutive groups. The joints that carry any of them lie in a range.
typedef struct {
    int64_t first_joint;
    int64_t last_joint;  // one past
    int64_t first_row;   // of `reach`
} GroupBlock;

typedef struct {
    double center[3];  // in the joint's frame [m]
    double radius;
    double inner_radius;  // of a concentric ball inside the body, whose center is in its core; far below zero: none
} LinkSphere;

enum { CORE_POINTS, CORE_CYLINDER };

// The core of a body: the hull of points, or a cylinder; the body is the set of all points within a radius of its core.
typedef struct {
    int64_t frame;        // joint that carries it, 0: the world
    int64_t first_point;  // for a cylinder: center, axis, (half length, radius, 0)
    int64_t last_point;
    int64_t kind;
    int64_t first_block;  // of `blocks`
    int64_t first_word;   // of `lowest`
    int64_t per_bit;      // corners that share a bit of a word there, 0: no table
} CoreRange;

typedef struct {
    double middle[3];  // a point of the core, in its frame [m]
    double radius;     // around the core
    double reach;      // largest distance of the core from the point
    double axes[9];    // rotation from the axes of `lowest`, row by row
} CoreShape;

typedef struct {
    int64_t joint_count;
    int64_t body_count;
    int64_t group_count;
    const Joint *joints;
    const JointPlacement *placements;
    const Body *bodies;
    const Group *groups;
    const Box *group_boxes;  // around whole groups, in the axes of their joints, relative to the centers of their balls
    const LinkSphere *spheres;
    const int64_t *chain;  // joints above each group, root first
    const int64_t *depths;  // of each joint: number of driven joints above it
    const GroupBlock *group_blocks;
    // Largest distance of any point of a group from the axis of a joint, prismatic joints at zero [m]; -1 if the joint
    // does not carry the group. Rows of LANES groups, a row for each joint of each of `group_blocks`.
    const double *reach;
    int64_t group_stride;  // number of groups rounded up to a multiple of LANES
    // Cores of the bodies, then those of obstacles without a closed form.
    const CoreRange *cores;
    const CoreShape *core_shapes;
    const Vec3 *points;
    const Ball *blocks;  // around `BLOCK_POINTS` consecutive points of a core
    // Points that can be the lowest along the directions of a cell: see support_table.h.
    const uint64_t *lowest;
} ArmGeometry;

#endif
