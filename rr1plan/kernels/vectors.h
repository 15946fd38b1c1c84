// Points, directions and poses.
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

#endif
