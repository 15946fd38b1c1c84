// Entries for tests: single steps of the search.

// Poses of the bodies of arm 0 at a local time of a piece, and bounds of their motion within `half` of it.
EXPORT void rr1_probe_interval(RefereeSearch *s, int64_t piece, double at, double half) {
    expand_arm(s, 0, piece, at, half);
    move_links(s, 0);
    place_bodies(s, 0);
    add_velocities(s, 0);
    for (int64_t b = 0; b < model_of(s, 0)->bodies->body_count; b++) sweep_body(s, 0, b);
}

// Likewise over several pieces.
EXPORT void rr1_probe_pieces(RefereeSearch *s, int64_t first, int64_t stop) {
    TimeInterval interval = {.first = first, .stop = stop};
    set_chords(s);
    pose_links(s, 0, &interval, middle_of(s, &interval));
    place_bodies(s, 0);
    add_velocities(s, 0);
    for (int64_t b = 0; b < model_of(s, 0)->bodies->body_count; b++) sweep_body(s, 0, b);
}

// Largest deviation of a body of arm 0 from its steady velocity.
EXPORT double rr1_probe_unsteadiness(const RefereeSearch *s, int64_t b, int64_t shared) {
    return unsteadiness(s, 0, b, shared);
}

// Support of a body of arm 0 along d, relative to its frame's origin.
EXPORT double rr1_probe_steady_reach(const RefereeSearch *s, int64_t b, int64_t last, int64_t before, double time,
                                     const double d[3]) {
    return steady_reach(s, view_of(s, 0, b), last, before, time, (Direction){d[0], d[1], d[2]});
}

EXPORT double rr1_probe_reach(const RefereeBodies *all, const PlacedBody *placed, int64_t b, const double d[3]) {
    return body_reach((BodyView){all, b, &placed[b]}, (Direction){d[0], d[1], d[2]});
}

// Upper and lower bound of the distance of two bodies without their rounding radii: `bounds`, shape (2,).
EXPORT void rr1_probe_separation(const RefereeBodies *all, const PlacedBody *placed, int64_t a, int64_t b,
                                 GjkState *state, double base, double enough, double *bounds) {
    Separation found = separate((BodyView){all, a, &placed[a]}, (BodyView){all, b, &placed[b]}, state, base, enough);
    bounds[0] = found.upper;
    bounds[1] = found.lower;
}

// Distances to keep between all elements [m], negative where contact is allowed: `table`, shape (elements, elements),
// upper triangle.
EXPORT void rr1_probe_paddings(const RefereeSearch *s, double *table) {
    for (int64_t i = 0; i < s->owner_count; i++) {
        for (int64_t j = i; j < s->owner_count; j++) {
            Owner one = owner_of(s, i), two = owner_of(s, j);
            const double *paddings = find_paddings(s, i, j);
            for (int64_t a = 0; a < one.count; a++)
                for (int64_t b = i == j ? a + 1 : 0; b < two.count; b++)
                    table[(one.index + a) * s->element_count + two.index + b] =
                        padding_between(s, one, a, two, b, paddings);
        }
    }
}
