// Solids that do not move, of obstacles and of links, in the frames of their objects; and the poses of these objects.
#ifndef RR1_FIXED_SOLIDS_H
#define RR1_FIXED_SOLIDS_H

#include "arm_geometry.h"
#include "obstacle_tables.h"

typedef struct {
    double values[16];  // row by row
} Transform;

typedef struct {
    int64_t object;
    int64_t body;         // row of the exact kernel's tables, -1: a link, whose row is the arm's
    int64_t obstacle;     // row of `ObstacleTables`, -1: no moving body is checked against it
    int64_t core;         // likewise
    int64_t first_point;  // of `points`, if it has a core; -1: the core is placed and does not move
    int64_t first_block;  // of `blocks`
    int64_t kind;         // as in `ObstacleKind`
    int64_t is_exact;
} FixedSolid;

// A shape given by its dimensions.
typedef struct {
    int64_t kind;    // as in `ExactBody`
    double size[4];  // edges of a box; radius of a ball; radius and length; normal and offset of a half-space [m]
} ShapeSize;

// A solid in its own frame.
typedef struct {
    double ball_center[3];  // of the ball around it
    double ball_radius;     // this and the next five as in `ExactShape`
    double core_margin;     // its `radius`
    double box_center[3];
    double box_half[3];
    double size[3];
    double offset;
    double half[3];         // as in `ObstacleShape`
    double radius;
    double middle[3];  // as in `CoreShape`
    double reach;
} SolidShape;

typedef struct {
    int64_t count, object_count;
    FixedSolid *solids;
    const SolidShape *shapes;
    const Transform *frames;  // of solids in the frames of their objects
    Transform *objects;       // in the world
    const Vec3 *points;      // of cores, in the frames of their solids
    const Ball *blocks;
} FixedSolids;

#endif
