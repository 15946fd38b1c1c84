// The search for the times at which two bodies come near: the certificate of `certificate.py` without Coal.
//
// Intervals of time are halved, depth first, with the pairs of bodies that are still open on each. What touches, or cannot
// be told from it, is left to Coal.

enum { FIRST_LOOKS = 12 };
// A smallest clearance is sharp when another look changes it by less [m].
#define SHARP 1e-10

// Find the smallest clearance of a group below `best` [m] where all is posed, to about `tolerance`; its pair of elements or
// -1.
//
// The pair that was nearest so far comes first: most others are then too far away for a search.
static int64_t find_nearest(RefereeSearch *s, int64_t group, double time, double *best, double tolerance) {
    int64_t which = -1, nearest = s->nearest[group];
    for (int64_t i = nearest >= 0 ? -1 : 0; i < s->pair_count; i++) {
        int64_t k = i < 0 ? nearest : i, elements = s->pairs[k].elements;
        if (s->pairs[k].group != group || s->marks[elements] == PAIR_LEFT || i == nearest) continue;
        if (ball_gap(s, k).gap >= *best || box_gap(s, k) >= *best) continue;
        double value = bound_clearance(s, k, *best - tolerance, *best).upper;
        if (note_clearance(s, k, value, time)) continue;
        if (value < *best) {
            *best = value;
            which = elements;
        }
    }
    return which;
}

static double clearance_at(RefereeSearch *s, int64_t k, double time) {
    pose_bodies_at(s, time);
    double value = bound_clearance(s, k, 1e300, 1e300).upper;
    note_clearance(s, k, value, time);
    return value;
}

// Find the smallest clearance of a pair around the time it was seen, by golden sections.
//
// They end when two of them in a row change the clearance by less than `precision` [m]: one may be symmetric.
static void refine_nearest(RefereeSearch *s, int64_t k, double precision) {
    const double golden = 0.6180339887498949;
    double begin = s->breaks[0], finish = s->breaks[s->break_count - 1];
    double at = s->found[s->pairs[k].elements].when, width = (finish - begin) / 64.0, center = at, best = 1e300;
    if (!(width > 0.0)) {
        clearance_at(s, k, at);
        return;
    }
    for (int i = -4; i < 5; i++) {
        double time = lesser(greater(center + 0.25 * i * width, begin), finish), value = clearance_at(s, k, time);
        if (value < best) {
            best = value;
            at = time;
        }
    }
    double low = greater(at - 0.25 * width, begin), high = lesser(at + 0.25 * width, finish);
    double one = high - golden * (high - low), two = low + golden * (high - low);
    double first = clearance_at(s, k, one), second = clearance_at(s, k, two), before = 1e300;
    while (high - low > 1e-7 * (finish - begin) && greater(before, fabs(first - second)) > precision) {
        before = fabs(first - second);
        if (first <= second) {
            high = two;
            two = one;
            second = first;
            one = high - golden * (high - low);
            first = clearance_at(s, k, one);
        } else {
            low = one;
            one = two;
            first = second;
            two = low + golden * (high - low);
            second = clearance_at(s, k, two);
        }
    }
}

// Look at some times first: the nearer the smallest clearances are known, the less is left to prove.
static void look_ahead(RefereeSearch *s) {
    double begin = s->breaks[0], finish = s->breaks[s->break_count - 1];
    int count = finish > begin ? FIRST_LOOKS : 1;
    for (int i = 0; i < count; i++) {
        double time = begin + (finish - begin) * i / (count > 1 ? count - 1 : 1);
        pose_bodies_at(s, time);
        for (int64_t group = 0; group < PAIR_GROUPS; group++) {
            double best = s->smallest[group];
            find_nearest(s, group, time, &best, s->tolerance);
        }
    }
    for (int64_t group = 0; group < PAIR_GROUPS; group++)
        if (s->nearest[group] >= 0) refine_nearest(s, s->nearest[group], 0.1 * s->tolerance);
}

// Put the later half of an interval, whose first open pairs end at `left`, in its place, and the earlier half on top.
static void halve_interval(RefereeSearch *s, int64_t top, int64_t left) {
    TimeInterval *later = &s->intervals[top], *earlier = later + 1;
    int64_t low = later->low;
    for (int64_t i = low; i < left; i++) s->items[left + i - low] = s->items[i];
    later->high = left;
    earlier->low = left;
    earlier->high = 2 * left - low;
    if (later->stop - later->first == 1) {
        double middle = 0.5 * (later->begin + later->end);
        earlier->first = later->first;
        earlier->stop = later->stop;
        earlier->begin = later->begin;
        earlier->end = later->begin = middle;
    } else {
        const double *breaks = s->breaks;
        double middle = 0.5 * (breaks[later->first] + breaks[later->stop]);
        int64_t cut = piece_at(s, middle);
        if (breaks[cut + 1] - middle < middle - breaks[cut]) cut++;
        if (cut < later->first + 1) cut = later->first + 1;
        if (cut > later->stop - 1) cut = later->stop - 1;
        earlier->first = later->first;
        earlier->stop = later->first = cut;
        earlier->begin = later->begin = 0.0;
        earlier->end = breaks[earlier->first + 1] - breaks[earlier->first];
        later->end = breaks[cut + 1] - breaks[cut];
    }
    s->open = top + 2;
}

// Take the last open interval, settle the pairs that can be settled, and open its halves for the others.
static void visit_interval(RefereeSearch *s) {
    int64_t top = --s->open;
    const TimeInterval at = s->intervals[top];
    double half, width, time, finish;
    int single = at.stop - at.first == 1;
    s->interval_count++;
    if (single) {
        double local = 0.5 * (at.begin + at.end);
        half = 0.5 * (at.end - at.begin);
        width = at.end - at.begin;
        time = s->breaks[at.first] + local;
        finish = s->breaks[at.first] + at.end;
        pose_bodies(s, at.first, local, half);
    } else {
        width = s->breaks[at.stop] - s->breaks[at.first];
        finish = s->breaks[at.stop];
        half = 0.5 * width;
        time = 0.5 * (s->breaks[at.first] + s->breaks[at.stop]);
        int64_t piece = piece_at(s, time);
        expand_columns(s, piece, time - s->breaks[piece], 0.0);
        widen_columns(s, at.first, at.stop);
        place_movers(s);
    }
    add_velocities(s);
    for (int64_t i = 0; i < s->mover_count; i++) sweep_body(s, s->movers[i]);
    // Too short to be halved.
    int point = width <= 4e-16 * greater(1.0, fabs(finish));
    int64_t left = at.low;
    for (int64_t i = at.low; i < at.high; i++) {
        int64_t k = s->items[i], elements = s->pairs[k].elements;
        if (s->marks[elements] == PAIR_LEFT) continue;
        s->check_count++;
        IntervalClearance clearance = interval_clearance(s, k, time, half, single);
        if (clearance.settled) {
            PairFindings *found = &s->found[elements];
            found->proven = lesser(found->proven, clearance.least);
            s->decided += width;
        } else if (point || top + 2 >= SEARCH_DEPTH) {
            s->marks[elements] = PAIR_LEFT;
        } else if (s->search_count > s->max_searches) {
            s->marks[elements] = PAIR_UNDECIDED;
        } else {
            s->items[left++] = k;
        }
    }
    if (left > at.low) halve_interval(s, top, left);
}

// Sharpen the smallest clearance of each group, and find the smallest at both ends.
static void finish_search(RefereeSearch *s) {
    for (int64_t group = 0; group < PAIR_GROUPS; group++) {
        int64_t nearest = s->nearest[group];
        if (nearest >= 0 && s->marks[s->pairs[nearest].elements] != PAIR_LEFT) refine_nearest(s, nearest, SHARP);
    }
    for (int64_t end = 0; end < 2; end++) {
        double time = s->breaks[end ? s->break_count - 1 : 0];
        pose_bodies_at(s, time);
        for (int64_t group = 0; group < PAIR_GROUPS; group++) {
            double value = 1e300;
            int64_t pair = find_nearest(s, group, time, &value, 0.0);
            if (pair < 0) continue;
            s->end_clearance[2 * group + end] = value;
            s->end_pair[2 * group + end] = pair;
        }
    }
    s->stage = SEARCH_DONE;
}

// Ranges of all columns on each piece, bodies placed, and the whole motion opened for all pairs.
static void start_search(RefereeSearch *s) {
    for (int64_t i = 0; i < s->piece_count; i++) {
        double half = s->break_count > 1 ? 0.5 * (s->breaks[i + 1] - s->breaks[i]) : 0.0;
        expand_columns(s, i, half, half);
        for (int64_t c = 0; c < s->column_count; c++) {
            const ColumnMotion *column = &s->columns[c];
            s->ranges[i * s->column_count + c] =
                (ColumnRange){column->value - column->change, column->value + column->change};
        }
    }
    for (int64_t b = 0; b < s->bodies->body_count; b++) place_body(s, b);
    look_ahead(s);
    for (int64_t k = 0; k < s->pair_count; k++) s->items[k] = k;
    double end = s->break_count > 1 ? s->breaks[1] - s->breaks[0] : 0.0;
    s->intervals[0] = (TimeInterval){0, s->piece_count, 0, s->pair_count, 0.0, end};
    s->open = 1;
    s->stage = SEARCH_SPLIT;
}

// Decide all pairs on all of a motion, or on `budget` more of its intervals.
EXPORT void rr1_prove_motion(RefereeSearch *s, int64_t budget) {
    if (s->stage == SEARCH_START) start_search(s);
    for (; budget > 0 && s->open > 0; budget--) visit_interval(s);
    if (s->open == 0 && s->stage != SEARCH_DONE) finish_search(s);
}
