// How much of their gaps pairs of bodies have beyond their padding in one configuration, and which have nothing left.
#include "scene_tables.h"

// The least gap of any pair beyond its padding: proven, `most` at most, -inf where bodies overlap deeply [m].
EXPORT double rr1_least_clearance(const ExactTables *exact, ExactScratch *scratch, const double *q, double most) {
    place_joints(q, exact, scratch);
    for (int64_t b = 0; b < exact->body_count; b++)
        if (moves(&exact->bodies[b])) place_body(b, exact, scratch);
    for (int64_t p = 0; p < exact->pair_count; p++) {
        const ExactPair *pair = &exact->pairs[p];
        double enough = exact->padding[p] + most;
        scratch->directions[p] = (ExactPoint){0.0, 0.0, 0.0};
        if (quick_gap(pair->body, pair->other, enough, exact, scratch) >= enough) continue;
        GapBounds gap = fine_gap(pair->body, pair->other, enough, enough, &scratch->directions[p], exact, scratch);
        most = min_number(most, gap.lower - exact->padding[p]);
    }
    return most;
}

// Write the pairs of bodies that are nearer than their padding, ascending; their number.
//
// A gap that is no more than ROUNDING beyond its padding counts as one in contact. `found` has room for all pairs.
EXPORT int64_t rr1_find_contacts(const ExactTables *exact, ExactScratch *scratch, const double *q, int64_t *found) {
    int64_t count = 0;
    place_joints(q, exact, scratch);
    for (int64_t b = 0; b < exact->body_count; b++)
        if (moves(&exact->bodies[b])) place_body(b, exact, scratch);
    for (int64_t p = 0; p < exact->pair_count; p++) {
        const ExactPair *pair = &exact->pairs[p];
        double padding = exact->padding[p], enough = padding + ROUNDING;
        if (quick_gap(pair->body, pair->other, enough, exact, scratch) >= enough) continue;
        scratch->directions[p] = (ExactPoint){0.0, 0.0, 0.0};
        GapBounds gap = fine_gap(pair->body, pair->other, padding, enough, &scratch->directions[p], exact, scratch);
        if (!(gap.lower >= enough)) found[count++] = p;
    }
    return count;
}
