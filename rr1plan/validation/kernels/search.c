// The search for the times at which two bodies come near each other.
//
// Pairs are decided in chunks: those of a moving arm with itself and all stationary owners, those of two moving arms,
// and those of stationary owners. For each chunk, intervals of time are halved, depth first, each with the pairs of
// bodies that are still open on it. For pairs in contact, the search continues to the first moment of contact and the
// largest depth.
//
// Schwarzer, Saha, Latombe (2005), Adaptive dynamic collision checking, IEEE T-RO 21.

// Tolerance of the time of first contact [s].
#define CONTACT_STEP 1e-5
// A smallest clearance or a largest depth is refined until it changes by less than this fraction of the tolerance.
#define SHARP 1e-3
// The smallest clearance within arms is searched for in the middle of every fourth slice.
enum { OWN_SLICES = 4 };
// Number of contacts with a refined largest depth. Searches for depths: those that each chunk may make in any case, and
// the divisor of `max_searches` that limits all of them.
enum { MOST_SHARPENED = 64, CHUNK_DEPTHS = 500, DEPTHS_SHARE = 4 };

// ---- single times ------------------------------------------------------------------------------

static void pose_arm_at(RefereeSearch *s, int64_t arm, PieceTime at) {
    expand_arm(s, arm, at.piece, at.local, 0.0);
    move_links(s, arm);
}

static double clearance_at(RefereeSearch *s, int64_t k, double time) {
    const RefereePair *pair = &s->pairs[k];
    PieceTime at = locate_time(s, time);
    if (pair->arm_a < s->moving_count) {
        pose_arm_at(s, pair->arm_a, at);
        place_body(s, pair->arm_a, pair->body_a);
    }
    if (pair->arm_b < s->moving_count) {
        if (pair->arm_b != pair->arm_a) pose_arm_at(s, pair->arm_b, at);
        place_body(s, pair->arm_b, pair->body_b);
    }
    double value = bound_clearance(s, k, 1e300, 1e300).upper;
    note_clearance(s, k, value, time);
    return value;
}

// A time, and the clearance at that time.
typedef struct {
    double time, value;
} TimedClearance;

// Offset from the middle of three points to the minimum of the parabola through them; 0 if it has no minimum.
static double lowest_of_parabola(TimedClearance low, TimedClearance at, TimedClearance high) {
    double left = at.time - low.time, right = high.time - at.time;
    double below = low.value - at.value, above = high.value - at.value, bend = above * left + below * right;
    if (!(left > 0.0 && right > 0.0 && bend > 0.0)) return 0.0;
    return 0.5 * (below * right * right - above * left * left) / bend;
}

// The clearance of a pair at a time, clamped to the motion.
static TimedClearance clearance_near(RefereeSearch *s, int64_t k, double time) {
    time = lesser(greater(time, s->breaks[0]), s->breaks[s->break_count - 1]);
    return (TimedClearance){time, clearance_at(s, k, time)};
}

// Find the smallest clearance of a pair of bodies near the time it was seen.
//
// After steps downhill, the middle one of three times has the smallest clearance. The three close in on the minimum
// until the clearances differ by less than `precision` [m]: by minima of parabolas where these are good, otherwise by
// golden sections.
static void refine_pair(RefereeSearch *s, int64_t k, double precision) {
    enum { STEPS = 8, ROUNDS = 60 };
    const RefereePair *pair = &s->pairs[k];
    if (pair->arm_a >= s->moving_count && pair->arm_b >= s->moving_count) return;
    double duration = s->breaks[s->break_count - 1] - s->breaks[0], step = duration / 256.0;
    TimedClearance at = clearance_near(s, k, s->elements[pair->elements].when);
    if (!(step > 0.0)) return;
    TimedClearance low = clearance_near(s, k, at.time - step), high = clearance_near(s, k, at.time + step);
    for (int i = 0; i < STEPS && (low.value < at.value || high.value < at.value); i++) {
        int down = low.value < high.value;
        TimedClearance next = clearance_near(s, k, down ? low.time - step : high.time + step);
        *(down ? &high : &low) = at;
        at = down ? low : high;
        *(down ? &low : &high) = next;
        step *= 1.5;
    }
    for (int round = 0; round < ROUNDS; round++) {
        double left = at.time - low.time, right = high.time - at.time, width = greater(left, right);
        if (greater(low.value, high.value) - at.value <= precision || left + right <= 1e-7 * duration) return;
        double wider = right > left ? 1.0 : -1.0, move = lowest_of_parabola(low, at, high);
        if (round % 3 == 2 || move == 0.0) {
            move = 0.382 * wider * width;
        } else if (fabs(move) < 0.1 * width) {
            // Near the minimum, move the farther end closer.
            move = wider * greater(4.0 * fabs(move), 1e-3 * width);
        }
        TimedClearance next = {at.time + move, 0.0};
        if (next.time <= low.time || next.time >= high.time) return;
        next.value = clearance_at(s, k, next.time);
        TimedClearance *behind = move > 0.0 ? &low : &high, *ahead = move > 0.0 ? &high : &low;
        if (next.value < at.value) {
            *behind = at;
            at = next;
        } else {
            *ahead = next;
        }
    }
}

// Refine the smallest clearances that were found since the last call.
static void refine_nearest(RefereeSearch *s) {
    for (int64_t group = 0; group < PAIR_GROUPS; group++) {
        int64_t k = nearest_pair(s, group);
        if (!s->has_nearest[group] || s->elements[k].seen == s->refined[group]) continue;
        refine_pair(s, k, SHARP * s->tolerance);
        s->refined[group] = s->elements[k].seen;
    }
}

// ---- intervals ---------------------------------------------------------------------------------

// Cut an interval in two near its middle.
static void cut_interval(const RefereeSearch *s, const TimeInterval *whole, TimeInterval *earlier, TimeInterval *later) {
    const TimeInterval at = *whole;
    const double *breaks = s->breaks;
    *earlier = *later = at;
    if (at.stop - at.first == 1) {
        earlier->end = later->begin = 0.5 * (at.begin + at.end);
        return;
    }
    double middle = 0.5 * (breaks[at.first] + breaks[at.stop]);
    int64_t cut = piece_at(s, middle);
    if (breaks[cut + 1] - middle < middle - breaks[cut]) cut++;
    if (cut < at.first + 1) cut = at.first + 1;
    if (cut > at.stop - 1) cut = at.stop - 1;
    earlier->stop = later->first = cut;
    earlier->begin = later->begin = 0.0;
    earlier->end = breaks[at.first + 1] - breaks[at.first];
    later->end = breaks[cut + 1] - breaks[cut];
}

static TimeInterval whole_motion(const RefereeSearch *s) {
    double end = s->break_count > 1 ? s->breaks[1] - s->breaks[0] : 0.0;
    return (TimeInterval){0, s->piece_count, 0, 0, 0.0, end};
}

// Replace an interval, whose open pairs end at `left`, by its later half, and put the earlier half on top.
static void halve_interval(RefereeSearch *s, int64_t top, int64_t left) {
    TimeInterval *later = &s->intervals[top], *earlier = later + 1, at = *later;
    for (int64_t i = at.low; i < left; i++) s->items[left + i - at.low] = s->items[i];
    cut_interval(s, &at, earlier, later);
    later->high = left;
    earlier->low = left;
    earlier->high = 2 * left - at.low;
    s->open = top + 2;
}

// Place a body in the middle of the interval and bound its motion within it, unless this is done already.
static inline void place_swept(RefereeSearch *s, int64_t arm, int64_t body) {
    int64_t index = s->arms[arm].first_body + body;
    if (arm >= s->moving_count || s->placed_on[index] == s->interval_count) return;
    s->placed_on[index] = s->interval_count;
    place_body(s, arm, body);
    sweep_body(s, arm, body);
}

// Whether the pairs of the chunk may make further searches for depths.
static inline int has_depths_left(const RefereeSearch *s) {
    return s->chunk_depths < CHUNK_DEPTHS || s->depth_count * DEPTHS_SHARE < s->max_searches;
}

// Pop the last open interval, settle the pairs that can be settled, and open its halves for the others.
static void visit_interval(RefereeSearch *s) {
    int64_t top = --s->open;
    const TimeInterval interval = s->intervals[top];
    IntervalMiddle at = middle_of(s, &interval);
    s->interval_count++;
    for (int i = 0; i < 2 && s->chunk_arms[i] >= 0; i++) {
        pose_links(s, s->chunk_arms[i], &interval, at);
        add_velocities(s, s->chunk_arms[i]);
    }
    // Too short to be halved.
    int point = at.width <= 4e-16 * greater(1.0, fabs(at.finish));
    double begin = at.time - at.half;
    int64_t left = interval.low, settled = 0;
    for (int64_t i = interval.low; i < interval.high; i++) {
        int64_t k = s->items[i];
        const RefereePair *pair = &s->pairs[k];
        ElementPair *elements = &s->elements[pair->elements];
        // Earlier intervals are searched first, so everything before `begin` is decided.
        int in_depth = elements->mark == PAIR_TOUCHES && begin + 1e-4 * CONTACT_STEP >= elements->first;
        s->check_count++;
        place_swept(s, pair->arm_a, pair->body_a);
        place_swept(s, pair->arm_b, pair->body_b);
        IntervalClearance clearance;
        if (in_depth) {
            clearance = depth_interval(s, k, at.time);
            clearance.settled |= !has_depths_left(s);
        } else {
            clearance = interval_clearance(s, k, at.time, at.half);
            clearance.settled &= clearance.least > 0.0;
        }
        int known = elements->mark == PAIR_TOUCHES && (point || top + 2 >= SEARCH_DEPTH || at.width <= CONTACT_STEP);
        if (clearance.settled || known) {
            note_proven(s, pair->group, clearance.least);
            settled++;
        } else if (point || top + 2 >= SEARCH_DEPTH || s->chunk_searches > s->max_searches) {
            if (elements->mark != PAIR_TOUCHES) elements->mark = PAIR_UNDECIDED;
        } else {
            s->items[left++] = k;
        }
    }
    s->decided += at.width * (double)settled;
    if (left > interval.low) halve_interval(s, top, left);
}

// ---- chunks ------------------------------------------------------------------------------------

static void begin_chunk(RefereeSearch *s, int64_t one, int64_t two) {
    s->chunk_arms[0] = one;
    s->chunk_arms[1] = two;
    s->pair_count = s->element_pair_count = s->chunk_searches = s->chunk_depths = s->chunk_slices = 0;
    s->chunk_work = s->decided = 0.0;
}

// Open the next slice on which pairs of the chunk can come near each other. Returns whether there was one.
static int open_slice(RefereeSearch *s) {
    if (!s->chunk_slices) return 0;
    int64_t slice = 0, count = 0;
    while (!(s->chunk_slices >> slice & 1)) slice++;
    s->chunk_slices ^= (int64_t)1 << slice;
    s->intervals[0] = s->slices[slice];
    // If nothing moves, the first instant is enough.
    if (s->chunk_arms[0] < 0) s->intervals[0] = (TimeInterval){0, 1, 0, 0, 0.0, 0.0};
    for (int64_t k = 0; k < s->pair_count; k++)
        if (s->pairs[k].slices >> slice & 1) s->items[count++] = k;
    s->intervals[0].low = 0;
    s->intervals[0].high = count;
    s->open = count > 0;
    return 1;
}

// Report the marked pairs of elements of the chunk.
static void report_marks(RefereeSearch *s) {
    for (int64_t e = 0; e < s->element_pair_count; e++) {
        const ElementPair *elements = &s->elements[e];
        if (elements->mark == PAIR_FREE) continue;
        if (elements->mark == PAIR_TOUCHES && s->sharpened_count < MOST_SHARPENED) {
            refine_pair(s, elements->pair, SHARP * s->tolerance);
            s->sharpened_count++;
        }
        s->marked[s->marked_count++] = *elements;
    }
    s->pair_count = s->element_pair_count = 0;
}

static int64_t body_count_of(const RefereeSearch *s, int64_t o) {
    Owner owner = owner_of(s, o);
    const int64_t *bodies = model_of(s, owner.arm)->element_bodies + owner.first;
    return bodies[owner.count] - bodies[0];
}

// Add the pairs of an owner with `partner` and later owners while there is room.
static void add_partners(RefereeSearch *s, int64_t owner) {
    int64_t bodies = body_count_of(s, owner);
    if (owner >= s->moving_count) {
        double need = needed_clearance(s, GROUP_OTHERS);
        int64_t first = s->partner, count = find_near_owners(s, owner, first, need + s->most_padding);
        for (int64_t n = 0; n < count; n++) {
            s->partner = s->near_owners[n];
            if (s->pair_count + bodies * body_count_of(s, s->partner) > s->pair_room) return;
            add_pairs(s, owner, s->partner);
        }
        // The skipped owners are farther away.
        if (count < s->owner_count - first) note_proven(s, GROUP_OTHERS, need);
        s->partner = s->owner_count;
        return;
    }
    for (; s->partner < s->owner_count; s->partner++) {
        if (s->pair_count + bodies * body_count_of(s, s->partner) > s->pair_room) return;
        add_pairs(s, owner, s->partner);
    }
}

// Pairs of stationary arms with each other and with obstacles, and pairs within one such arm.
static void next_stationary_chunk(RefereeSearch *s) {
    int64_t arms = arm_count(s);
    begin_chunk(s, -1, -1);
    while (s->arm < arms) {
        add_partners(s, s->arm);
        if (s->partner < s->owner_count) return;
        s->partner = ++s->arm + 1;
    }
    // From here on, `arm` counts the arms whose own pairs are checked.
    for (; s->arm - arms < s->own_arm_count; s->arm++) {
        int64_t arm = s->own_arms[s->arm - arms], bodies = body_count_of(s, arm);
        if (s->pair_count + bodies * bodies > s->pair_room) return;
        add_pairs(s, arm, arm);
    }
    s->stage = SEARCH_MOVING;
    s->arm = s->partner = 0;
}

// Pairs of a moving arm: with itself and all stationary owners, then with each other moving arm.
//
// `partner` is the arm itself, then counts up from the first stationary owner, then through the moving arms.
static void next_moving_chunk(RefereeSearch *s) {
    int64_t arm = s->arm, moving = s->moving_count;
    if (arm == moving) {
        s->stage = SEARCH_DONE;
        return;
    }
    if (s->pass == PASS_STATIONARY) {
        begin_chunk(s, arm, -1);
        if (s->partner == 0) {
            add_pairs(s, arm, arm);
            s->partner = moving;
        }
        add_partners(s, arm);
        if (s->partner == s->owner_count) {
            s->pass = PASS_MOVING;
            s->partner = arm + 1;
        }
        return;
    }
    while (s->partner < moving) {
        begin_chunk(s, arm, s->partner);
        add_pairs(s, arm, s->partner++);
        if (s->pair_count) return;
    }
    s->pass = PASS_STATIONARY;
    s->partner = 0;
    s->arm++;
}

// ---- the search --------------------------------------------------------------------------------

// Cut the whole motion into slices of about equal duration.
static void cut_slices(RefereeSearch *s) {
    s->slices[0] = whole_motion(s);
    s->slice_count = 1;
    if (s->break_count < 2) return;
    while (s->slice_count < MOTION_SLICES) {
        for (int64_t i = s->slice_count - 1; i >= 0; i--) {
            TimeInterval whole = s->slices[i];
            cut_interval(s, &whole, &s->slices[2 * i], &s->slices[2 * i + 1]);
        }
        s->slice_count *= 2;
    }
}

// Pose all moving arms at one time, and compute their boxes.
static void pose_movers_at(RefereeSearch *s, double time) {
    PieceTime at = locate_time(s, time);
    for (int64_t arm = 0; arm < s->moving_count; arm++) {
        pose_arm_at(s, arm, at);
        place_bodies(s, arm);
        box_arm(s, arm, 0, s->element_boxes, s->owner_boxes);
    }
}

// Find the smallest clearance to the surroundings at both ends.
static void search_ends(RefereeSearch *s) {
    NearestElements standing = {1e300, -1, -1};
    double begin = s->breaks[0];
    standing = find_nearest_others(s, s->moving_count, arm_count(s), begin, 0.0, standing);
    for (int end = 0; end < 2; end++) {
        double time = s->breaks[end ? s->break_count - 1 : 0];
        pose_movers_at(s, time);
        NearestElements best = find_nearest_others(s, 0, s->moving_count, time, 0.0, standing);
        s->ends[end] = (ElementPair){best.a, best.b, PAIR_FREE, -1, best.clearance, time, INFINITY};
    }
}

// Boxes around all moving arms on each slice, and smallest clearances in the middle of it: the better these are known,
// the less is left to prove.
static void search_slices(RefereeSearch *s) {
    for (int64_t slice = 0; slice < s->slice_count; slice++) {
        IntervalMiddle middle = middle_of(s, &s->slices[slice]);
        BoundingBox *elements = s->element_slices + slice * s->element_count;
        BoundingBox *owners = s->owner_slices + slice * s->owner_count;
        for (int64_t arm = 0; arm < s->moving_count; arm++) {
            int64_t bodies = model_of(s, arm)->bodies->body_count;
            pose_links(s, arm, &s->slices[slice], middle);
            place_bodies(s, arm);
            for (int64_t b = 0; b < bodies; b++) sweep_body(s, arm, b);
            box_arm(s, arm, 1, elements, owners);
            if (slice == 0) s->owner_sweeps[arm] = NO_BOX;
            join_boxes(&s->owner_sweeps[arm], &owners[arm]);
            if (s->with_clearance) box_arm(s, arm, 0, s->element_boxes, s->owner_boxes);
        }
        if (!s->with_clearance) continue;
        NearestElements best = {s->smallest[GROUP_OTHERS], -1, -1};
        find_nearest_others(s, 0, s->moving_count, middle.time, s->tolerance, best);
        if (slice % OWN_SLICES == OWN_SLICES / 2 || s->slice_count == 1) find_nearest_own(s, middle.time, s->tolerance);
    }
}

static void start_search(RefereeSearch *s) {
    int64_t arms = arm_count(s);
    set_chords(s);
    cut_slices(s);
    for (int64_t arm = s->moving_count; arm <= arms; arm++) {
        move_links(s, arm);
        place_bodies(s, arm);
        box_arm(s, arm, 0, s->element_boxes, s->owner_boxes);
    }
    for (int64_t e = s->arms[s->moving_count].first_element; e < s->element_count; e++)
        s->element_slices[e] = s->element_boxes[e];
    for (int64_t o = s->moving_count; o < s->owner_count; o++) s->owner_slices[o] = s->owner_sweeps[o] = s->owner_boxes[o];
    sort_owners(s);
    if (s->with_clearance) search_ends(s);
    search_slices(s);
    if (s->with_clearance) refine_nearest(s);
    s->stage = SEARCH_STATIONARY;
    s->arm = s->moving_count;
    s->partner = s->arm + 1;
}

// Decide all pairs over a whole motion, or on about `budget` further intervals; returns early with marked pairs.
EXPORT void rr1_prove_motion(RefereeSearch *s, int64_t budget) {
    if (s->stage == SEARCH_START) start_search(s);
    for (; budget > 0 && s->stage != SEARCH_DONE; budget--) {
        if (s->open > 0) {
            visit_interval(s);
        } else if (!open_slice(s)) {
            report_marks(s);
            if (s->marked_count > 0) return;
            if (s->stage == SEARCH_STATIONARY) {
                next_stationary_chunk(s);
            } else {
                next_moving_chunk(s);
            }
        }
    }
    if (s->stage == SEARCH_DONE && s->with_clearance) refine_nearest(s);
}
