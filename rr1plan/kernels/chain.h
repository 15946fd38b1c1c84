// A chain of joints that moves a frame, where the frame has to get, and a search for the configurations that bring it
// there.
#ifndef RR1_CHAIN_H
#define RR1_CHAIN_H

#include <stdint.h>

// A driven joint of a chain; its own axis is z.
typedef struct {
    int64_t prismatic;
    int64_t column;  // of q
} ChainJoint;

// Where a joint's frame is in the one before at zero; the value of the joint is gain q[column] + offset.
typedef struct {
    double rotation[9];  // row by row
    double origin[3];    // [m]
    double gain;
    double offset;
} ChainLink;

typedef struct {
    const ChainJoint *joints;  // base first, shape (joint_count,)
    const ChainLink *links;    // the last one is the frame in the last joint, shape (joint_count + 1,)
    int64_t joint_count;
} Chain;

// The frame's origin has to be in a box, a point if its corners agree.
typedef struct {
    double lower[3];     // [m]
    double upper[3];     // [m]
    double rotation[9];  // row by row
    double weight;       // length that counts like a radian [m]; 0: any rotation will do
} IkTarget;

typedef struct {
    const Chain *chain;
    const IkTarget *target;
    // Of each column of q, shape (nq,): limits, box of random starts, whether whole turns lead to the same place, and
    // the configuration whose nearest copy of a solution is taken.
    const double *lower;
    const double *upper;
    const double *corner;
    const double *extent;
    const double *wraps;
    const double *preferred;
    const double *seeds;  // first starts, within the limits, shape (seed_count, nq)
    int64_t seed_count;
    int64_t column_count;          // nq
    double position_tolerance;     // [m]
    double orientation_tolerance;  // [rad]
    double separation;             // two solutions differ by more than this in some joint
    double *solutions;             // distinct ones so far, with room for one more, shape (solution_count + 1, nq)
    int64_t solution_count;
    int64_t starts;          // so far
    double *nearest;         // where a descent came nearest to the target, shape (nq,)
    double nearest_squared;  // squared error there
    double *memory;          // nq numbers and those of a descent, see `rr1_descent_memory`
} IkSearch;

#endif
