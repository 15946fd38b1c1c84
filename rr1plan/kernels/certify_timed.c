// A motion of some arms among others that follow their own motions, certified in continuous time.
//
// The certificate is that of certify_curve.c, with time as the parameter of all motions: on an interval of time, two
// bodies stay apart if their gap in the middle exceeds the sum of their largest displacements from there. Intervals are
// halved until that is proven; the earlier half comes first, so that everything before the current interval is proven.
//
// Boxes around an arm in slices of time are tested before forward kinematics, and boxes around all bodies that one
// joint carries before single bodies.
#include "scene_tables.h"
#include "timed_arms.h"

// If bodies move less than this, they are tested one by one instead of the boxes around them [m].
#define BODIES_BELOW 0.1
// Intervals with a smaller half width [s] are not halved: the motion has a jump there, or impossible speeds.
#define SHORTEST_HALF 1e-10

// The motion of an arm as polynomials.
typedef struct {
    const double *breaks;
    const double *coefficients;
} TimedPolynomials;

INLINE TimedPolynomials polynomials_of(const TimedArm *arm, const TimedScene *scene) {
    if (arm->is_own)
        return (TimedPolynomials){scene->own_breaks + arm->first_break,
                                  scene->own_coefficients + arm->first_coefficient};
    return (TimedPolynomials){scene->breaks + arm->first_break, scene->coefficients + arm->first_coefficient};
}

INLINE double clamp_number(double value, double low, double high) {
    return min_number(max_number(value, low), high);
}

// The piece at a time within the motion; at a break the later one.
static int64_t piece_at(double time, const double *breaks, int64_t count) {
    int64_t low = 0, high = count;
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (breaks[middle] <= time) low = middle;
        else high = middle;
    }
    return low;
}

// Configuration of an arm in the middle of an interval of time, and the largest change of each column on the interval.
static void place_columns(const TimedArm *arm, double middle, double half, const TimedScene *scene,
                          ExactScratch *scratch) {
    TimedPolynomials motion = polynomials_of(arm, scene);
    const double *breaks = motion.breaks;
    int64_t terms = arm->term_count, pieces = arm->piece_count;
    double start = breaks[0], end = breaks[pieces], *at = scratch->coefficients;
    // Rounding errors of times are included in the interval.
    half += 8.0 * EPSILON * (abs_number(middle) + half + abs_number(start) + abs_number(end));
    double now = clamp_number(middle, start, end);
    double low = clamp_number(middle - half, start, end), high = clamp_number(middle + half, start, end);
    double *q = scratch->q + arm->first_column, *reach = scratch->reach + arm->first_column;
    int64_t piece = piece_at(now, breaks, pieces), first = piece_at(low, breaks, pieces);
    const double *row = motion.coefficients + piece * terms * arm->stride;
    double local = now - breaks[piece];
    for (int64_t j = 0; j < arm->column_count; j++) {
        double value = row[(terms - 1) * arm->stride + j];
        for (int64_t k = terms - 2; k >= 0; k--) value = value * local + row[k * arm->stride + j];
        q[j] = value;
        reach[j] = 0.0;
    }
    for (int64_t i = first; i < pieces && (i == first || breaks[i] < high); i++) {
        double from = max_number(low, breaks[i]) - breaks[i], to = min_number(high, breaks[i + 1]) - breaks[i];
        double center = 0.5 * (from + to), radius = 0.5 * (to - from), size = center + radius;
        row = motion.coefficients + i * terms * arm->stride;
        for (int64_t j = 0; j < arm->column_count; j++) {
            double total = 0.0, power = 1.0, bound = 0.0;
            for (int64_t k = 0; k < terms; k++) {
                at[k] = row[k * arm->stride + j];
                total += abs_number(at[k]) * power;
                power *= size;
            }
            // Taylor's coefficients at the center, by repeated division.
            for (int64_t begin = 0; begin < terms - 1; begin++)
                for (int64_t k = terms - 2; k >= begin; k--) at[k] += center * at[k + 1];
            for (int64_t k = terms - 1; k > 0; k--) bound = (bound + abs_number(at[k])) * radius;
            bound = (bound + abs_number(at[0] - q[j])) * SLACK + 8.0 * (double)terms * (double)terms * EPSILON * total;
            reach[j] = max_number(reach[j], bound);
        }
    }
}

// Place the joints of an arm for an interval, unless this is done already.
static void place_arm(int64_t number, double middle, double half, int64_t seen, const TimedScene *scene,
                      TimedScratch *scratch) {
    if (number < 0 || scratch->placed_arm[number] == seen) return;
    const TimedArm *arm = &scene->arms[number];
    scratch->placed_arm[number] = seen;
    place_columns(arm, middle, half, scene, scratch->exact);
    place_joint_range(arm->first_joint, arm->last_joint, scratch->exact->q, scene->exact, scratch->exact);
}

// Place a body and bound its displacement on an interval, unless this is done already; its arm is placed.
INLINE double timed_travel(int64_t body, int64_t seen, const TimedScene *scene, ExactScratch *scratch) {
    if (!moves(&scene->exact->bodies[body])) return 0.0;
    ready_body(body, seen, scene->exact, scratch);
    return scratch->travel[body * scratch->travel_stride];
}

// The box around a whole arm on an interval of time, from the slices of its motion.
static Box box_on(const TimedArm *arm, double middle, double half, const TimedScene *scene) {
    const double *breaks = scene->breaks + arm->first_break;
    double start = breaks[0], end = breaks[arm->piece_count], last = (double)(arm->slice_count - 1);
    double per_second = end > start ? (double)arm->slice_count / (end - start) : 0.0;
    // Slices overlap by a millionth, so that times on a border may be rounded to either side.
    int64_t first = (int64_t)clamp_number((middle - half - start) * per_second - 1e-6, 0.0, last);
    int64_t final = (int64_t)clamp_number((middle + half - start) * per_second + 1e-6, 0.0, last);
    Box box = scene->slices[arm->first_slice + first];
    for (int64_t i = first + 1; i <= final; i++) {
        const Box *next = &scene->slices[arm->first_slice + i];
        for (int k = 0; k < 3; k++) {
            box.low[k] = min_number(box.low[k], next->low[k]);
            box.high[k] = max_number(box.high[k], next->high[k]);
        }
    }
    return box;
}

// Distance of a point to a box [m].
INLINE double slice_distance(const Vec3 *point, const Box *box) {
    const double at[3] = {point->x, point->y, point->z};
    double square = 0.0;
    for (int k = 0; k < 3; k++) {
        double out = max_number(0.0, max_number(box->low[k] - at[k], at[k] - box->high[k]));
        square += out * out;
    }
    return sqrt_number(square);
}

// The current interval: its number, and the position of its open pairs in the list.
typedef struct {
    double middle;
    double half;
    int64_t seen;
    int64_t tail;      // one past the last open pair
    int64_t touching;  // a pair in contact in the middle, -1: none
    int find_first;    // continue halving until the first contact is found
} TimedInterval;

static int refuse(int64_t status, int64_t pair, const TimedInterval *at, TimedScratch *scratch) {
    scratch->result = (TimedResult){status, pair, at->middle - at->half};
    return 0;
}

// Test two bodies of placed arms on an interval, and list them if they stay open. Returns 0 if they are rejected.
static int test_bodies(int64_t p, TimedInterval *at, const TimedScene *scene, TimedScratch *scratch) {
    Counters done = {0, 0, 0, 0};
    double moved = place_pair(&scene->exact->pairs[p], at->seen, scene->exact, scratch->exact);
    int status = judge_pair(p, moved, scene->tolerance, scene->exact, scratch->exact, &done);
    if (status == EDGE_FREE) return 1;
    if (status != PAIR_OPEN) {
        if (!at->find_first || moved < scene->tolerance) return refuse(status, p, at, scratch);
        at->touching = p;
    }
    if (at->tail == scratch->open_size) return refuse(EDGE_GRAZING, p, at, scratch);
    scratch->open[at->tail++] = p;
    return 1;
}

// Test the boxes around two groups of bodies on an interval, and the bodies if these move little. 0 if rejected.
//
// slice: box of the other arm on the interval.
static int test_groups(int64_t p, const Box *slice, TimedInterval *at, const TimedScene *scene,
                       TimedScratch *scratch) {
    const ExactTables *exact = scene->exact;
    ExactScratch *fine = scratch->exact;
    const TimedPair *pair = &scene->pairs[p];
    int64_t own = pair->own_body;
    place_arm(scene->arm_of_body[own], at->middle, at->half, at->seen, scene, scratch);
    double travel = timed_travel(own, at->seen, scene, fine), padding = exact->padding[p];
    double gap = slice_distance(&fine->centers[own], slice) - exact->shapes[own].ball_radius;
    if (gap >= padding + travel * SLACK + ROUNDING) return 1;
    place_arm(pair->arm, at->middle, at->half, at->seen, scene, scratch);
    double moved = place_pair(&exact->pairs[p], at->seen, exact, fine), enough = padding + moved * SLACK + ROUNDING;
    if (quick_gap(exact->pairs[p].body, exact->pairs[p].other, enough, exact, fine) >= enough) return 1;
    if (moved < BODIES_BELOW) {
        for (int64_t k = pair->first_child; k < pair->last_child; k++) {
            fine->directions[k] = (Vec3){0.0, 0.0, 0.0};
            if (!test_bodies(k, at, scene, scratch)) return 0;
        }
        return 1;
    }
    if (at->tail == scratch->open_size) return refuse(EDGE_GRAZING, p, at, scratch);
    scratch->open[at->tail++] = p;
    return 1;
}

// Prove the pairs listed from `first` to `last` apart on an interval of time, or find where they are not; 1 if proven.
static int prove_apart(double middle, double half, int64_t first, int64_t last, int find_first,
                       const TimedScene *scene, TimedScratch *scratch) {
    TimedInterval at = {middle, half, ++scratch->seen, last, -1, find_first};
    if (++scratch->nodes > MOST_CONFIGURATIONS) return refuse(EDGE_GRAZING, scratch->open[first], &at, scratch);
    int64_t boxed = -1;
    Box slice = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    for (int64_t i = first; i < last; i++) {
        int64_t p = scratch->open[i];
        const TimedPair *pair = &scene->pairs[p];
        if (p >= scene->first_root) {
            if (pair->arm != boxed) slice = box_on(&scene->arms[pair->arm], middle, half, scene);
            boxed = pair->arm;
            if (!test_groups(p, &slice, &at, scene, scratch)) return 0;
        } else {
            place_arm(scene->arm_of_body[pair->own_body], middle, half, at.seen, scene, scratch);
            place_arm(pair->arm, middle, half, at.seen, scene, scratch);
            if (!test_bodies(p, &at, scene, scratch)) return 0;
        }
    }
    if (at.tail == last) return 1;
    if (half < SHORTEST_HALF) return refuse(EDGE_GRAZING, scratch->open[last], &at, scratch);
    double quarter = 0.5 * half;
    if (!prove_apart(middle - quarter, quarter, last, at.tail, find_first, scene, scratch)) return 0;
    if (at.touching >= 0) {
        at.half = 0.0;  // the first half is proven
        return refuse(EDGE_CONTACT, at.touching, &at, scratch);
    }
    return prove_apart(middle + quarter, quarter, last, at.tail, find_first, scene, scratch);
}

// Certify the motion of the own arms among the others from one time to another [s]. Returns the status.
//
// find_first: 0 for the verdict only; 1 to find the time up to which the motion is free, to the tolerance.
EXPORT int64_t rr1_certify_timed(const TimedScene *scene, TimedScratch *scratch, double begin, double end,
                                 int64_t find_first) {
    int64_t count = scene->exact->pair_count - scene->first_root;
    scratch->nodes = 0;
    scratch->result = (TimedResult){EDGE_FREE, -1, end};
    if (count == 0) return EDGE_FREE;
    for (int64_t k = 0; k < count; k++) scratch->open[k] = scene->first_root + k;
    double half = 0.5 * (end - begin);
    prove_apart(begin + half, half, 0, count, find_first != 0, scene, scratch);
    return scratch->result.status;
}

// Compute the boxes around the other arms in all slices of their motions.
EXPORT void rr1_sweep_timed_arms(const TimedScene *scene, TimedScratch *scratch) {
    const ExactTables *exact = scene->exact;
    for (int64_t a = 0; a < scene->arm_count; a++) {
        const TimedArm *arm = &scene->arms[a];
        const double *breaks = scene->breaks + arm->first_break;
        if (arm->is_own) continue;
        double width = (breaks[arm->piece_count] - breaks[0]) / (double)arm->slice_count;
        for (int64_t i = 0; i < arm->slice_count; i++) {
            int64_t seen = ++scratch->seen;
            Box *box = &scene->slices[arm->first_slice + i];
            *box = (Box){{__builtin_inf(), __builtin_inf(), __builtin_inf()},
                              {-__builtin_inf(), -__builtin_inf(), -__builtin_inf()}};
            place_arm(a, breaks[0] + ((double)i + 0.5) * width, (0.5 + 1e-6) * width, seen, scene, scratch);
            for (int64_t b = scene->first_box; b < exact->body_count; b++) {
                if (scene->arm_of_body[b] != a) continue;
                double radius = timed_travel(b, seen, scene, scratch->exact) * SLACK + exact->shapes[b].ball_radius;
                const double *center = (const double *)&scratch->exact->centers[b];
                for (int k = 0; k < 3; k++) {
                    box->low[k] = min_number(box->low[k], center[k] - radius - ROUNDING);
                    box->high[k] = max_number(box->high[k], center[k] + radius + ROUNDING);
                }
            }
        }
    }
}
