// What the referee's search reads and writes: a motion, models of robots, arms that are instances of them, and pairs of
// convex bodies.
#ifndef RR1_REFEREE_TABLES_H
#define RR1_REFEREE_TABLES_H

#include <stdint.h>

// ---- models of robots --------------------------------------------------------------------------

// What a robot is, wherever its base is: joints, bodies on the links, elements that are named in reports, and the pairs of
// them that must not touch. All obstacles of a scene together are a model without joints. Link 0 is the base; joint j moves
// link j + 1, and links that no joint moves against another one are part of that.

enum { MOVE_TURNS, MOVE_SLIDES };

// Joints come after those that carry them.
typedef struct {
    int64_t parent;  // link that carries it
    int64_t move;
    int64_t column;  // of the model's own columns
} ArmJoint;

typedef struct {
    double rotation[9];  // of the joint in its parent, row by row
    double shift[3];     // [m]
    double axis[3];
    double gain;  // value of the joint: gain times a column, plus an offset
    double offset;
} JointFrame;

// Pose of a link.
typedef struct {
    double rotation[9];
    double origin[3];
} LinkPose;

// ---- bodies ------------------------------------------------------------------------------------

// A ball is a box without edges, a capsule one with a single edge, each with a rounding. The corners of a hull are
// looked at one by one, those of a table by direction.
// Of a surface each three corners are a triangle, of cells each corner is the center of a cube of half edge `half`; these
// two have a tree of boxes around their parts.
enum { SHAPE_HULL, SHAPE_BOX, SHAPE_CYLINDER, SHAPE_PLANE, SHAPE_TABLE, SHAPE_SURFACE, SHAPE_CELLS };
// Bits of a triangle of a surface: it is of a part that encloses something, the first one of its part, and the faces of
// the surface do not agree about the outside.
enum { FACE_CLOSED = 1, FACE_FIRST = 2, FACE_MIXED = 4 };

typedef struct {
    int64_t shape;
    int64_t first_corner;  // of the columns of `corners`
    int64_t corner_count;
    int64_t link;
    int64_t first_joint;  // of `chains` of its model
    int64_t depth;        // joints that carry it
    int64_t first_node;   // of a surface, or of cells
} RefereeBody;

// Sizes of a body; of a half-space `half` is its normal and `rounding` its offset along it.
typedef struct {
    double half[3];  // half edges of a box; radius, radius and half length of a cylinder [m]
    double rounding;  // radius around that [m]
    double radius;    // of the ball around all [m]
    double box[3];    // half edges of the bounding box [m]
    double center[3];  // of that in the link's frame [m]
    double rotation[9];  // of the shape in the link's frame
    double origin[3];
} BodySizes;

// A shape in its own frame; see `core_row` in `referee_shapes.py`.
typedef struct {
    double shape;
    double corner_count;
    double columns;  // of `corners`
    double half[3];
    double rounding;
    double radius;
    double box[3];
    double center[3];
} ShapeRow;

// World pose of a body, and the center of its bounding ball.
typedef struct {
    double rotation[9];
    double origin[3];
    double middle[3];
} PlacedBody;

// Cells of directions: on each face of a cube SIDE by SIDE; see `hull_support.py`.
enum { SUPPORT_SIDE = 4, SUPPORT_CELLS = 96 };

// The box around the parts of a node: triangles of a surface, or cells.
typedef struct {
    double center[3];  // in the frame of the body [m]
    double half[3];
} SurfaceBox;

// A node, before the two below it and those below them; nodes and parts are counted from the first of the body.
typedef struct {
    int64_t next;   // the next node that is not below it
    int64_t first;  // part of a leaf, elsewhere equal to `last`
    int64_t last;
} SurfaceNode;

typedef struct {
    const RefereeBody *bodies;
    const BodySizes *sizes;
    // Rows x, y, z; and of a table where the corners of each cell begin, of a surface the bits of its triangle; shape
    // (4, corner_count).
    const double *corners;
    const SurfaceBox *boxes;  // of all nodes
    const SurfaceNode *nodes;
    int64_t body_count;
    int64_t corner_count;
} RefereeBodies;

typedef struct {
    const ArmJoint *joints;
    const JointFrame *frames;
    int64_t joint_count;
    int64_t column_count;
    const RefereeBodies *bodies;
    const int64_t *chains;          // joints that carry each body, one body after the other
    const int64_t *element_bodies;  // first body of each element, shape (element_count + 1,)
    int64_t element_count;
    int64_t base_element;        // that of the base link, which no obstacle is checked against; -1: none
    const uint8_t *own_checked;  // which pairs of its elements must not touch, shape (element_count, element_count); or NULL
} RefereeModel;

// ---- the scene ---------------------------------------------------------------------------------

// An instance of a model. Arms that move come first, then those that stand still, then the obstacles as a single one.
typedef struct {
    int64_t model;
    int64_t first_column;  // of `arm_columns`
    int64_t first_link;
    int64_t first_joint;
    int64_t first_body;
    int64_t first_element;
} RefereeArm;

// Distances to keep between the elements of two owners that differ from the general one.
typedef struct {
    int64_t key;    // first owner times the number of owners, plus the second, which is no smaller
    int64_t first;  // of `paddings`: a row for each element of the first owner; below zero where contact is allowed
} PaddingRule;

// Upright box.
typedef struct {
    double low[3];
    double high[3];
} BoundingBox;

// An owner that stands still, by where it begins along x [m].
typedef struct {
    double low;
    int64_t owner;
} SortedOwner;

// ---- pairs -------------------------------------------------------------------------------------

// Pairs in two groups, whose smallest clearances are reported apart: with the surroundings, and one arm's own.
enum { PAIR_GROUPS = 2, GROUP_OTHERS = 0, GROUP_OWN = 1 };

// Two bodies of a pair of elements; a half-space comes second.
typedef struct {
    int64_t a;  // of `placed`
    int64_t b;
    int64_t arm_a;
    int64_t arm_b;
    int64_t body_a;  // of the arm's model
    int64_t body_b;
    int64_t elements;  // the pair of elements
    int64_t shared;    // joints of their chains that carry both
    int64_t before;    // the last of those that moves, -1: none
    int64_t last_a;    // last joint that carries each body and moves, -1: none
    int64_t last_b;
    int64_t group;
    int64_t slices;  // mask of the slices of the motion on which they can come near
    double padding;  // distance to keep [m]
} RefereePair;

enum { PAIR_FREE, PAIR_TOUCHES, PAIR_UNDECIDED };

// A pair of elements and what is found of it.
typedef struct {
    int64_t a;
    int64_t b;
    int64_t mark;
    int64_t pair;  // of bodies, with the smallest clearance seen
    double seen;   // that clearance [m]; below zero a depth
    double when;   // its time [s]
    double first;  // first contact seen [s]; INFINITY: none
} ElementPair;

// A direction from a to b along which they are apart.
typedef struct {
    double x, y, z;
    double known;  // 1 if there is one, 0 if not
} KnownDirection;

// Points of two bodies that are farthest along a direction and against it, and their difference in the world.
typedef struct {
    double in_a[3];
    double in_b[3];
    double difference[3];
} PointPair;

// A search for a direction, to be started from where it ended last.
typedef struct {
    PointPair points[5];
    int64_t count;
} GjkState;

// ---- extremes ----------------------------------------------------------------------------------

// Intervals that are open at once.
enum { EXTREMES_DEPTH = 80 };

// What a column reaches: highest value, its time, lowest value, its time.
typedef struct {
    double high, high_time, low, low_time;
} Peaks;

// Between two pieces.
typedef struct {
    double size, time;
} Jump;

// ---- limits ------------------------------------------------------------------------------------

// Rows of the table of limits, and of the largest shares of limits used; velocity, acceleration and jerk are rows 1 to 3.
enum { LIMIT_LOWER, LIMIT_VELOCITY, LIMIT_ACCELERATION, LIMIT_JERK, LIMIT_UPPER, LIMIT_ROWS };
enum { TIGHTEST_POSITION, TIGHTEST_VELOCITY, TIGHTEST_ACCELERATION, TIGHTEST_JERK, TIGHTEST_ROWS };
// What is wrong with a column: bits.
enum {
    FLAW_ABOVE = 1,
    FLAW_BELOW = 2,
    FLAW_VELOCITY = 4,
    FLAW_ACCELERATION = 8,
    FLAW_JERK = 16,
    FLAW_POSITION_JUMP = 32,
    FLAW_VELOCITY_JUMP = 64,
    FLAW_ACCELERATION_JUMP = 128,
    FLAW_START = 256,
    FLAW_END = 512
};

// The largest share of a limit that is used, its column and its time.
typedef struct {
    double ratio;  // -inf where no column has a limit
    double column;
    double time;
} Tightest;

// ---- the search --------------------------------------------------------------------------------

enum { SEARCH_START, SEARCH_STATIONARY, SEARCH_MOVING, SEARCH_DONE };
// Pairs of an arm that moves with itself and all that stands still, and with other arms that move.
enum { PASS_STATIONARY, PASS_MOVING };
// Intervals that are open at once: with halving, one for each level.
enum { SEARCH_DEPTH = 160 };
// Pairs of bodies that are searched at once, unless those of two owners are more.
enum { SEARCH_CHUNK = 4096 };
// The broad phase cuts the whole motion into at most this many intervals.
enum { MOTION_SLICES = 8 };

// An interval of time: several pieces of the motion, or a part of a single one.
typedef struct {
    int64_t first;
    int64_t stop;  // one past the last
    int64_t low;   // of `items`: the pairs that are open on it
    int64_t high;
    double begin;  // local times on a single piece [s]
    double end;
} TimeInterval;

// Bounds of a column of q within an interval.
typedef struct {
    double value;
    double change;  // largest change from that
    double rest;    // largest deviation from a steady speed
    double speed;
} ColumnMotion;

// World axis of a joint, and what it does within an interval.
typedef struct {
    double axis[3];
    double pivot[3];
    double change;
    double rest;
    double speed;
    // Velocity of the bodies it carries, under all joints up to it: angular, and of the point at the world's origin.
    double angular[3];
    double linear[3];
} JointState;

// A column of q on a piece: its values at both ends, and how far it gets from the straight line between them.
typedef struct {
    double begin, end, bulge;
} ColumnChord;

// How far a body reaches from a joint of its chain (1 for a sliding joint), and how far that joint and those after it
// carry it.
typedef struct {
    double reach;
    double carried;
} Sweep;

typedef struct {
    // The motion.
    const double *breaks;        // times of the pieces' ends [s], shape (piece_count + 1,), or (1,) for no duration
    const double *coefficients;  // of each piece, lowest power first, shape (piece_count, terms, column_count)
    int64_t break_count;
    int64_t piece_count;
    int64_t terms;
    int64_t column_count;
    // The scene. Owners are the arms, then each obstacle.
    const RefereeModel *models;
    const int64_t *arm_models;   // model of each arm, and that of the obstacles
    const int64_t *columns_of_q;  // columns of each arm that moves, one after the other
    const double *configurations;      // columns of the arms that stand still, one after the other [rad or m]
    const double *base_poses;    // T_world_base of each arm, shape (arms, 4, 4)
    const int64_t *own_arms;     // arms that stand still and whose own pairs no earlier one has in the same configuration
    int64_t own_arm_count;
    int64_t moving_count;    // arms that move
    int64_t stationary_count;  // arms that stand still
    double padding;       // distance to keep where no rule says otherwise [m]
    double most_padding;  // the largest one [m]
    const PaddingRule *rules;  // by ascending keys
    int64_t rule_count;
    const double *paddings;
    // What is looked for.
    int64_t with_clearance;  // whether the smallest clearances are, besides contacts
    double tolerance;        // smallest clearances and largest depths are found within this [m],
    double share;            // or this share of a clearance, and a twentieth of a depth, if that is more
    double touch;            // a clearance up to this is a contact [m]
    int64_t max_searches;    // of a chunk of pairs, before what is open is left undecided
    // Counts that follow from these, and memory that the caller gives; see `memory.c`.
    int64_t owner_count;
    int64_t element_count;
    int64_t joint_count;
    int64_t link_count;
    int64_t body_count;
    RefereeArm *arms;      // shape (arms + 1,)
    int64_t *arm_columns;  // columns of each arm: of q, and those of arms that stand still after them
    LinkPose *bases;       // of each arm
    LinkPose *links;
    ColumnMotion *columns;  // those of q, then the configurations of arms that stand still
    ColumnChord *chords;    // shape (column_count, piece_count)
    JointState *states;     // shape (joint_count + 1,): the last one is at rest
    PlacedBody *placed;
    Sweep *sweeps;          // of bodies of arms that move, shape (bodies, sweep_stride)
    int64_t sweep_stride;   // longest chain + 1
    int64_t *placed_on;     // of the same bodies: number of the interval on which each was placed last
    double *terms_scratch;  // shape (terms,)
    BoundingBox *element_boxes;  // at one time, shape (element_count,)
    BoundingBox *owner_boxes;    // shape (owner_count,)
    BoundingBox *element_slices;  // over each slice of the motion, shape (MOTION_SLICES, element_count)
    BoundingBox *owner_slices;    // shape (MOTION_SLICES, owner_count)
    BoundingBox *owner_sweeps;    // over the whole motion, shape (owner_count,)
    SortedOwner *sorted;          // owners that stand still, shape (owner_count,)
    int64_t sorted_count;         // without those that are not bounded, which come after them
    double widest;                // the longest of the bounded ones along x [m]
    int64_t *near_owners;         // scratch, shape (owner_count,)
    TimeInterval *slices;         // shape (MOTION_SLICES,)
    int64_t slice_count;
    // A chunk of pairs: the bodies of an arm, or of two, that are near each other.
    RefereePair *pairs;  // shape (pair_room + PAIR_GROUPS + 1,): after the chunk the nearest of each group, and a spare one
    ElementPair *elements;       // the same
    GjkState *gjk;               // the same
    KnownDirection *directions;  // the same
    int64_t *items;              // shape (pair_room * SEARCH_DEPTH,)
    TimeInterval *intervals;     // shape (SEARCH_DEPTH,)
    int64_t pair_room;
    int64_t pair_count;
    int64_t element_pair_count;
    int64_t chunk_arms[2];  // arms of it that move, -1: none
    int64_t chunk_searches;
    int64_t chunk_depths;  // searches for depths of contacts
    int64_t chunk_slices;  // mask of the slices that are to be searched
    double chunk_work;     // what is to be decided of it: pairs of bodies times seconds
    int64_t open;          // intervals that are open
    // Where the search is.
    int64_t stage;
    int64_t arm;      // whose pairs are next
    int64_t partner;  // owner that it is compared with next
    int64_t pass;
    // What is found.
    ElementPair *marked;  // pairs of elements of the last chunks with a mark, shape (pair_room,)
    int64_t marked_count;
    int64_t sharpened_count;  // contacts of which the worst depth is refined
    int64_t interval_count;  // looked at so far
    int64_t check_count;     // pairs on intervals
    int64_t search_count;    // for directions
    int64_t depth_count;     // those of them for depths of contacts
    int64_t has_nearest[2];  // whether a smallest clearance of each group is known
    double smallest[2];      // that clearance, or 0 with a contact to report [m]
    double proven[2];        // lower bound of it [m]
    double refined[2];       // the one around whose time a smaller one was looked for last [m]
    double decided;          // what is decided of the chunk: pairs of bodies times seconds
    ElementPair ends[2];     // pair with the smallest clearance to the surroundings at the begin and at the end
} RefereeSearch;

#endif
