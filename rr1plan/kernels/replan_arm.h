// One arm is given a new motion while all others keep theirs.
#ifndef RR1_REPLAN_ARM_H
#define RR1_REPLAN_ARM_H

#include <stdint.h>

// The motions of the other arms, the search tree, and its result; the arm has `width` columns.
typedef struct {
    const double *times;   // of the waypoints, increasing from 0, shape (count,)
    const double *points;  // all arms; of the arm itself only its start and its goal matter; shape (count, column_count)
    int64_t count;
    int64_t column_count;
    int64_t first_column;  // of the arm
    int64_t width;
    const uint8_t *left_out;  // 1 for columns of arms that are ignored, shape (column_count,)
    const double *velocity;  // largest speeds of the arm, shape (width,)
    const double *lower;     // its position limits, shape (width,)
    const double *upper;
    int64_t samples;   // to draw, at most, with those drawn before
    int64_t drawn;     // samples drawn so far
    int64_t size;      // vertices of the tree; 0 before the first call
    int64_t shortcuts;  // to try
    double *vertices;  // configurations of the arm, shape (samples + 1, width)
    double *reached;   // when the arm is there, shape (samples + 1,)
    int64_t *parents;  // shape (samples + 1,)
    double *knots;       // waypoints of the new motion, shape (samples + 2, width)
    double *knot_times;  // shape (samples + 2,)
    double *memory;      // shape (2 column_count + 2 width,)
} ArmReplan;

#endif
