// Certified shortcuts: skip waypoints; join two random points of the path, all joints straight or only one of them
// (Geraerts and Overmars, Creating high-quality paths for motion planning, 2007).
//
// Certifying a shortcut takes a hundred times as long as drawing one, so of several drawn ones the one with the largest
// gain is tried, where the gain is discounted if a similar one has failed.
//
// The function takes a number of steps and can be resumed: its whole state is in `ShortcutPath`.
#include "random.h"
#include "shortcut.h"

// Shortcuts drawn for each that is tried.
enum { SHORTCUT_CANDIDATES = 8 };
// Smallest gain of a shortcut that is tried, as a fraction of the path length.
#define MIN_GAIN 3e-3
// Discount for a shortcut that replaces a section that contains that of a failed one.
#define FAILURE_DISCOUNT 0.1
// Ends of shortcuts closer to a waypoint than this are moved to it [rad].
#define SNAP_LENGTH 1e-3

// The section that a shortcut replaces: from a point on edge i to one on edge j, by arc lengths along the path.
typedef struct {
    int64_t i, j;
    double begin, end;
    int64_t joint;  // the one that is straightened, below 0: all
} Shortcut;

static double row_distance(const double *a, const double *b, int64_t nq) {
    double square = 0.0;
    for (int64_t k = 0; k < nq; k++) {
        double difference = b[k] - a[k];
        square += difference * difference;
    }
    return sqrt_number(square);
}

INLINE void copy_row(const double *from, double *to, int64_t nq) {
    for (int64_t k = 0; k < nq; k++) to[k] = from[k];
}

// Remove consecutive duplicates.
static void drop_repeats(ShortcutPath *path) {
    int64_t nq = path->column_count, kept = 1;
    for (int64_t i = 1; i < path->size; i++) {
        const double *last = path->points + (kept - 1) * nq, *row = path->points + i * nq;
        int same = 1;
        for (int64_t k = 0; k < nq; k++) same = same && last[k] == row[k];
        if (!same) copy_row(row, path->points + kept++ * nq, nq);
    }
    path->size = kept;
}

static int waypoint_edge_is_free(ShortcutPath *path, const double *a, const double *b, const SceneTables *scene,
                                 Scratch *scratch) {
    path->edges++;
    return edge_from_free_is_free(scene, scratch, a, b);
}

// Connect waypoint `place` to one as far ahead as is free; tries the last one, then half as far, and so on.
static void skip_waypoints(ShortcutPath *path, const SceneTables *scene, Scratch *scratch) {
    int64_t nq = path->column_count, i = path->place, jump = path->size - 1 - i;
    double *points = path->points;
    while (jump > 1 && !waypoint_edge_is_free(path, points + i * nq, points + (i + jump) * nq, scene, scratch)) jump /= 2;
    if (jump > 1) {
        for (int64_t k = i + jump; k < path->size; k++) copy_row(points + k * nq, points + (k - jump + 1) * nq, nq);
        path->size -= jump - 1;
    }
    path->place = i + 1;
}

// Lengths along the path up to each waypoint. Returns the length of the whole path.
static double measure_path(ShortcutPath *path) {
    int64_t nq = path->column_count;
    path->along[0] = 0.0;
    for (int64_t k = 1; k < path->size; k++)
        path->along[k] = path->along[k - 1] + row_distance(path->points + (k - 1) * nq, path->points + k * nq, nq);
    return path->along[path->size - 1];
}

// The arc length, or that of a waypoint if it is so close that the edge between them would be negligible.
static double snap_to_waypoint(double place, const ShortcutPath *path) {
    for (int64_t i = 0; i < path->size; i++)
        if (abs_number(path->along[i] - place) < SNAP_LENGTH) return path->along[i];
    return place;
}

static Shortcut draw_shortcut(const ShortcutPath *path, uint64_t *random) {
    const double *along = path->along;
    int64_t last = path->size - 2;
    double whole = along[path->size - 1];
    double one = draw_uniform(random) * whole, two = draw_uniform(random) * whole;
    int64_t joint = draw_index(random, path->column_count + 2) - 2;
    double begin = snap_to_waypoint(min_number(one, two), path), end = snap_to_waypoint(max_number(one, two), path);
    int64_t i = 0, j = last;
    while (i < last && along[i + 1] <= begin) i++;
    while (j > 0 && along[j] >= end) j--;
    return (Shortcut){i, j, begin, end, joint};
}

// The point of edge i at a length along the path.
static void point_at(const ShortcutPath *path, int64_t i, double place, double *out) {
    int64_t nq = path->column_count;
    const double *a = path->points + i * nq, *b = a + nq, *along = path->along;
    double fraction = (place - along[i]) / (along[i + 1] - along[i]);
    for (int64_t k = 0; k < nq; k++)
        out[k] = fraction <= 0.0 ? a[k] : fraction >= 1.0 ? b[k] : a[k] + fraction * (b[k] - a[k]);
}

// Write the replacement of a section of the path to `piece`. Returns its number of rows.
static int64_t make_piece(const ShortcutPath *path, const Shortcut *cut) {
    int64_t nq = path->column_count, last = cut->joint < 0 ? 1 : cut->j - cut->i + 1;
    double *piece = path->piece, *end = piece + last * nq;
    point_at(path, cut->i, cut->begin, piece);
    point_at(path, cut->j, cut->end, end);
    for (int64_t k = 1; k < last; k++) {
        double *row = piece + k * nq;
        copy_row(path->points + (cut->i + k) * nq, row, nq);
        double fraction = (path->along[cut->i + k] - cut->begin) / (cut->end - cut->begin);
        row[cut->joint] = piece[cut->joint] + fraction * (end[cut->joint] - piece[cut->joint]);
    }
    return last + 1;
}

// Length of the section minus length of its replacement.
static double gain_of(const ShortcutPath *path, const Shortcut *cut, int64_t rows) {
    int64_t nq = path->column_count;
    double gain = cut->end - cut->begin;
    for (int64_t k = 0; k < rows - 1; k++) gain -= row_distance(path->piece + k * nq, path->piece + (k + 1) * nq, nq);
    return gain;
}

INLINE int64_t failed_joint(const Shortcut *cut) { return cut->joint < -1 ? -1 : cut->joint; }

// Estimated probability that a shortcut is free, given the failed ones: 1 if none is similar.
static double discount_of(const ShortcutPath *path, const Shortcut *cut) {
    double discount = 1.0;
    for (int64_t k = 0; k < path->failed_count; k++) {
        const FailedShortcut *failed = &path->failed[k];
        double first = failed->begin, last = failed->end;
        if (failed->joint != failed_joint(cut) || first >= cut->end || cut->begin >= last) continue;
        double shared = (min_number(cut->end, last) - max_number(cut->begin, first)) /
                        max_number(cut->end - cut->begin, last - first);
        int contains = cut->begin <= first && last <= cut->end;
        discount *= contains ? FAILURE_DISCOUNT : 1.0 - (1.0 - FAILURE_DISCOUNT) * shared;
    }
    return discount;
}

// Store a failed shortcut; replaces the oldest one if the list is full.
static void remember_failure(ShortcutPath *path, const Shortcut *cut) {
    if (path->failed_count == SHORTCUT_MEMORY) {
        path->failed_count--;
        for (int64_t k = 0; k < path->failed_count; k++) path->failed[k] = path->failed[k + 1];
    }
    path->failed[path->failed_count++] = (FailedShortcut){cut->begin, cut->end, failed_joint(cut)};
}

// Shift failed shortcuts along a path that became shorter by `gain` in a section; drop those in that section.
static void shift_failures(ShortcutPath *path, const Shortcut *cut, double gain) {
    int64_t kept = 0;
    for (int64_t k = 0; k < path->failed_count; k++) {
        FailedShortcut failed = path->failed[k];
        int encloses = failed.begin <= cut->begin && cut->end <= failed.end;
        if (failed.end > cut->begin && failed.begin < cut->end && !encloses) continue;
        failed.begin -= failed.begin >= cut->end ? gain : 0.0;
        failed.end -= failed.end >= cut->end ? gain : 0.0;
        path->failed[kept++] = failed;
    }
    path->failed_count = kept;
}

// Replace waypoints i + 1 .. j by the piece.
static void replace_waypoints(ShortcutPath *path, const Shortcut *cut, int64_t rows) {
    int64_t nq = path->column_count, size = path->size, shift = rows - (cut->j - cut->i);
    double *points = path->points;
    if (shift > 0)
        for (int64_t k = size - 1; k > cut->j; k--) copy_row(points + k * nq, points + (k + shift) * nq, nq);
    if (shift < 0)
        for (int64_t k = cut->j + 1; k < size; k++) copy_row(points + k * nq, points + (k + shift) * nq, nq);
    for (int64_t k = 0; k < rows; k++) copy_row(path->piece + k * nq, points + (cut->i + 1 + k) * nq, nq);
    path->size = size + shift;
    drop_repeats(path);
}

// Try the most promising of several random shortcuts. Returns whether it replaced a part of the path.
static int try_shortcut(ShortcutPath *path, uint64_t *random, const SceneTables *scene, Scratch *scratch) {
    int64_t nq = path->column_count;
    double min_gain = MIN_GAIN * measure_path(path), best_gain = 0.0;
    Shortcut best = {0, 0, 0.0, 0.0, 0};
    for (int candidate = 0; candidate < SHORTCUT_CANDIDATES; candidate++) {
        Shortcut cut = draw_shortcut(path, random);
        if (cut.i >= cut.j) continue;
        double gain = gain_of(path, &cut, make_piece(path, &cut));
        if (gain < min_gain) continue;
        gain *= discount_of(path, &cut);
        if (gain > best_gain) {
            best_gain = gain;
            best = cut;
        }
    }
    if (best.i >= best.j) return 0;
    int64_t rows = make_piece(path, &best);
    for (int64_t k = 0; k < rows - 1; k++) {
        const double *row = path->piece + k * nq;
        if (!waypoint_edge_is_free(path, row, row + nq, scene, scratch)) {
            remember_failure(path, &best);
            return 0;
        }
    }
    shift_failures(path, &best, gain_of(path, &best, rows));
    replace_waypoints(path, &best, rows);
    return 1;
}

// Skip waypoints, try random shortcuts, skip waypoints again: at most `steps` steps.
//
// At most `shortcuts` are tried, and at most `patience` consecutive ones without gain. Returns 1 when done.
EXPORT int64_t rr1_shorten(ShortcutPath *path, uint64_t *random, int64_t steps, int64_t shortcuts, int64_t patience,
                           const SceneTables *scene, Scratch *scratch) {
    if (path->stage == SHORTCUT_FRESH) {
        drop_repeats(path);
        path->stage = SHORTCUT_SKIPPING;
    }
    for (; steps > 0 && path->stage != SHORTCUT_DONE; steps--) {
        if (path->stage == SHORTCUT_CUTTING) {
            if (path->size < 3 || path->tried == shortcuts || path->idle >= patience) {
                path->stage = SHORTCUT_SKIPPING_AGAIN;
                path->place = 0;
            } else {
                path->tried++;
                path->idle = try_shortcut(path, random, scene, scratch) ? 0 : path->idle + 1;
            }
        } else if (path->place < path->size - 2) {
            skip_waypoints(path, scene, scratch);
        } else {
            path->stage = path->stage == SHORTCUT_SKIPPING ? SHORTCUT_CUTTING : SHORTCUT_DONE;
        }
    }
    return path->stage == SHORTCUT_DONE;
}
