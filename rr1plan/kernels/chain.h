// A kinematic chain, the target of its frame, and a search for inverse kinematics solutions.
#ifndef RR1_CHAIN_H
#define RR1_CHAIN_H

#include <stdint.h>

// A driven joint of a chain; its axis is z.
typedef struct {
    int64_t prismatic;
    int64_t column;  // of q
} ChainJoint;

// Pose of a joint relative to the previous joint at zero; the value of the joint is gain q[column] + offset.
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

// Target of a frame: a box for its origin (a point if the corners agree), and a rotation.
typedef struct {
    double lower[3];     // [m]
    double upper[3];     // [m]
    double rotation[9];  // row by row
    double weight;       // weight of the orientation error [m/rad]; 0: free orientation
} IkTarget;

typedef struct {
    const Chain *chain;
    const IkTarget *target;
    // Per column of q, shape (nq,): limits, box of random starts (an extent of 0: the preferred value), whether values
    // are equivalent modulo 2 pi, and the configuration nearest to which a copy of a solution is chosen.
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
    double *nearest;         // configuration with the smallest error so far, shape (nq,)
    double nearest_squared;  // squared error there
    double *memory;          // nq numbers and those of a descent, see `rr1_descent_memory`
} IkSearch;

#endif
