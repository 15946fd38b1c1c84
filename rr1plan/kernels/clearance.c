// Gaps of pairs of bodies beyond their padding in one configuration, and pairs in contact.
#include "scene_tables.h"

// Proven lower bound of the least gap of any pair beyond its padding, at most `most`; -inf for a deep overlap [m].
EXPORT double rr1_least_clearance(const ExactTables *exact, ExactScratch *scratch, const double *q, double most) {
    place_joints(q, exact, scratch);
    for (int64_t b = 0; b < exact->body_count; b++)
        if (moves(&exact->bodies[b])) place_body(b, exact, scratch);
    for (int64_t p = 0; p < exact->pair_count; p++) {
        const ExactPair *pair = &exact->pairs[p];
        double enough = exact->padding[p] + most;
        scratch->directions[p] = (Vec3){0.0, 0.0, 0.0};
        if (quick_gap(pair->body, pair->other, enough, exact, scratch) >= enough) continue;
        GapBounds gap = fine_gap(pair->body, pair->other, enough, enough, &scratch->directions[p], exact, scratch);
        most = min_number(most, gap.lower - exact->padding[p]);
    }
    return most;
}

// Write the pairs of bodies that are nearer than their padding, ascending. Returns their number.
//
// A pair whose gap exceeds its padding by less than ROUNDING counts as in contact. `found` has room for all pairs.
EXPORT int64_t rr1_find_contacts(const ExactTables *exact, ExactScratch *scratch, const double *q, int64_t *found) {
    int64_t count = 0;
    place_joints(q, exact, scratch);
    for (int64_t b = 0; b < exact->body_count; b++)
        if (moves(&exact->bodies[b])) place_body(b, exact, scratch);
    for (int64_t p = 0; p < exact->pair_count; p++) {
        const ExactPair *pair = &exact->pairs[p];
        double padding = exact->padding[p], enough = padding + ROUNDING;
        if (quick_gap(pair->body, pair->other, enough, exact, scratch) >= enough) continue;
        scratch->directions[p] = (Vec3){0.0, 0.0, 0.0};
        GapBounds gap = fine_gap(pair->body, pair->other, padding, enough, &scratch->directions[p], exact, scratch);
        if (!(gap.lower >= enough)) found[count++] = p;
    }
    return count;
}
