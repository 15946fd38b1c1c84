// What the referee's search reads and writes: a motion, the links it moves, convex bodies and their pairs.
#ifndef RR1_REFEREE_TABLES_H
#define RR1_REFEREE_TABLES_H

#include <stdint.h>

// ---- the arms ----------------------------------------------------------------------------------

enum { MOVE_FIXED, MOVE_TURNS, MOVE_SLIDES };

// A link that some moving joint carries; parents come before children.
typedef struct {
    int64_t child;
    int64_t parent;
    int64_t move;   // what the joint between them does
    int64_t joint;  // its number, -1 if it is fixed or does not move
} LinkStep;

typedef struct {
    double rotation[9];  // of the joint in its parent, row by row
    double shift[3];     // [m]
    double axis[3];
    double gain;  // value of the joint: gain times a column of q, plus an offset
    double offset;
} JointFrame;

typedef struct {
    int64_t column;  // of q
    int64_t before;  // number of the joint before it, -1: none
    int64_t move;
} MovingJoint;

// World pose of a link.
typedef struct {
    double rotation[9];
    double origin[3];
} LinkPose;

// ---- bodies ------------------------------------------------------------------------------------

// A ball is a box without edges, a capsule one with a single edge, each with a rounding. The corners of a hull are
// looked at one by one, those of a table by direction.
// A surface is not convex: triangles, of which three corners each follow each other.
enum { SHAPE_HULL, SHAPE_BOX, SHAPE_CYLINDER, SHAPE_PLANE, SHAPE_TABLE, SHAPE_SURFACE };

typedef struct {
    int64_t shape;
    int64_t first_corner;  // of the columns of `corners`
    int64_t corner_count;  // of a surface: its first node
    int64_t link;
    int64_t first_joint;  // of `chains`
    int64_t depth;        // joints that carry it
} RefereeBody;

// Sizes of a body; of a half-space `half` is its world normal and `rounding` its offset along it.
typedef struct {
    double half[3];  // half edges of a box; radius, radius and half length of a cylinder [m]
    double rounding;  // radius around that [m]
    double radius;    // of the ball around all [m]
    double box[3];    // half edges of the bounding box [m]
    double center[3];  // of that in the link's frame [m]
    double rotation[9];  // of the shape in the link's frame
    double origin[3];
} BodySizes;

// World pose of a body, and the center of its bounding ball.
typedef struct {
    double rotation[9];
    double origin[3];
    double middle[3];
} PlacedBody;

// Cells of directions: on each face of a cube SIDE by SIDE; see `support_tables.py`.
enum { SUPPORT_SIDE = 4, SUPPORT_CELLS = 96 };

// The box around the triangles of a node of a surface.
typedef struct {
    double center[3];  // in the frame of the surface [m]
    double half[3];
} SurfaceBox;

// A node of a surface, before those below it; nodes and triangles are counted from the first of the surface.
typedef struct {
    int64_t next;   // the next node that is not below it
    int64_t first;  // triangle of a leaf, elsewhere equal to `last`
    int64_t last;
} SurfaceNode;

typedef struct {
    const RefereeBody *bodies;
    const BodySizes *sizes;
    const double *corners;  // rows x, y, z; and of a table where the corners of each cell begin; shape (4, corner_count)
    const SurfaceBox *boxes;  // of the nodes of all surfaces
    const SurfaceNode *nodes;
    int64_t body_count;
    int64_t corner_count;
} RefereeBodies;

// ---- pairs -------------------------------------------------------------------------------------

// Pairs in two groups, whose smallest clearances are told apart: with the surroundings, and one arm's own.
enum { PAIR_GROUPS = 2 };

// Two bodies of a pair of elements; a half-space comes second.
typedef struct {
    int64_t a;
    int64_t b;
    int64_t elements;  // the pair of elements
    int64_t shared;    // joints of their chains that carry both
    int64_t last_a;    // last joint of each body, -1: none
    int64_t last_b;
    int64_t group;
} RefereePair;

enum { PAIR_FREE, PAIR_LEFT, PAIR_UNDECIDED };

// What is found of a pair of elements.
typedef struct {
    double seen;    // smallest clearance seen [m]
    double when;    // its time [s]
    double proven;  // proven clearance [m]
} PairFindings;

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

// ---- the search --------------------------------------------------------------------------------

enum { SEARCH_START, SEARCH_SPLIT, SEARCH_DONE };
// Intervals that are open at once: with halving, one for each level.
enum { SEARCH_DEPTH = 160 };

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

// World axis of a moving joint, and what it does within an interval.
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

// Range of a column of q on a piece.
typedef struct {
    double low, high;
} ColumnRange;

// How far a body reaches from a joint of its chain (1 for a sliding joint), and how far that joint and those after it
// carry it.
typedef struct {
    double reach;
    double carried;
} Sweep;

typedef struct {
    const double *breaks;        // times of the pieces' ends [s], shape (piece_count + 1,), or (1,) for no duration
    const double *coefficients;  // of each piece, lowest power first, shape (piece_count, terms, column_count)
    int64_t break_count;
    int64_t piece_count;
    int64_t terms;
    int64_t column_count;
    const LinkStep *steps;
    const JointFrame *frames;
    const MovingJoint *joints;
    int64_t step_count;
    int64_t joint_count;
    const RefereeBodies *bodies;
    const int64_t *chains;  // joints that carry each body, one body after the other
    const int64_t *movers;  // bodies that move
    int64_t mover_count;
    const RefereePair *pairs;
    const double *padding;  // distance to keep [m]
    int64_t pair_count;
    double tolerance;   // smallest clearances are found within this [m]
    double touch;       // a clearance up to this is a contact [m]
    int64_t max_searches;  // before what is open is left undecided
    // Scratch.
    LinkPose *links;
    ColumnMotion *columns;
    ColumnRange *ranges;  // shape (piece_count, column_count)
    JointState *states;   // shape (joint_count + 1,): the last one is at rest
    PlacedBody *placed;
    Sweep *sweeps;        // shape (bodies, sweep_stride)
    int64_t sweep_stride;  // longest chain + 1
    double *terms_scratch;  // shape (terms,)
    GjkState *gjk;        // of each pair
    // What is found.
    PairFindings *found;     // of each pair of elements
    int64_t *marks;          // of each pair of elements
    KnownDirection *directions;  // of each pair
    TimeInterval *intervals;     // shape (SEARCH_DEPTH,)
    int64_t *items;              // shape (pair_count * SEARCH_DEPTH,)
    int64_t stage;
    int64_t open;            // intervals that are open
    int64_t interval_count;  // looked at so far
    int64_t check_count;     // pairs on intervals
    int64_t search_count;    // for directions
    int64_t nearest[2];      // pair with the smallest clearance of each group, -1: none
    double smallest[2];      // that clearance [m]
    double decided;          // time that is decided, summed over pairs [s]
    double end_clearance[4];  // smallest at the begin and the end, group by group [m]
    int64_t end_pair[4];      // their pairs of elements, -1: none
} RefereeSearch;

#endif
