// Broad phase: axis-aligned boxes around elements and arms, at one time and over slices of the motion.
//
// Owners are the moving arms, then the stationary arms, then each obstacle. Each pair of owners costs a few additions;
// pairs that are far apart are not considered further.

// Rounding of boxes [m].
#define BOX_ROUNDING 1e-9

static inline int64_t arm_count(const RefereeSearch *s) { return s->moving_count + s->stationary_count; }

// An arm with all its elements, or one element of the obstacles.
typedef struct {
    int64_t arm;
    int64_t first;  // element of the arm's model
    int64_t count;
    int64_t index;  // of the first among all elements
} Owner;

static inline Owner owner_of(const RefereeSearch *s, int64_t o) {
    int64_t arms = arm_count(s), obstacle = o - arms;
    if (o < arms) return (Owner){o, 0, model_of(s, o)->element_count, s->arms[o].first_element};
    return (Owner){arms, obstacle, 1, s->arms[arms].first_element + obstacle};
}

// ---- posing ------------------------------------------------------------------------------------

// The middle of an interval.
typedef struct {
    double time, half, width, finish;
    int single;  // the interval is on a single piece
    PieceTime at;
} IntervalMiddle;

static IntervalMiddle middle_of(const RefereeSearch *s, const TimeInterval *interval) {
    const double *breaks = s->breaks;
    if (interval->stop - interval->first == 1) {
        double local = 0.5 * (interval->begin + interval->end), begin = breaks[interval->first];
        double width = interval->end - interval->begin;
        return (IntervalMiddle){begin + local, 0.5 * width, width, begin + interval->end, 1, {interval->first, local}};
    }
    double begin = breaks[interval->first], finish = breaks[interval->stop], time = 0.5 * (begin + finish);
    int64_t piece = piece_at(s, time);
    return (IntervalMiddle){time, 0.5 * (finish - begin), finish - begin, finish, 0, {piece, time - breaks[piece]}};
}

// Pose the links of an arm in the middle of an interval, and bound the motion of its joints within it.
static void pose_links(RefereeSearch *s, int64_t arm, const TimeInterval *interval, IntervalMiddle middle) {
    expand_arm(s, arm, middle.at.piece, middle.at.local, middle.single ? middle.half : 0.0);
    if (!middle.single) span_pieces(s, arm, interval->first, interval->stop, middle.time);
    move_links(s, arm);
}

static void place_bodies(RefereeSearch *s, int64_t arm) {
    int64_t count = model_of(s, arm)->bodies->body_count;
    for (int64_t b = 0; b < count; b++) place_body(s, arm, b);
}

// ---- boxes -------------------------------------------------------------------------------------

static const BoundingBox NO_BOX = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static inline void join_boxes(BoundingBox *box, const BoundingBox *other) {
    for (int i = 0; i < 3; i++) {
        box->low[i] = lesser(box->low[i], other->low[i]);
        box->high[i] = greater(box->high[i], other->high[i]);
    }
}

// A box around a body displaced by at most `carried` [m].
static BoundingBox body_box(BodyView body, double carried) {
    BoundingBox box;
    if (is_plane(body)) return (BoundingBox){{-INFINITY, -INFINITY, -INFINITY}, {INFINITY, INFINITY, INFINITY}};
    const double *half = body.all->sizes[body.index].box, *middle = body.placed->middle;
    for (int i = 0; i < 3; i++) {
        const double *row = &body.placed->rotation[3 * i];
        double reach = fabs(row[0]) * half[0] + fabs(row[1]) * half[1] + fabs(row[2]) * half[2];
        reach = lesser(reach, radius_of(body)) + carried + BOX_ROUNDING + RELATIVE_ROUNDING * fabs(middle[i]);
        box.low[i] = middle[i] - reach;
        box.high[i] = middle[i] + reach;
    }
    return box;
}

// Boxes around the elements of an arm and around the whole arm, at the bodies' poses.
//
// `swept`: around all poses on the interval of the last sweeps.
static void box_arm(RefereeSearch *s, int64_t arm, int swept, BoundingBox *elements, BoundingBox *owners) {
    const RefereeModel *model = model_of(s, arm);
    int64_t arms = arm_count(s), first = s->arms[arm].first_element;
    if (arm < arms) owners[arm] = NO_BOX;
    for (int64_t e = 0; e < model->element_count; e++) {
        BoundingBox *box = &elements[first + e];
        *box = NO_BOX;
        for (int64_t b = model->element_bodies[e]; b < model->element_bodies[e + 1]; b++) {
            double carried = swept ? carried_by(s, arm, b, 0) : 0.0;
            BoundingBox one = body_box(view_of(s, arm, b), carried);
            join_boxes(box, &one);
        }
        if (arm < arms) {
            join_boxes(&owners[arm], box);
        } else {
            owners[arms + e] = *box;
        }
    }
}

// A lower bound of the distance between the contents of two boxes, along one axis [m]; negative if the boxes overlap.
static inline double axis_separation(const BoundingBox *a, const BoundingBox *b) {
    double gap = -INFINITY;
    for (int i = 0; i < 3; i++) gap = greater(gap, greater(a->low[i] - b->high[i], b->low[i] - a->high[i]));
    return gap;
}

// A lower bound of the distance between the contents of two boxes [m]; if the boxes overlap, minus the overlap.
static inline double box_separation(const BoundingBox *a, const BoundingBox *b) {
    double square = 0.0, most = -INFINITY;
    for (int i = 0; i < 3; i++) {
        double gap = greater(a->low[i] - b->high[i], b->low[i] - a->high[i]);
        most = greater(most, gap);
        if (gap > 0.0) square += gap * gap;
    }
    return square > 0.0 ? sqrt(square) : most;
}

// ---- stationary owners -------------------------------------------------------------------------

static int compare_lows(const void *a, const void *b) {
    const SortedOwner *one = a, *two = b;
    if (one->low != two->low) return one->low < two->low ? -1 : 1;
    return one->owner < two->owner ? -1 : 1;
}

static int compare_indices(const void *a, const void *b) {
    int64_t one = *(const int64_t *)a, two = *(const int64_t *)b;
    return (one > two) - (one < two);
}

// Sort the stationary owners along x; half-spaces are unbounded and come after the others.
static void sort_owners(RefereeSearch *s) {
    int64_t last = s->owner_count - s->moving_count;
    s->sorted_count = 0;
    s->widest = 0.0;
    for (int64_t o = s->moving_count; o < s->owner_count; o++) {
        const BoundingBox *box = &s->owner_boxes[o];
        double width = box->high[0] - box->low[0];
        // An owner without bodies is near nothing, and its box is not bounded either.
        int bounded = width < INFINITY;
        s->sorted[bounded ? s->sorted_count++ : --last] = (SortedOwner){box->low[0], o};
        if (bounded) s->widest = greater(s->widest, width);
    }
    qsort(s->sorted, (size_t)s->sorted_count, sizeof(SortedOwner), compare_lows);
}

// Find the owners from `first` on that are within a distance of a stationary owner along each axis [m]. They are
// written to `near_owners` in order. Returns their number.
static int64_t find_near_owners(RefereeSearch *s, int64_t owner, int64_t first, double distance) {
    const BoundingBox *box = &s->owner_boxes[owner];
    int64_t low = 0, high = s->sorted_count, count = 0, all = s->owner_count - s->moving_count;
    double begin = box->low[0] - s->widest - distance;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (s->sorted[middle].low < begin) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    for (int64_t i = low; i < all; i++) {
        if (i < s->sorted_count && s->sorted[i].low > box->high[0] + distance) i = s->sorted_count;
        if (i == all) break;
        int64_t other = s->sorted[i].owner;
        if (other >= first && !(axis_separation(box, &s->owner_boxes[other]) > distance)) s->near_owners[count++] = other;
    }
    qsort(s->near_owners, (size_t)count, sizeof(int64_t), compare_indices);
    return count;
}

// Boxes of moving owners or elements differ from slice to slice; those of stationary ones are in the first slice.
static inline const BoundingBox *slice_box(const BoundingBox *boxes, int64_t count, int64_t index, int moves,
                                           int64_t slice) {
    return &boxes[(moves ? slice * count : 0) + index];
}

// The slices of a mask on which the contents of two boxes may come within a distance [m]. `apart` is lowered to the
// smallest distance on the other slices.
static int64_t near_slices(const RefereeSearch *s, const BoundingBox *boxes, int64_t count, int64_t a, int a_moves,
                           int64_t b, int b_moves, double distance, int64_t mask, double *apart) {
    int64_t near = 0;
    for (int64_t slice = 0; slice < s->slice_count; slice++) {
        if (!(mask >> slice & 1)) continue;
        const BoundingBox *one = slice_box(boxes, count, a, a_moves, slice);
        double gap = box_separation(one, slice_box(boxes, count, b, b_moves, slice));
        if (gap > distance) {
            *apart = lesser(*apart, gap);
        } else {
            near |= (int64_t)1 << slice;
        }
    }
    return near;
}

// ---- rules -------------------------------------------------------------------------------------

// The paddings between the elements of owners i <= j; NULL if there is no rule for them.
static const double *find_paddings(const RefereeSearch *s, int64_t i, int64_t j) {
    int64_t key = i * s->owner_count + j, low = 0, high = s->rule_count;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (s->rules[middle].key < key) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low < s->rule_count && s->rules[low].key == key ? s->paddings + s->rules[low].first : NULL;
}

// The distance to keep between two elements of owners [m]; negative if contact is allowed.
static inline double padding_between(const RefereeSearch *s, Owner one, int64_t ea, Owner two, int64_t eb,
                                     const double *paddings) {
    if (paddings) return paddings[ea * two.count + eb];
    const RefereeModel *model = model_of(s, one.arm);
    if (one.arm == two.arm)
        return model->own_checked && model->own_checked[ea * one.count + eb] ? s->padding : -1.0;
    if (two.arm == arm_count(s) && ea == model->base_element) return -1.0;
    return s->padding;
}

// ---- pairs -------------------------------------------------------------------------------------

// Set pair k to a pair of two bodies.
static void set_pair(RefereeSearch *s, int64_t k, int64_t arm_a, int64_t a, int64_t arm_b, int64_t b, int64_t elements,
                     int64_t slices, double padding) {
    BodyView view_a = view_of(s, arm_a, a), view_b = view_of(s, arm_b, b);
    if (is_plane(view_a) || (is_compound(view_a) && !is_compound(view_b) && !is_plane(view_b))) {
        set_pair(s, k, arm_b, b, arm_a, a, elements, slices, padding);
        return;
    }
    const RefereeModel *one = model_of(s, arm_a), *two = model_of(s, arm_b);
    const RefereeBody *body_a = &one->bodies->bodies[a], *body_b = &two->bodies->bodies[b];
    const int64_t *chain_a = one->chains + body_a->first_joint, *chain_b = two->chains + body_b->first_joint;
    int64_t first_a = s->arms[arm_a].first_joint, first_b = s->arms[arm_b].first_joint, shared = 0;
    if (arm_a == arm_b)
        while (shared < body_a->depth && shared < body_b->depth && chain_a[shared] == chain_b[shared]) shared++;
    s->pairs[k] = (RefereePair){
        .a = s->arms[arm_a].first_body + a,
        .b = s->arms[arm_b].first_body + b,
        .arm_a = arm_a,
        .arm_b = arm_b,
        .body_a = a,
        .body_b = b,
        .elements = elements,
        .shared = shared,
        .before = shared > 0 && arm_a < s->moving_count ? first_a + chain_a[shared - 1] : -1,
        .last_a = body_a->depth > 0 && arm_a < s->moving_count ? first_a + chain_a[body_a->depth - 1] : -1,
        .last_b = body_b->depth > 0 && arm_b < s->moving_count ? first_b + chain_b[body_b->depth - 1] : -1,
        .group = arm_a == arm_b ? GROUP_OWN : GROUP_OTHERS,
        .slices = slices,
        .padding = padding,
    };
    s->gjk[k].count = 0;
    s->directions[k].known = 0.0;
}

// Note that pairs of a group are proven to be at least `bound` apart [m].
static inline void note_proven(RefereeSearch *s, int64_t group, double bound) {
    s->proven[group] = lesser(s->proven[group], bound);
}

static int encloses(BodyView body, BodyView surface);

static void pose_arm_at(RefereeSearch *s, int64_t arm, PieceTime at);

// Whether one of two bodies encloses the other at the start of the motion.
static int begins_enclosed(RefereeSearch *s, int64_t arm_a, int64_t a, int64_t arm_b, int64_t b) {
    BodyView one = view_of(s, arm_a, a), two = view_of(s, arm_b, b);
    if (!is_compound(one) && !is_compound(two)) return 0;
    int64_t arms[2] = {arm_a, arm_b}, bodies[2] = {a, b};
    for (int i = 0; i < 2; i++) {
        if (arms[i] >= s->moving_count) continue;
        pose_arm_at(s, arms[i], (PieceTime){0, 0.0});
        place_body(s, arms[i], bodies[i]);
    }
    return encloses(one, two) || encloses(two, one);
}

// Add all pairs of bodies of two elements to the chunk, for the slices of a mask.
static void add_bodies(RefereeSearch *s, Owner one, int64_t ea, Owner two, int64_t eb, int64_t slices, double padding) {
    const RefereeModel *model_a = model_of(s, one.arm), *model_b = model_of(s, two.arm);
    int64_t elements = s->element_pair_count, before = s->pair_count;
    ElementPair pair = {one.index + ea, two.index + eb, PAIR_FREE, before, INFINITY, s->breaks[0], INFINITY};
    const int64_t *in_a = model_a->element_bodies + one.first + ea, *in_b = model_b->element_bodies + two.first + eb;
    for (int64_t a = in_a[0]; a < in_a[1]; a++) {
        for (int64_t b = in_b[0]; b < in_b[1]; b++) {
            set_pair(s, s->pair_count++, one.arm, a, two.arm, b, elements, slices, padding);
            if (!begins_enclosed(s, one.arm, a, two.arm, b)) continue;
            pair.mark = PAIR_TOUCHES;
            pair.first = s->breaks[0];
        }
    }
    if (s->pair_count == before) return;
    for (int group = 0; group < PAIR_GROUPS && pair.mark == PAIR_TOUCHES; group++)
        s->smallest[group] = lesser(s->smallest[group], 0.0);
    double duration = s->breaks[s->break_count - 1] - s->breaks[0];
    s->chunk_slices |= slices;
    int64_t pairs = (s->pair_count - before) * __builtin_popcountll((uint64_t)slices);
    s->chunk_work += (double)pairs * duration / (double)s->slice_count;
    s->elements[s->element_pair_count++] = pair;
}

// The slices on which owners i <= j come near each other.
static int64_t near_owners(RefereeSearch *s, int64_t i, int64_t j, double need) {
    int a_moves = i < s->moving_count, b_moves = j < s->moving_count;
    int64_t mask = a_moves || b_moves ? ((int64_t)1 << s->slice_count) - 1 : 1;
    if (i == j) return mask;
    // Most owners are far apart along one axis.
    double far = need + s->most_padding, apart = axis_separation(&s->owner_sweeps[i], &s->owner_sweeps[j]);
    if (apart > far) {
        mask = 0;
    } else {
        apart = INFINITY;
        mask = near_slices(s, s->owner_slices, s->owner_count, i, a_moves, j, b_moves, far, mask, &apart);
    }
    note_proven(s, GROUP_OTHERS, apart - s->most_padding);
    return mask;
}

// Add the pairs of owners i <= j that can come near each other to the chunk.
static void add_pairs(RefereeSearch *s, int64_t i, int64_t j) {
    Owner one = owner_of(s, i), two = owner_of(s, j);
    int a_moves = i < s->moving_count, b_moves = j < s->moving_count;
    double need = needed_clearance(s, i == j ? GROUP_OWN : GROUP_OTHERS);
    int64_t mask = near_owners(s, i, j, need);
    if (!mask) return;
    const double *paddings = find_paddings(s, i, j);
    for (int64_t ea = 0; ea < one.count; ea++) {
        for (int64_t eb = i == j ? ea + 1 : 0; eb < two.count; eb++) {
            double padding = padding_between(s, one, ea, two, eb, paddings), apart = INFINITY;
            if (padding < 0.0) continue;
            int64_t near = mask;
            if (i != j)
                near = near_slices(s, s->element_slices, s->element_count, one.index + ea, a_moves, two.index + eb,
                                   b_moves, need + padding, mask, &apart);
            note_proven(s, GROUP_OTHERS, apart - padding);
            if (!near) continue;
            add_bodies(s, one, ea, two, eb, near, padding);
        }
    }
}

// ---- single times ------------------------------------------------------------------------------

// The smallest clearance found at a time [m], and its pair of elements.
typedef struct {
    double clearance;
    int64_t a, b;
} NearestElements;

// Look for a smaller clearance between two elements at the current poses, to about `tolerance`.
static void find_nearest_bodies(RefereeSearch *s, Owner one, int64_t ea, Owner two, int64_t eb, double padding, double time,
                                double tolerance, NearestElements *best) {
    const RefereeModel *model_a = model_of(s, one.arm), *model_b = model_of(s, two.arm);
    const int64_t *in_a = model_a->element_bodies + one.first + ea, *in_b = model_b->element_bodies + two.first + eb;
    int64_t k = spare_pair(s);
    for (int64_t a = in_a[0]; a < in_a[1]; a++) {
        for (int64_t b = in_b[0]; b < in_b[1]; b++) {
            BodyView body_a = view_of(s, one.arm, a), body_b = view_of(s, two.arm, b);
            if (is_plane(body_a)) {
                BodyView plane = body_a;
                body_a = body_b;
                body_b = plane;
            }
            if (ball_gap(body_a, body_b, padding).gap >= best->clearance) continue;
            if (box_gap(body_a, body_b, padding) >= best->clearance) continue;
            set_pair(s, k, one.arm, a, two.arm, b, k, 0, padding);
            s->elements[k] = (ElementPair){one.index + ea, two.index + eb, PAIR_FREE, k, INFINITY, 0.0, INFINITY};
            double value = bound_clearance(s, k, best->clearance - tolerance, best->clearance).upper;
            note_clearance(s, k, value, time);
            if (!(value < best->clearance)) continue;
            *best = (NearestElements){value, one.index + ea, two.index + eb};
        }
    }
}

// Likewise between owners i <= j.
static void find_nearest_elements(RefereeSearch *s, int64_t i, int64_t j, double time, double tolerance,
                                  NearestElements *best) {
    const BoundingBox *box_a = &s->owner_boxes[i], *box_b = &s->owner_boxes[j];
    double near = best->clearance + s->most_padding;
    if (i != j && (axis_separation(box_a, box_b) >= near || box_separation(box_a, box_b) >= near)) return;
    Owner one = owner_of(s, i), two = owner_of(s, j);
    const double *paddings = find_paddings(s, i, j);
    for (int64_t ea = 0; ea < one.count; ea++) {
        const BoundingBox *box = &s->element_boxes[one.index + ea];
        for (int64_t eb = i == j ? ea + 1 : 0; eb < two.count; eb++) {
            double padding = padding_between(s, one, ea, two, eb, paddings);
            if (padding < 0.0) continue;
            if (box_separation(box, &s->element_boxes[two.index + eb]) - padding >= best->clearance) continue;
            find_nearest_bodies(s, one, ea, two, eb, padding, time, tolerance, best);
        }
    }
}

// Find the smallest clearance below `best` between the owners from `first` to `stop` and all later ones.
//
// The nearest pair so far comes first: most others are then too far away to need a search.
static NearestElements find_nearest_others(RefereeSearch *s, int64_t first, int64_t stop, double time, double tolerance,
                                           NearestElements best) {
    int64_t k = nearest_pair(s, GROUP_OTHERS);
    const RefereePair *nearest = &s->pairs[k];
    int64_t earlier = lesser_index(nearest->arm_a, nearest->arm_b);
    if (s->has_nearest[GROUP_OTHERS] && earlier >= first && earlier < stop) {
        double value = bound_clearance(s, k, best.clearance - tolerance, best.clearance).upper;
        note_clearance(s, k, value, time);
        if (value < best.clearance) best = (NearestElements){value, s->elements[k].a, s->elements[k].b};
    }
    for (int64_t i = first; i < stop; i++) {
        if (i < s->moving_count) {
            for (int64_t j = i + 1; j < s->owner_count; j++) find_nearest_elements(s, i, j, time, tolerance, &best);
            continue;
        }
        int64_t count = find_near_owners(s, i, i + 1, best.clearance + s->most_padding);
        for (int64_t n = 0; n < count; n++) find_nearest_elements(s, i, s->near_owners[n], time, tolerance, &best);
    }
    return best;
}

static void find_nearest_own(RefereeSearch *s, double time, double tolerance) {
    NearestElements best = {s->smallest[GROUP_OWN], -1, -1};
    int64_t k = nearest_pair(s, GROUP_OWN);
    if (s->has_nearest[GROUP_OWN] && s->pairs[k].arm_a < s->moving_count) {
        double value = bound_clearance(s, k, best.clearance - tolerance, best.clearance).upper;
        note_clearance(s, k, value, time);
        best.clearance = lesser(best.clearance, value);
    }
    for (int64_t i = 0; i < s->moving_count; i++) find_nearest_elements(s, i, i, time, tolerance, &best);
}
