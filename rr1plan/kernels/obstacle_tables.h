// What stands: obstacles and links that do not move, in the world's frame.
#ifndef RR1_OBSTACLE_TABLES_H
#define RR1_OBSTACLE_TABLES_H

#include <stdint.h>

enum { OBSTACLE_ROUNDED_BOX, OBSTACLE_CYLINDER, OBSTACLE_HALF_SPACE };
// In `core`: it has a closed form; it is left to the exact kernel; it is a mesh, its shape the box around that.
enum { CORE_CLOSED_FORM = -1, CORE_LEFT_OUT = -2, CORE_MESH = -3 };

typedef struct {
    int64_t kind;
    int64_t is_exact;  // 1 if its closed form is its shape, 0 if that encloses it only
} ObstacleKind;

// A half-space is everything below its center along its third axis.
typedef struct {
    double rotation[9];  // row by row
    double center[3];    // [m]
    double half[3];      // half sizes; of a cylinder radius, radius, half length
    double radius;       // around it
    double low;          // end along the third axis: -half[2], of a half-space -inf
} ObstacleShape;

typedef struct {
    int64_t count;  // a multiple of LANES: filled up with obstacles that are nowhere
    const ObstacleKind *kinds;
    const ObstacleShape *shapes;
    // Boxes around them: rows low x, y, z, high x, y, z of `count` numbers each [m].
    const double *boxes;
    const int64_t *core;  // row of `ArmGeometry.cores`, or one of the constants above
} ObstacleTables;

#endif
