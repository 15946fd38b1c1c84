// Checks of a motion without its scene: its numbers are finite, its times increase, its limits hold.

// Rounding error tolerated at a limit, relative to it.
#define LIMIT_ROUNDING 1e-9
// Jumps at breaks that may be due to rounding, and rates that count as rest [rad or m, per s].
#define POSITION_JUMP 1e-9
#define VELOCITY_JUMP 1e-7
#define ACCELERATION_JUMP 1e-6

// Whether times are finite and strictly increase, and each column's terms add up to at most `farthest` on each piece.
EXPORT int64_t rr1_makes_motion(const double *breaks, int64_t break_count, const double *coefficients, int64_t pieces,
                                int64_t terms, int64_t columns, double farthest) {
    if (!(fabs(breaks[0]) < INFINITY)) return 0;
    for (int64_t i = 0; i < pieces; i++) {
        double width = break_count > 1 ? breaks[i + 1] - breaks[i] : 0.0;
        if (break_count > 1 && !(width > 0.0 && width < INFINITY)) return 0;
        for (int64_t j = 0; j < columns; j++) {
            const double *term = coefficients + i * terms * columns + j;
            double power = 1.0, sum = 0.0;
            for (int64_t k = 0; k < terms; k++) {
                sum += fabs(term[k * columns]) * power;
                power *= width;
            }
            if (!(sum <= farthest)) return 0;
        }
    }
    return 1;
}

static void tighten(Tightest *row, double ratio, int64_t column, double time) {
    if (ratio > row->ratio) *row = (Tightest){ratio, (double)column, time};
}

// Flags for a column's positions: above `upper`, below `lower`.
static int64_t judge_position(const Peaks *peak, double lower, double upper, int64_t column, Tightest *row) {
    double half = 0.5 * (upper - lower), above = peak->high - upper, below = lower - peak->low;
    if (half > 0.0 && half < INFINITY) {
        tighten(row, 1.0 + above / half, column, peak->high_time);
        tighten(row, 1.0 + below / half, column, peak->low_time);
    }
    return (above > LIMIT_ROUNDING * greater(1.0, fabs(upper)) ? FLAW_ABOVE : 0) |
           (below > LIMIT_ROUNDING * greater(1.0, fabs(lower)) ? FLAW_BELOW : 0);
}

// Compare extremes with limits.
//
// A motion of zero duration is at rest. `limits`: shape (LIMIT_ROWS, columns). `tightest` has TIGHTEST_ROWS rows.
// `allowed`: tolerated jumps of position, velocity and acceleration, shape (3, columns). `flaws`: bits for each column.
// Returns the union of all columns' bits.
EXPORT int64_t rr1_judge_columns(int64_t break_count, const double *coefficients, int64_t pieces, int64_t terms,
                                 int64_t columns, const Peaks *peaks, const Jump *jumps, const double *end,
                                 const double *limits, Tightest *tightest, double *allowed, int64_t *flaws) {
    int64_t all = 0;
    for (int i = 0; i < TIGHTEST_ROWS; i++) tightest[i] = (Tightest){-INFINITY, 0.0, 0.0};
    for (int64_t j = 0; j < columns; j++) {
        double acceleration = limits[LIMIT_ACCELERATION * columns + j], scale = 1.0;
        for (int64_t i = 0; i < pieces; i++) scale = greater(scale, fabs(coefficients[i * terms * columns + j]));
        flaws[j] = judge_position(&peaks[j], limits[LIMIT_LOWER * columns + j], limits[LIMIT_UPPER * columns + j], j,
                                  &tightest[TIGHTEST_POSITION]);
        allowed[j] = POSITION_JUMP * scale;
        allowed[columns + j] = VELOCITY_JUMP;
        allowed[2 * columns + j] = limits[LIMIT_JERK * columns + j] < INFINITY
                                       ? ACCELERATION_JUMP * (acceleration < INFINITY ? greater(1.0, acceleration) : 1.0)
                                       : INFINITY;
        for (int order = 0; order < 3; order++)
            if (jumps[order * columns + j].size > allowed[order * columns + j]) flaws[j] |= FLAW_POSITION_JUMP << order;
        if (break_count > 1 && terms > 1 && fabs(coefficients[columns + j]) > VELOCITY_JUMP) flaws[j] |= FLAW_START;
        if (break_count > 1 && fabs(end[columns + j]) > VELOCITY_JUMP) flaws[j] |= FLAW_END;
        for (int order = 1; order < TIGHTEST_ROWS; order++) {
            const Peaks *peak = &peaks[order * columns + j];
            double bound = limits[order * columns + j];
            int up = peak->high >= -peak->low;
            double value = up ? peak->high : -peak->low;
            if (!(bound < INFINITY)) continue;
            tighten(&tightest[order], value / bound, j, up ? peak->high_time : peak->low_time);
            if (value > bound * (1.0 + LIMIT_ROUNDING)) flaws[j] |= FLAW_VELOCITY << (order - 1);
        }
        all |= flaws[j];
    }
    return all;
}
