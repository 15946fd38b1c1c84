// Points, directions, poses, and shapes around others.
#ifndef RR1_VECTORS_H
#define RR1_VECTORS_H

// A point or a direction.
typedef struct {
    double x, y, z;
} Vec3;

typedef struct {
    double rotation[9];  // row by row
    double origin[3];    // [m]
} Pose;

typedef struct {
    double center[3];  // [m]
    double radius;
} Ball;

// A box along the axes of its frame [m].
typedef struct {
    double low[3];
    double high[3];
} Box;

#endif
