// Entries for tests: single steps of the certified edge and of the exact kernel.

INLINE void probe_sphere(SphereRef sphere, f64x8 h, const SceneTables *scene, const Scratch *scratch,
                         SphereProbe *probe) {
    Vec8 v = velocity_of(sphere, scene, scratch);
    const f64x8 *center = scratch->spheres[sphere.index].center;
    *probe = (SphereProbe){{center[0], center[1], center[2]}, travel_of(sphere, h, scene, scratch), {v.x, v.y, v.z}};
}

// Place all spheres at the middles of eight intervals of a parabola, shape (3, nq), and bound their displacement there.
//
// They count as placed for batch 1; `probes` has an entry for each sphere of the arms.
EXPORT void rr1_place_spheres(const SceneTables *scene, Scratch *scratch, const double *curve, const double middles[8],
                              const double halves[8], SphereProbe *probes) {
    const ArmGeometry *arm = scene->arm;
    f64x8 h = load_lanes(halves);
    for (int64_t c = 0; c < 3 * scene->column_count; c++) scratch->curve[c] = curve[c];
    scratch->edge++;
    bound_motion(scene, scratch);
    place_frames(load_lanes(middles), scene, scratch);
    for (int64_t g = 0; g < arm->group_count; g++) {
        SphereRef ball = ball_of_group(g, arm);
        place_centers(arm->groups[g].joint, ball.index, ball.index + 1, scene, scratch);
        probe_sphere(ball, h, scene, scratch, &probes[ball.index]);
        for (int64_t b = arm->groups[g].first_body; b < arm->groups[g].last_body; b++) {
            const Body *body = &arm->bodies[b];
            place_centers(body->joint, body->first_sphere, body->last_sphere, scene, scratch);
            scratch->placed_batch[b] = 1;
            for (int64_t i = body->first_sphere; i < body->last_sphere; i++)
                probe_sphere(sphere_in(body, i), h, scene, scratch, &probes[i]);
        }
    }
}

// Bounds of the motion of joints, shape (joint_count,), and groups, shape (group_count, bound_rows), on the last edge.
EXPORT void rr1_copy_bounds(const SceneTables *scene, const Scratch *scratch, JointMotion *joints, double *speeds,
                            double *accelerations) {
    for (int64_t j = 0; j < scene->arm->joint_count; j++) joints[j] = scratch->joint_motions[j];
    int64_t stride = scene->arm->group_stride, rows = scratch->bound_rows;
    for (int64_t g = 0; g < scene->arm->group_count; g++)
        for (int64_t row = 0; row < rows; row++) {
            speeds[g * rows + row] = scratch->speeds[row * stride + g];
            accelerations[g * rows + row] = scratch->accelerations[row * stride + g];
        }
}

// Test a candidate by directions, at the last positions of spheres: lanes that are open, stuck, touching.
EXPORT void rr1_separate(const SceneTables *scene, Scratch *scratch, const Candidate *candidate, double half,
                         uint64_t lanes[3]) {
    scratch->edge++;  // no direction is known yet
    Separation8 found = separate(candidate, splat(half), scene, scratch);
    lanes[0] = found.open;
    lanes[1] = found.stuck;
    lanes[2] = found.touching;
}

// Test a candidate by spheres, at their last positions: lanes that are open, touching.
EXPORT void rr1_test_spheres(const SceneTables *scene, Scratch *scratch, const Candidate *candidate, double half,
                             uint64_t lanes[2]) {
    f64x8 h = splat(half);
    SphereTest found;
    if (candidate->body_pair < 0) {
        found = test_obstacle(candidate->body, candidate->other, candidate->pair, candidate->lanes, 1, h, scene, scratch);
    } else {
        found = test_body(&scene->pairs->body_pairs[candidate->body_pair], candidate->lanes, 1, h, scene, scratch);
    }
    lanes[0] = found.open;
    lanes[1] = found.touching;
}

// The lowest value of a core along eight directions in its frame, shape (3, 8), and its point; `out`: shape (4, 8).
EXPORT void rr1_lowest_corner(const SceneTables *scene, int64_t core, int64_t lanes, const double *directions,
                              double *out) {
    Vec8 n = {load_lanes(directions), load_lanes(directions + LANES), load_lanes(directions + 2 * LANES)};
    Support8 low = lowest_of(scene->arm, core, n, (uint64_t)lanes);
    f64x8 values[4] = {low.along, low.point.x, low.point.y, low.point.z};
    for (int k = 0; k < 4; k++) store_lanes(out + k * LANES, values[k]);
}

// Bounds of the displacement of bodies from q; shape (body_count, travel_stride), see `ExactScratch.travel`.
EXPORT void rr1_bound_travel(const ExactTables *exact, ExactScratch *scratch, const double *q, const double *reach,
                             double *travel) {
    int64_t stride = scratch->travel_stride;
    place_joints(q, exact, scratch);
    for (int64_t b = 0; b < exact->body_count; b++) {
        if (!moves(&exact->bodies[b])) continue;
        place_body(b, exact, scratch);
        bound_travel(b, reach, exact, scratch);
        int64_t links = exact->bodies[b].last_link - exact->bodies[b].first_link;
        for (int64_t k = 0; k <= links; k++) travel[b * stride + k] = scratch->travel[b * stride + k];
    }
}

// Position of a curve at the middle of an interval, and the largest change of each column from it, shape (nq,) each.
//
// `work` has the shape of the coefficients, (terms, nq).
EXPORT void rr1_place_interval(const double *coefficients, int64_t terms, int64_t nq, double duration, double middle,
                               double half, double *work, double *q, double *reach) {
    Curve curve = {coefficients, terms, duration};
    ExactScratch scratch = {.coefficients = work, .q = q, .reach = reach};
    place_interval(&curve, middle, half, nq, &scratch);
}

// Bounds of the distance of two placed bodies [m], lower and upper; see `fine_gap`.
EXPORT void rr1_gap_bounds(const ExactTables *exact, const ExactScratch *scratch, int64_t a, int64_t b, double least,
                           double enough, Vec3 *direction, double bounds[2]) {
    GapBounds gap = fine_gap(a, b, least, enough, direction, exact, scratch);
    bounds[0] = gap.lower;
    bounds[1] = gap.upper;
}

// Sines and cosines of angles of any size, shape (count,) each.
EXPORT void rr1_sine_cosine(const double *angles, int64_t count, double *sines, double *cosines) {
    for (int64_t i = 0; i < count; i++) {
        Sine of = sine_cosine(angles[i]);
        sines[i] = of.sine;
        cosines[i] = of.cosine;
    }
}

// Likewise in SIMD lanes, for angles up to MAX_LANE_ANGLE; the count is a multiple of LANES.
EXPORT void rr1_sine_cosine_lanes(const double *angles, int64_t count, double *sines, double *cosines) {
    for (int64_t i = 0; i < count; i += LANES) {
        SineLanes of = sine_cosine_lanes(load_lanes(angles + i));
        store_lanes(sines + i, of.sine);
        store_lanes(cosines + i, of.cosine);
    }
}
