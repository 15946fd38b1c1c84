// Certificate of a whole curve in joint space by the exact kernel (Schwarzer, Saha and Latombe, Adaptive dynamic
// collision checking for single and multiple articulated robots in complex environments, 2005).
//
// Around a configuration, a pair of bodies with a gap c stays apart as long as they move relative to each other by less
// than c. This displacement on an interval is bounded by a sum over the joints that move only one of them: rotation of
// the joint times largest distance of the body from its axis. Intervals whose gap does not suffice are halved, all of
// one width before any narrower one, so that contacts are found early.
//
// Curves are polynomials in t; a straight edge is one of degree 1.
#include "scene_tables.h"

// Far above the rounding error of positions [m]; every bound of a displacement is increased by it.
#define ROUNDING 1e-9
#define EPSILON 2.3e-16
// If bodies move farther than this, the search is for contacts only [m].
#define COARSE 0.07
// Values so large that their rounding exceeds the tolerance would be halved forever.
#define MOST_CONFIGURATIONS 2000000

// Further state of a pair, until its intervals are halved often enough.
enum { PAIR_OPEN = EDGE_GRAZING + 1 };

// q(t) = sum_k coefficients[k] t^k, 0 <= t <= duration, shape (terms, nq).
typedef struct {
    const double *coefficients;
    int64_t terms;
    double duration;
} Curve;

// Write the position at the middle of an interval to `q`, and the largest change of each column on it to `reach`.
static void place_interval(const Curve *curve, double middle, double half, int64_t nq, ExactScratch *scratch) {
    double *at = scratch->coefficients;
    int64_t terms = curve->terms;
    for (int64_t j = 0; j < nq; j++) {
        double size = 0.0, power = 1.0;
        for (int64_t k = 0; k < terms; k++) {
            at[k * nq + j] = curve->coefficients[k * nq + j];
            size += abs_number(curve->coefficients[k * nq + j]) * power;
            power *= curve->duration;
        }
        // Taylor's coefficients at the middle, by repeated division.
        for (int64_t first = 0; first < terms - 1; first++)
            for (int64_t k = terms - 2; k >= first; k--) at[k * nq + j] += middle * at[(k + 1) * nq + j];
        scratch->q[j] = at[j];
        double bound = 0.0;
        for (int64_t k = terms - 1; k > 0; k--) bound = (bound + abs_number(at[k * nq + j])) * half;
        scratch->reach[j] = bound * SLACK + 8.0 * (double)terms * (double)terms * EPSILON * size;
    }
}

// Place a body for the interval of number `seen` and bound its displacement, unless this is done already.
INLINE void ready_body(int64_t body, int64_t seen, const ExactTables *exact, ExactScratch *scratch) {
    if (scratch->placed_at[body] == seen) return;
    scratch->placed_at[body] = seen;
    place_body(body, exact, scratch);
    bound_travel(body, scratch->reach, exact, scratch);
}

// Place both bodies of a pair for the interval of number `seen`. Returns a bound of their relative displacement [m].
INLINE double place_pair(const ExactPair *pair, int64_t seen, const ExactTables *exact, ExactScratch *scratch) {
    double moved = 0.0;
    for (int side = 0; side < 2; side++) {
        int64_t body = side ? pair->other : pair->body;
        if (!moves(&exact->bodies[body])) continue;
        ready_body(body, seen, exact, scratch);
        moved += scratch->travel[body * scratch->travel_stride + pair->shared];
    }
    return moved;
}

// State of a pair with this displacement on the current interval: EDGE_FREE, EDGE_CONTACT, EDGE_GRAZING or PAIR_OPEN.
//
// Gaps that exceed the padding by less than the tolerance are grazing: to prove them free would take millions of
// intervals.
static int judge_pair(int64_t p, double moved, double tolerance, const ExactTables *exact, ExactScratch *scratch,
                      Counters *done) {
    const ExactPair *pair = &exact->pairs[p];
    double padding = exact->padding[p], enough = padding + max_number(moved * SLACK + ROUNDING, tolerance);
    double quick = quick_gap(pair->body, pair->other, enough, exact, scratch);
    if (quick >= enough) return EDGE_FREE;
    // The interval is too wide for a proof, and there is no sign of contact: halve it.
    if (moved > COARSE && quick > padding) return PAIR_OPEN;
    done->gaps++;
    GapBounds gap =
        fine_gap(pair->body, pair->other, padding, enough, &scratch->directions[p], exact, scratch);
    if (gap.lower >= enough) return EDGE_FREE;
    if (gap.upper <= padding) return EDGE_CONTACT;
    return moved < tolerance || gap.upper < padding + tolerance ? EDGE_GRAZING : PAIR_OPEN;
}

// A ring buffer of open entries, taken from both ends; entries of one interval are consecutive.
typedef struct {
    OpenInterval *entries;
    int64_t size;  // a power of two
    int64_t head;  // increases beyond the end of the ring
    int64_t tail;
} Queue;

INLINE OpenInterval *queue_at(const Queue *queue, int64_t i) { return &queue->entries[i & (queue->size - 1)]; }

INLINE int same_interval(const OpenInterval *a, const OpenInterval *b) {
    return a->middle == b->middle && a->half == b->half;
}

// Number of entries at the front (or the back) that belong to one interval.
static int64_t run_length(const Queue *queue, int back) {
    int64_t count = queue->tail - queue->head, run = 1;
    int64_t first = back ? queue->tail - 1 : queue->head, step = back ? -1 : 1;
    while (run < count && same_interval(queue_at(queue, first), queue_at(queue, first + step * run))) run++;
    return run;
}

// Fill the ring with the given entries, those of one interval together, in the order of their first entries.
static int fill_queue(Queue *queue, const OpenInterval *open, int64_t count) {
    if (count > queue->size) return 0;
    for (int64_t i = 0; i < count; i++) {
        int seen = 0;
        for (int64_t k = 0; k < i && !seen; k++) seen = same_interval(&open[i], &open[k]);
        for (int64_t k = i; k < count && !seen; k++)
            if (same_interval(&open[i], &open[k])) *queue_at(queue, queue->tail++) = open[k];
    }
    return 1;
}

// Halve intervals until every pair open on them is proven apart, or one is not.
//
// The widest come first. If the ring is more than half full, the narrowest come first, which needs no more room than
// their depth. After `most` configurations, a curve that is not proven counts as grazing.
static EdgeResult halve(const Curve *curve, double tolerance, int64_t most, Queue *queue, const ExactTables *exact,
                        ExactScratch *scratch, Counters *done) {
    int64_t seen = 0;
    for (int64_t b = 0; b < exact->body_count; b++) scratch->placed_at[b] = -1;
    // A pair keeps its direction from one interval to the next, but not from call to call, so that equal edges give
    // equal results.
    for (int64_t p = 0; p < exact->pair_count; p++) scratch->directions[p] = (Vec3){0.0, 0.0, 0.0};
    while (queue->tail > queue->head) {
        int back = queue->tail - queue->head > queue->size / 2;
        int64_t run = run_length(queue, back), first = back ? queue->tail - run : queue->head;
        OpenInterval interval = *queue_at(queue, first);
        if (seen > most) return (EdgeResult){EDGE_GRAZING, interval.pair, interval.middle};
        place_interval(curve, interval.middle, interval.half, exact->column_count, scratch);
        place_joints(scratch->q, exact, scratch);
        seen++;
        done->configurations++;
        // Halves of an interval at the back overwrite it; those of an interval at the front are added after all others.
        if (back) queue->tail = first;
        int64_t left = queue->tail;
        double half = 0.5 * interval.half;
        for (int64_t k = 0; k < run; k++) {
            int64_t pair = queue_at(queue, first + k)->pair;
            double moved = place_pair(&exact->pairs[pair], seen, exact, scratch);
            int status = judge_pair(pair, moved, tolerance, exact, scratch, done);
            if (status == PAIR_OPEN) {
                if (queue->tail - queue->head == queue->size)
                    return (EdgeResult){EDGE_GRAZING, pair, interval.middle};
                *queue_at(queue, queue->tail++) = (OpenInterval){interval.middle - half, half, pair};
            } else if (status != EDGE_FREE) {
                return (EdgeResult){status, pair, interval.middle};
            }
        }
        int64_t open = queue->tail - left;
        if (queue->tail - queue->head + open > queue->size)
            return (EdgeResult){EDGE_GRAZING, interval.pair, interval.middle};
        for (int64_t k = 0; k < open; k++)
            *queue_at(queue, queue->tail++) =
                (OpenInterval){interval.middle + half, half, queue_at(queue, left + k)->pair};
        if (!back) queue->head += run;
    }
    return (EdgeResult){EDGE_FREE, -1, 0.0};
}

// Certify the open parts of a curve, entries of one interval in any order; a count of -1: all pairs on the whole curve.
//
// tolerance: curves whose gap exceeds the padding by less than this are rejected [m]; most: see `halve`.
static EdgeResult certify_open(const Curve *curve, double tolerance, int64_t most, const OpenInterval *open,
                               int64_t count, const ExactTables *exact, ExactScratch *scratch, Counters *done) {
    Queue queue = {scratch->queue, scratch->queue_size, 0, 0};
    double half = 0.5 * curve->duration;
    if (count < 0)
        for (int64_t p = 0; p < exact->pair_count; p++) *queue_at(&queue, queue.tail++) = (OpenInterval){half, half, p};
    else if (!fill_queue(&queue, open, count))
        return (EdgeResult){EDGE_GRAZING, open[0].pair, open[0].middle};
    return halve(curve, tolerance, most, &queue, exact, scratch, done);
}
