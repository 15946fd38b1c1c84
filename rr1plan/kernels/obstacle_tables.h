// Stationary geometry in the world frame: obstacles, and links that do not move.
#ifndef RR1_OBSTACLE_TABLES_H
#define RR1_OBSTACLE_TABLES_H

#include <stdint.h>

enum { OBSTACLE_ROUNDED_BOX, OBSTACLE_CYLINDER, OBSTACLE_HALF_SPACE };
// In `core`: an obstacle with a closed form; one left to the exact kernel; a mesh, whose shape is the box around it.
enum { CORE_CLOSED_FORM = -1, CORE_LEFT_OUT = -2, CORE_MESH = -3 };

typedef struct {
    int64_t kind;
    int64_t is_exact;  // 1 if the closed form is its exact shape, 0 if it only encloses the obstacle
} ObstacleKind;

// A half-space is everything below its center along its third axis.
typedef struct {
    double rotation[9];  // row by row
    double center[3];    // [m]
    double half[3];      // half sizes; for a cylinder: radius, radius, half length
    double radius;       // around the core
    double low;          // lower end along the third axis: -half[2], -inf for a half-space
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
