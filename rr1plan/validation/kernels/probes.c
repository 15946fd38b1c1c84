// Entries for tests: single steps of the search.

// Where all bodies are at a local time of a piece, and how far they can get within `half` of it.
EXPORT void rr1_probe_interval(RefereeSearch *s, int64_t piece, double at, double half) {
    pose_bodies(s, piece, at, half);
    add_velocities(s);
    for (int64_t i = 0; i < s->mover_count; i++) sweep_body(s, s->movers[i]);
}

EXPORT double rr1_probe_unsteadiness(const RefereeSearch *s, int64_t b, int64_t shared) {
    return unsteadiness(s, b, shared);
}

EXPORT double rr1_probe_steady_reach(const RefereeSearch *s, int64_t b, int64_t last, int64_t shared, double time,
                                     const double d[3]) {
    return steady_reach(s, b, last, shared, time, (Direction){d[0], d[1], d[2]});
}

EXPORT double rr1_probe_reach(const RefereeBodies *all, const PlacedBody *placed, int64_t b, const double d[3]) {
    return body_reach(all, placed, b, (Direction){d[0], d[1], d[2]});
}

// Upper and lower bound of the distance of two bodies without their roundings: `bounds`, shape (2,).
EXPORT void rr1_probe_separation(const RefereeBodies *all, const PlacedBody *placed, int64_t a, int64_t b,
                                 GjkState *state, double base, double enough, double *bounds) {
    Separation found = separate(all, placed, a, b, state, base, enough);
    bounds[0] = found.upper;
    bounds[1] = found.lower;
}
