// Arms whose configuration is a function of time, and their bodies that must not touch.
#ifndef RR1_TIMED_ARMS_H
#define RR1_TIMED_ARMS_H

#include "exact_tables.h"

// Joints and columns of q of an arm, and its motion: piecewise polynomials in time, constant before and after.
typedef struct {
    int64_t first_joint;
    int64_t last_joint;
    int64_t first_column;
    int64_t column_count;
    int64_t is_own;       // 1: its motion is in `own_breaks` and `own_coefficients`
    int64_t first_break;  // of `piece_count + 1` increasing ones
    int64_t piece_count;
    int64_t term_count;         // coefficients of a piece, lowest power first
    int64_t first_coefficient;  // of the first column
    int64_t stride;             // numbers of a row of coefficients
    int64_t first_slice;
    int64_t slice_count;  // of equal duration, over its motion; 0 for an own arm
} TimedArm;

// A pair: of two bodies, or of two boxes, each around the bodies that one joint carries.
typedef struct {
    int64_t own_body;
    int64_t arm;  // the other one
    int64_t first_child;
    int64_t last_child;  // pairs of the bodies in two boxes; none for two bodies
} TimedPair;

typedef struct {
    const ExactTables *exact;  // bodies of arms, obstacles, then boxes around bodies
    const TimedArm *arms;      // own arms move along edges
    int64_t arm_count;
    const TimedPair *pairs;
    int64_t first_root;  // pairs from this one on are of boxes
    const int64_t *arm_of_body;  // -1: none
    int64_t first_box;           // bodies from this one on are boxes
    const double *breaks;        // [s]
    const double *coefficients;
    const double *own_breaks;
    const double *own_coefficients;
    Box *slices;       // boxes around all of an arm during a slice of its motion
    double tolerance;  // bodies that pass at less than this beyond the padding are rejected [m]
} TimedScene;

// `free_until` is a time [s] up to which the motion is proven free.
typedef struct {
    int64_t status;
    int64_t pair;
    double free_until;
} TimedResult;

typedef struct {
    ExactScratch *exact;
    int64_t *placed_arm;  // number of the interval for which each arm was last placed
    int64_t *open;        // pairs open on the current interval and on those that contain it
    int64_t open_size;
    int64_t seen;   // intervals so far
    int64_t nodes;  // of the current query
    TimedResult result;
} TimedScratch;

#endif
