// Certificate of a straight edge or a parabola: by spheres and separating directions in SIMD lanes, and by the exact
// kernel for what these leave open.
//
// The edge is divided into intervals until each is proven, eight at a time. Proven intervals are dropped, the others
// halved; those that neither spheres nor directions can decide are listed for the exact kernel.
//
// The results are those of the exact kernel: pairs that spheres prove free have a gap beyond its tolerance everywhere,
// and pairs that they prove to touch are nearer than the padding.
#include "scene_tables.h"

// Intervals are halved down to this half width. Bodies that pass each other within micrometers need that; the exact
// kernel, whose bounds ignore the direction of motion, needs intervals a hundred times narrower still.
#define NARROWEST (1.0 / 1048576.0)

// Configurations of an edge after which the exact kernel gives up. Free edges among many arms need up to 100; those that
// pass at a distance just above the least one would need millions.
#define MOST_OF_EDGE 2000

enum { SWEEP_PROVEN, SWEEP_CONTACT, SWEEP_OPEN };

// Store the open lanes of a candidate, to be halved or for the exact kernel. Returns 0 if there is no room.
INLINE int store_open_lanes(const Candidate *candidate, int64_t bit, int64_t batch, Scratch *scratch) {
    for (uint64_t left = candidate->lanes; left; left &= left - 1) {
        int64_t i = first_bit(left);
        double half = scratch->halves[i];
        if (half > NARROWEST && (batch == 1 || !(candidate->stuck >> i & 1))) {
            scratch->lane_candidates[i] |= (uint64_t)1 << bit;
        } else {
            if (scratch->open_count == scratch->interval_size) return 0;
            scratch->open[scratch->open_count++] = (OpenInterval){scratch->middles[i], half, candidate->pair};
        }
    }
    return 1;
}

// Store the open lanes of all candidates. Returns 0 if there is no room.
INLINE int store_open_candidates(int64_t count, int64_t batch, Scratch *scratch) {
    for (int64_t k = 0; k < count; k++)
        if (!store_open_lanes(&scratch->candidates[k], k < LAST_BIT ? k : LAST_BIT, batch, scratch)) return 0;
    return 1;
}

// Add both halves of each interval of a batch on which a candidate is open. Returns the new number of intervals.
INLINE int64_t halve_intervals(int64_t tail, int64_t taken, Scratch *scratch) {
    for (int64_t i = 0; i < taken; i++) {
        if (scratch->lane_candidates[i] == 0) continue;
        double half = 0.5 * scratch->halves[i];
        for (int side = 0; side < 2; side++)
            scratch->intervals[tail++] =
                (Interval){scratch->middles[i] + (2.0 * side - 1.0) * half, half, scratch->lane_candidates[i]};
    }
    return tail;
}

// Test the edge in `curve` by spheres and directions: bodies against all obstacles and against each other.
//
// Returns SWEEP_PROVEN; SWEEP_CONTACT, reported; or SWEEP_OPEN: `open_count` intervals and pairs are left to the exact
// kernel (-1: the whole edge).
static int sweep(const SceneTables *scene, Scratch *scratch) {
    scratch->open_count = 0;
    scratch->batches = 0;
    scratch->edge++;
    if (!angles_are_small(scene, scratch)) {
        scratch->open_count = -1;
        return SWEEP_OPEN;
    }
    bound_motion(scene, scratch);
    for (int64_t b = 0; b < scene->arm->body_count; b++) scratch->placed_batch[b] = 0;
    int64_t head = 0, tail = 0, taken = LANES, count = 0;
    f64x8 t = (f64x8){0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5} / LANES, h = splat(0.5 / LANES);
    for (;;) {
        int64_t batch = ++scratch->batches;
        store_lanes(scratch->middles, t);
        store_lanes(scratch->halves, h);
        for (int64_t i = 0; i < LANES; i++) scratch->lane_candidates[i] = 0;
        place_frames(t, scene, scratch);
        int contact;
        if (batch == 1) {
            count = add_obstacle_candidates(h, scene, scratch);
            if (count >= 0) count = add_body_candidates(count, h, scene, scratch);
            contact = count < 0;
        } else {
            contact = retest_candidates(count, head, taken, batch, h, scene, scratch);
        }
        if (contact) return SWEEP_CONTACT;
        if (!store_open_candidates(count, batch, scratch) || tail + 2 * LANES > scratch->interval_size) {
            // The open intervals may not fit: the whole edge is left to the exact kernel.
            scratch->open_count = -1;
            return SWEEP_OPEN;
        }
        // The first batch is not in the list.
        if (batch > 1) head += taken;
        tail = halve_intervals(tail, taken, scratch);
        if (head == tail) break;
        taken = tail - head < LANES ? tail - head : LANES;
        for (int64_t i = 0; i < LANES; i++) {
            const Interval *interval = &scratch->intervals[head + (i < taken ? i : taken - 1)];
            t[i] = interval->middle;
            h[i] = interval->half;
        }
    }
    return scratch->open_count == 0 ? SWEEP_PROVEN : SWEEP_OPEN;
}

// Certify the edge in `curve`, which has `terms` coefficients; `has_free_end`: see `Scratch`. Returns the status.
static int64_t decide(int64_t terms, int64_t has_free_end, const SceneTables *scene, Scratch *scratch) {
    Counters *done = &scratch->done;
    scratch->has_free_end = has_free_end;
    done->edges++;
    int answer = sweep(scene, scratch);
    done->configurations += LANES * scratch->batches;
    if (answer == SWEEP_PROVEN) {
        scratch->result = (EdgeResult){EDGE_FREE, -1, 0.0};
    } else if (answer == SWEEP_OPEN) {
        done->exact_edges++;
        Curve curve = {scratch->curve, terms, 1.0};
        scratch->result = certify_open(&curve, scene->margin, MOST_OF_EDGE, scratch->open, scratch->open_count,
                                       scene->exact, scratch->exact, done);
    }
    return scratch->result.status;
}

static void set_edge(const double *q0, const double *q1, const SceneTables *scene, Scratch *scratch) {
    int64_t nq = scene->column_count;
    for (int64_t c = 0; c < nq; c++) {
        scratch->curve[c] = q0[c];
        scratch->curve[nq + c] = q1[c] - q0[c];
        scratch->curve[2 * nq + c] = 0.0;
    }
}

// Certify the straight line from q0 to q1, shape (nq,). Returns the status; the whole result is in `result`.
EXPORT int64_t rr1_certify_edge(const SceneTables *scene, Scratch *scratch, const double *q0, const double *q1) {
    set_edge(q0, q1, scene, scratch);
    return decide(2, 0, scene, scratch);
}

// Whether the straight line from q0 to q1 is free, at least one of which is known to be free.
//
// If only one of several arms moves, the pairs of all others need no test.
static int edge_from_free_is_free(const SceneTables *scene, Scratch *scratch, const double *q0, const double *q1) {
    set_edge(q0, q1, scene, scratch);
    return decide(2, 1, scene, scratch) == EDGE_FREE;
}

// Certify the edges of a path, shape (count, nq), count >= 2, until one is not free. Returns the number of free ones.
EXPORT int64_t rr1_certify_path(const SceneTables *scene, Scratch *scratch, const double *points, int64_t count) {
    int64_t nq = scene->column_count, free = 0;
    if (rr1_certify_edge(scene, scratch, points, points + nq) != EDGE_FREE) return 0;
    for (free = 1; free < count - 1; free++)
        if (!edge_from_free_is_free(scene, scratch, points + free * nq, points + (free + 1) * nq)) break;
    return free;
}

// Certify the curve sum_k coefficients[k] t^k, 0 <= t <= duration, of 1, 2 or 3 terms, shape (terms, nq).
EXPORT int64_t rr1_certify_parabola(const SceneTables *scene, Scratch *scratch, const double *coefficients,
                                    int64_t terms, double duration) {
    int64_t nq = scene->column_count;
    double factor = 1.0;
    for (int64_t k = 0; k < 3; k++) {
        for (int64_t c = 0; c < nq; c++)
            scratch->curve[k * nq + c] = k < terms ? coefficients[k * nq + c] * factor : 0.0;
        factor *= duration;
    }
    return decide(3, 0, scene, scratch);
}

// Certify a curve by the exact kernel alone; the `coefficients` of its scratch have room for all terms.
EXPORT int64_t rr1_certify_curve(const SceneTables *scene, Scratch *scratch, const double *coefficients,
                                 int64_t terms, double duration) {
    Curve curve = {coefficients, terms, duration};
    scratch->done.edges++;
    scratch->result = certify_open(&curve, scene->margin, MOST_CONFIGURATIONS, 0, -1, scene->exact, scratch->exact,
                                   &scratch->done);
    return scratch->result.status;
}

// Certify straight edges, each from a row of `begins` to that of `ends`, shape (count, nq), and write their statuses.
EXPORT void rr1_certify_edges(const SceneTables *scene, Scratch *scratch, const double *begins, const double *ends,
                              int64_t count, int64_t *statuses) {
    int64_t nq = scene->column_count;
    for (int64_t i = 0; i < count; i++)
        statuses[i] = rr1_certify_edge(scene, scratch, begins + i * nq, ends + i * nq);
}
