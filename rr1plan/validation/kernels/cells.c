// How far a convex body is from the nearest cell of a point cloud.
//
// The search of `gjk.c` for one cell after the other, the nearest first. Boxes around blocks of cells and around single
// ones, and the plane that separated the body from the last cell, are lower bounds that leave few cells to search.

// Cells that could be nearer than the nearest by less than this are not searched [m].
#define CELL_ROUNDING 1e-9

// A lower bound of the distance of body 0 to an upright box [m]; 0 where the bounding boxes meet.
static double upright_box_gap(const RefereeBodies *all, const PlacedBody *placed, const double center[3],
                              const double half[3]) {
    const double *middle = placed[0].middle, *r = placed[0].rotation, *box = all->sizes[0].box;
    double x = center[0] - middle[0], y = center[1] - middle[1], z = center[2] - middle[2], total = 0.0;
    for (int j = 0; j < 3; j++) {
        double u = r[j], v = r[3 + j], w = r[6 + j];
        double along = fabs(u * x + v * y + w * z) - box[j] - (fabs(u) * half[0] + fabs(v) * half[1] + fabs(w) * half[2]);
        if (along > 0.0) total += along * along;
    }
    return sqrt(total);
}

static int64_t least_of(const double *numbers, int64_t count) {
    int64_t best = 0;
    for (int64_t i = 1; i < count; i++)
        if (numbers[i] < numbers[best]) best = i;
    return best;
}

// Distance of a convex body to the nearest cell and a proven bound of it [m], both 0 in contact, and the number of cells
// searched: `answer`, shape (3,).
//
// Body 0 is the convex body, body 1 a cell, whose pose is written. `centers` are those of the cells, block after block,
// shape (cells, 3), `half` half their edge; `middles` and `halves` are boxes around the blocks, shape (blocks, 3), of
// which each has `counts` cells from `firsts` on. `scratch` has room for blocks + the most cells of a block.
EXPORT void rr1_nearest_cell(const RefereeBodies *all, PlacedBody *placed, const double *centers, double half,
                             const double *middles, const double *halves, const int64_t *firsts, const int64_t *counts,
                             int64_t blocks, double *scratch, double *answer) {
    double *bound = scratch, *near = scratch + blocks;
    double best = 1e300, proven = 1e300, rounding = all->sizes[0].rounding;
    const double cell_half[3] = {half, half, half};
    BodyView body = {all, 0, &placed[0]}, cell = {all, 1, &placed[1]};
    GjkState state = {.count = 0};
    for (int64_t b = 0; b < blocks; b++) bound[b] = upright_box_gap(all, placed, middles + 3 * b, halves + 3 * b);
    answer[0] = answer[1] = answer[2] = 0.0;
    for (;;) {
        int64_t b = least_of(bound, blocks);
        if (bound[b] >= best - CELL_ROUNDING) break;
        bound[b] = INFINITY;
        const double *cells = centers + 3 * firsts[b];
        int64_t count = counts[b];
        for (int64_t i = 0; i < count; i++) near[i] = upright_box_gap(all, placed, cells + 3 * i, cell_half);
        for (;;) {
            int64_t i = least_of(near, count);
            if (near[i] >= best - CELL_ROUNDING) break;
            near[i] = INFINITY;
            answer[2] += 1.0;
            for (int k = 0; k < 3; k++) placed[1].origin[k] = placed[1].middle[k] = cells[3 * i + k];
            Separation found = separate(body, cell, &state, 1e300, best + rounding);
            if (found.lower - rounding <= 0.0) return;
            best = lesser(best, found.upper - rounding);
            proven = lesser(proven, found.lower - rounding);
            // All cells beyond the plane that separates the two are at least as far.
            Direction d = found.direction;
            const double *origin = placed[0].origin;
            double edge = body_reach(body, d) + half * (fabs(d.x) + fabs(d.y) + fabs(d.z));
            edge += d.x * origin[0] + d.y * origin[1] + d.z * origin[2];
            for (int64_t c = 0; c < count; c++)
                near[c] = greater(near[c], d.x * cells[3 * c] + d.y * cells[3 * c + 1] + d.z * cells[3 * c + 2] - edge);
        }
    }
    answer[0] = best;
    answer[1] = lesser(best, proven) - CELL_ROUNDING;
}
