// Input and output of the referee's search: a motion, models of robots, arms as instances of them, pairs of bodies.
#ifndef RR1_REFEREE_TABLES_H
#define RR1_REFEREE_TABLES_H

#include <stdint.h>

// ---- models of robots --------------------------------------------------------------------------

// A robot, independent of where its base is: joints, bodies on the links, elements that reports name, and the pairs of
// elements that must not touch. All obstacles of a scene together are a model without joints. Link 0 is the base; joint
// j moves link j + 1. Links that are fixed to each other are one.

enum { MOVE_TURNS, MOVE_SLIDES };

// Joints come after the joints that carry them.
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

// A ball is a box without extent, a capsule a box with extent along one axis, both with a rounding radius. The corners
// of a hull are tested one by one, those of a table by direction. For a surface, every three corners are a triangle;
// for cells, each corner is the center of a cube of half edge `half`. Surfaces and cells have a tree of boxes around
// their parts.
enum { SHAPE_HULL, SHAPE_BOX, SHAPE_CYLINDER, SHAPE_PLANE, SHAPE_TABLE, SHAPE_SURFACE, SHAPE_CELLS };
// Bits of a triangle of a surface: its part encloses a volume, it is the first one of its part, the orientations of the
// surface's faces are inconsistent.
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

// Sizes of a body; for a half-space, `half` is its normal and `rounding` its offset along the normal.
typedef struct {
    double half[3];  // half edges of a box; radius, radius and half length of a cylinder [m]
    double rounding;  // rounding radius around the shape of `half` [m]
    double radius;    // of the bounding ball [m]
    double box[3];    // half edges of the bounding box [m]
    double center[3];  // of the bounding box in the link's frame [m]
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

// Cells of directions: SIDE x SIDE on each face of a cube; see `hull_support.py`.
enum { SUPPORT_SIDE = 4, SUPPORT_CELLS = 96 };

// The box around the parts of a node: triangles of a surface, or cells.
typedef struct {
    double center[3];  // in the frame of the body [m]
    double half[3];
} SurfaceBox;

// A node, in depth-first order; nodes and parts are counted from the first of the body.
typedef struct {
    int64_t next;   // the next node outside its subtree
    int64_t first;  // part of a leaf; equal to `last` in other nodes
    int64_t last;
} SurfaceNode;

typedef struct {
    const RefereeBody *bodies;
    const BodySizes *sizes;
    // Rows x, y, z, and a fourth one: for a table, where the corners of each cell begin; for a surface, the bits of its
    // triangles. Shape (4, corner_count).
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
    int64_t base_element;        // that of the base link, which is not checked against obstacles; -1: none
    const uint8_t *own_checked;  // element pairs that must not touch, shape (element_count, element_count); or NULL
} RefereeModel;

// ---- the scene ---------------------------------------------------------------------------------

// An instance of a model. Moving arms come first, then stationary arms, then the obstacles as one instance.
typedef struct {
    int64_t model;
    int64_t first_column;  // of `arm_columns`
    int64_t first_link;
    int64_t first_joint;
    int64_t first_body;
    int64_t first_element;
} RefereeArm;

// Distances to keep between the elements of two owners, where they differ from the general one.
typedef struct {
    int64_t key;    // first owner times the number of owners, plus the second, which is no smaller
    int64_t first;  // of `paddings`: a row for each element of the first owner; negative where contact is allowed
} PaddingRule;

// Axis-aligned box.
typedef struct {
    double low[3];
    double high[3];
} BoundingBox;

// A stationary owner, by its lower end along x [m].
typedef struct {
    double low;
    int64_t owner;
} SortedOwner;

// ---- pairs -------------------------------------------------------------------------------------

// Pairs are in two groups with separate smallest clearances: with the surroundings, and within an arm.
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

// A pair of elements, and the results for it.
typedef struct {
    int64_t a;
    int64_t b;
    int64_t mark;
    int64_t pair;  // of bodies, with the smallest clearance seen
    double seen;   // that clearance [m]; negative for a depth
    double when;   // its time [s]
    double first;  // first contact seen [s]; INFINITY: none
} ElementPair;

// A direction from a to b along which the bodies are apart.
typedef struct {
    double x, y, z;
    double known;  // 1 if there is one, 0 if not
} KnownDirection;

// Points of two bodies that are farthest along a direction and against it, and their difference in world coordinates.
typedef struct {
    double in_a[3];
    double in_b[3];
    double difference[3];
} PointPair;

// The state of a search for a direction, from which the next one starts.
typedef struct {
    PointPair points[5];
    int64_t count;
} GjkState;

// ---- extremes ----------------------------------------------------------------------------------

// Capacity for open intervals.
enum { EXTREMES_DEPTH = 80 };

// Extremes of a column: highest value, its time, lowest value, its time.
typedef struct {
    double high, high_time, low, low_time;
} Peaks;

// Between two pieces.
typedef struct {
    double size, time;
} Jump;

// ---- limits ------------------------------------------------------------------------------------

// Rows of the table of limits, and of the largest used fractions; velocity, acceleration and jerk are rows 1 to 3.
enum { LIMIT_LOWER, LIMIT_VELOCITY, LIMIT_ACCELERATION, LIMIT_JERK, LIMIT_UPPER, LIMIT_ROWS };
enum { TIGHTEST_POSITION, TIGHTEST_VELOCITY, TIGHTEST_ACCELERATION, TIGHTEST_JERK, TIGHTEST_ROWS };
// Flaws of a column: bits.
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

// The largest used fraction of a limit, its column and its time.
typedef struct {
    double ratio;  // -inf where no column has a limit
    double column;
    double time;
} Tightest;

// ---- the search --------------------------------------------------------------------------------

enum { SEARCH_START, SEARCH_STATIONARY, SEARCH_MOVING, SEARCH_DONE };
// Pairs of a moving arm with itself and all stationary owners, and with other moving arms.
enum { PASS_STATIONARY, PASS_MOVING };
// Capacity for open intervals: with halving, one for each level.
enum { SEARCH_DEPTH = 160 };
// Pairs of bodies that are searched together, unless two owners have more.
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

// World axis of a joint, and its motion within an interval.
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

// A column of q on a piece: its values at both ends, and its deviation from the straight line between them.
typedef struct {
    double begin, end, bulge;
} ColumnChord;

// Distance that a body reaches from a joint of its chain (1 for a sliding joint), and how far that joint and those
// after it can carry it.
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
    const int64_t *columns_of_q;  // columns of the moving arms, one arm after the other
    const double *configurations;      // columns of the stationary arms, one arm after the other [rad or m]
    const double *base_poses;    // T_world_base of each arm, shape (arms, 4, 4)
    const int64_t *own_arms;     // stationary arms whose own pairs are checked: those without an equal earlier one
    int64_t own_arm_count;
    int64_t moving_count;    // moving arms
    int64_t stationary_count;  // stationary arms
    double padding;       // distance to keep without a rule [m]
    double most_padding;  // the largest one [m]
    const PaddingRule *rules;  // by ascending keys
    int64_t rule_count;
    const double *paddings;
    // Options.
    int64_t with_clearance;  // find smallest clearances as well as contacts
    double tolerance;        // tolerance of smallest clearances and largest depths [m],
    double share;            // or this fraction of a clearance, and a twentieth of a depth, if that is more
    double touch;            // a clearance up to this is a contact [m]
    int64_t max_searches;    // for a chunk of pairs, before open pairs are left undecided
    // Counts that follow from these, and memory provided by the caller; see `memory.c`.
    int64_t owner_count;
    int64_t element_count;
    int64_t joint_count;
    int64_t link_count;
    int64_t body_count;
    RefereeArm *arms;      // shape (arms + 1,)
    int64_t *arm_columns;  // columns of each arm: of q, then those of stationary arms
    LinkPose *bases;       // of each arm
    LinkPose *links;
    ColumnMotion *columns;  // those of q, then the configurations of stationary arms
    ColumnChord *chords;    // shape (column_count, piece_count)
    JointState *states;     // shape (joint_count + 1,): the last one is stationary
    PlacedBody *placed;
    Sweep *sweeps;          // of bodies of moving arms, shape (bodies, sweep_stride)
    int64_t sweep_stride;   // longest chain + 1
    int64_t *placed_on;     // of these bodies: number of the interval on which each was last placed
    double *terms_scratch;  // shape (terms,)
    BoundingBox *element_boxes;  // at one time, shape (element_count,)
    BoundingBox *owner_boxes;    // shape (owner_count,)
    BoundingBox *element_slices;  // over each slice of the motion, shape (MOTION_SLICES, element_count)
    BoundingBox *owner_slices;    // shape (MOTION_SLICES, owner_count)
    BoundingBox *owner_sweeps;    // over the whole motion, shape (owner_count,)
    SortedOwner *sorted;          // stationary owners, shape (owner_count,)
    int64_t sorted_count;         // bounded ones; the others come after them
    double widest;                // the longest of the bounded ones along x [m]
    int64_t *near_owners;         // scratch, shape (owner_count,)
    TimeInterval *slices;         // shape (MOTION_SLICES,)
    int64_t slice_count;
    // A chunk of pairs: the bodies of an arm, or of two, that are near each other.
    RefereePair *pairs;  // shape (pair_room + PAIR_GROUPS + 1,): after the chunk the nearest of each group, and a spare one
    ElementPair *elements;       // likewise
    GjkState *gjk;               // likewise
    KnownDirection *directions;  // likewise
    int64_t *items;              // shape (pair_room * SEARCH_DEPTH,)
    TimeInterval *intervals;     // shape (SEARCH_DEPTH,)
    int64_t pair_room;
    int64_t pair_count;
    int64_t element_pair_count;
    int64_t chunk_arms[2];  // its moving arms, -1: none
    int64_t chunk_searches;
    int64_t chunk_depths;  // searches for depths of contacts
    int64_t chunk_slices;  // mask of the slices left to search
    double chunk_work;     // its work: pairs of bodies times seconds
    int64_t open;          // intervals that are open
    // State of the search.
    int64_t stage;
    int64_t arm;      // the arm whose pairs are next
    int64_t partner;  // owner that is compared with it next
    int64_t pass;
    // Results.
    ElementPair *marked;  // pairs of elements of the last chunks with a mark, shape (pair_room,)
    int64_t marked_count;
    int64_t sharpened_count;  // contacts with a refined largest depth
    int64_t interval_count;  // visited so far
    int64_t check_count;     // pairs on intervals
    int64_t search_count;    // for directions
    int64_t depth_count;     // those of them for depths of contacts
    int64_t has_nearest[2];  // whether a smallest clearance of each group is known
    double smallest[2];      // that clearance, or 0 with a contact to report [m]
    double proven[2];        // lower bound of it [m]
    double refined[2];       // the smallest clearance that was refined last [m]
    double decided;          // decided work of the chunk: pairs of bodies times seconds
    ElementPair ends[2];     // pair with the smallest clearance to the surroundings at the start and at the end
} RefereeSearch;

#endif
