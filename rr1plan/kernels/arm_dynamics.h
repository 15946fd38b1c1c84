// Freely moving arms: rigid bodies in trees of joints, each driven by a servo.
#ifndef RR1_ARM_DYNAMICS_H
#define RR1_ARM_DYNAMICS_H

#include "simd.h"

// A joint of an arm.
typedef struct {
    int64_t parent;     // joint that carries it, an earlier one; -1: the base
    int64_t prismatic;
} DynamicJoint;

// The body that a joint carries, in a frame whose z axis is that of the joint.
typedef struct {
    double rotation[9];  // to the frame of the parent with the joint at zero, row by row
    double origin[3];    // in that frame [m]
    double mass;         // [kg]
    double moment[3];    // mass times center of mass [kg m]
    double inertia[6];   // about the origin: xx, yy, zz, xy, xz, yz [kg m^2]
    double armature;     // inertia of the drive [kg m^2 or kg]
} DynamicBody;

// Servo of one joint in eight arms.
typedef struct {
    f64x8 stiffness;  // [Nm/rad or N/m]
    f64x8 damping;    // [Nm s/rad or N s/m]
    f64x8 effort;     // largest effort, infinite without a limit [Nm or N]
} ServoLanes;

// Gravity in the frames of the bases of eight arms [m/s^2].
typedef struct {
    f64x8 gravity[3];
} BaseLanes;

// Up to eight arms with the same joints and bodies, one in each lane.
typedef struct {
    int64_t first_joint;
    int64_t joint_count;
    int64_t first_servo;
    int64_t arm_count;
    int64_t columns[8];  // of their first joints among those of the simulation; lanes beyond `arm_count` repeat an arm
} ArmLanes;

typedef struct {
    const DynamicJoint *joints;
    const DynamicBody *bodies;
    const ServoLanes *servos;
    const BaseLanes *bases;  // shape (groups,)
    const ArmLanes *arms;    // shape (groups,)
    int64_t column_count;    // joints of the simulation
    double dt;               // [s]
} ArmDynamics;

// A joint in eight arms while a step is computed. Vectors are in the frame of the joint.
typedef struct {
    f64x8 rotation[9];  // to the frame of the parent
    f64x8 origin[3];    // in the frame of the parent
    f64x8 angular[3];   // velocity
    f64x8 angular_acceleration[3];
    f64x8 acceleration[3];  // of the origin, less gravity
    f64x8 force[3];         // exerted by the parent on all bodies that the joint carries, at its origin
    f64x8 torque[3];
    // Of all bodies that the joint carries, as in DynamicBody.
    f64x8 mass;
    f64x8 moment[3];
    f64x8 inertia[6];
    f64x8 position;
    f64x8 velocity;
    f64x8 wanted;  // desired acceleration
    f64x8 right_side;
} JointLanes;

#endif
