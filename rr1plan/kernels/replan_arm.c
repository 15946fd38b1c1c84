// A new motion of one arm among others whose motions are given: a search in its configurations and in time.
//
// A tree grows from the start of the arm. Samples are drawn from the configurations and times that the arm can reach
// from its start, and from which it can reach its goal in time, at its largest speeds: all other samples are useless
// (informed sampling: Gammell et al., 2014; in space and time: Grothe et al., ST-RRT*, 2022). Each new vertex is
// connected straight to the goal if that is free. Shortcuts then remove detours of the tree.
//
// Only pairs that involve the arm are tested, except those with arms that are left out; the caller knows that all others
// are free. The edges are those of the joint space of all arms, whose tables exist already; `certify_timed.c` takes any
// trajectories, but has to set up its own.
#include "random.h"
#include "replan_arm.h"

// Longest edge of the tree, as a share of the duration.
#define LONGEST_EDGE 0.25
// Weight of the time to a vertex beside the time that the arm needs at full speed.
#define TIME_WEIGHT 0.3
// Share of the samples that are moved toward the straight line from the start to the goal, and by how much.
#define NEAR_LINE 0.3
#define LINE_SHARE 0.7
// Probability that a shortcut begins at the start, and likewise that it ends at the goal.
#define FROM_END 0.3

static const double *start_of(const ArmReplan *search) { return search->points + search->first_column; }

static const double *goal_of(const ArmReplan *search) {
    return search->points + (search->count - 1) * search->column_count + search->first_column;
}

// The time that the arm needs between two configurations at its largest speeds.
INLINE double least_time(const ArmReplan *search, const double *a, const double *b) {
    double longest = 0.0;
    for (int64_t j = 0; j < search->width; j++) longest = max_number(longest, abs_number(b[j] - a[j]) / search->velocity[j]);
    return longest;
}

// Write the configuration of all arms at a time on the edge before waypoint `k`, on which this arm moves from a to b.
static void place_arms(const ArmReplan *search, int64_t k, double time, const double *a, const double *b, double share,
                       double *q) {
    int64_t nq = search->column_count;
    const double *before = search->points + (k - 1) * nq, *after = before + nq;
    double fraction = (time - search->times[k - 1]) / (search->times[k] - search->times[k - 1]);
    for (int64_t c = 0; c < nq; c++) q[c] = fraction < 1.0 ? before[c] + fraction * (after[c] - before[c]) : after[c];
    for (int64_t j = 0; j < search->width; j++)
        q[search->first_column + j] = share < 1.0 ? a[j] + share * (b[j] - a[j]) : b[j];
}

// Whether the arm can move straight from a to b in a span of time while the others follow their motions.
static int timed_edge_is_free(const ArmReplan *search, const double *a, double begin, const double *b, double end,
                              const SceneTables *scene, Scratch *scratch) {
    double *from = search->memory, *to = from + search->column_count, time = begin;
    int64_t k = 1;
    while (k < search->count - 1 && search->times[k] <= begin) k++;
    place_arms(search, k, begin, a, b, 0.0, from);
    while (time < end) {
        time = min_number(search->times[k], end);
        place_arms(search, k, time, a, b, (time - begin) / (end - begin), to);
        if (!edge_from_free_is_free(scene, scratch, from, to)) return 0;
        double *passed = from;
        from = to;
        to = passed;
        if (k == search->count - 1) break;
        k += time == search->times[k];
    }
    return 1;
}

// Draw a configuration and a time that can be part of a motion. Returns the time, below zero if rounding leaves none.
static double draw_timed_sample(const ArmReplan *search, double duration, uint64_t *random, double *q) {
    const double *start = start_of(search), *goal = goal_of(search);
    double time = duration * draw_uniform(random), left = duration - time;
    double kept = draw_uniform(random) < NEAR_LINE ? 1.0 - LINE_SHARE : 1.0;
    for (int64_t j = 0; j < search->width; j++) {
        double speed = search->velocity[j];
        double low = max_number(search->lower[j], max_number(start[j] - speed * time, goal[j] - speed * left));
        double high = min_number(search->upper[j], min_number(start[j] + speed * time, goal[j] + speed * left));
        if (!(low <= high)) return -1.0;
        double line = start[j] + time / duration * (goal[j] - start[j]);
        q[j] = line + kept * (low + draw_uniform(random) * (high - low) - line);
    }
    return time;
}

// The vertex from which the arm best reaches a sample in time, below zero: none.
static int64_t best_vertex(const ArmReplan *search, int64_t size, const double *q, double time) {
    int64_t best = -1;
    double least = INFINITY;
    for (int64_t i = 0; i < size; i++) {
        double span = time - search->reached[i], needed = least_time(search, search->vertices + i * search->width, q);
        double cost = needed + TIME_WEIGHT * span;
        if (span <= 0.0 || needed > span || cost >= least) continue;
        least = cost;
        best = i;
    }
    return best;
}

// Write the motion to the goal by way of a vertex. Returns its number of waypoints.
static int64_t trace_motion(ArmReplan *search, int64_t vertex, double duration) {
    int64_t width = search->width, count = 1;
    for (int64_t i = vertex; i >= 0; i = search->parents[i]) count++;
    int64_t row = count - 1;
    copy_row(goal_of(search), search->knots + row * width, width);
    search->knot_times[row] = duration;
    for (int64_t i = vertex; i >= 0; i = search->parents[i]) {
        row--;
        copy_row(search->vertices + i * width, search->knots + row * width, width);
        search->knot_times[row] = search->reached[i];
    }
    return count;
}

// Grow the tree until it reaches the goal, from where the last call ended. Returns the number of waypoints of the motion,
// 0 if there is none.
static int64_t grow_timed_tree(ArmReplan *search, double duration, uint64_t *random, const SceneTables *scene,
                               Scratch *scratch) {
    const double *goal = goal_of(search);
    int64_t width = search->width;
    double *q = search->memory + 2 * search->column_count;
    if (search->size == 0) {
        copy_row(start_of(search), search->vertices, width);
        search->reached[0] = 0.0;
        search->parents[0] = -1;
        search->size = 1;
        if (timed_edge_is_free(search, search->vertices, 0.0, goal, duration, scene, scratch))
            return trace_motion(search, 0, duration);
    }
    for (; search->drawn < search->samples; search->drawn++) {
        int64_t size = search->size;
        double time = draw_timed_sample(search, duration, random, q);
        int64_t parent = time > 0.0 ? best_vertex(search, size, q, time) : -1;
        if (parent < 0) continue;
        const double *from = search->vertices + parent * width;
        double begin = search->reached[parent], fraction = min_number(1.0, LONGEST_EDGE * duration / (time - begin));
        double *to = search->vertices + size * width;
        for (int64_t j = 0; j < width; j++) to[j] = fraction < 1.0 ? from[j] + fraction * (q[j] - from[j]) : q[j];
        time = begin + fraction * (time - begin);
        if (time >= duration || !timed_edge_is_free(search, from, begin, to, time, scene, scratch)) continue;
        search->reached[size] = time;
        search->parents[size] = parent;
        if (timed_edge_is_free(search, to, time, goal, duration, scene, scratch))
            return trace_motion(search, size, duration);
        search->size++;
    }
    return 0;
}

// The configuration of the new motion at a time, and the first waypoint after it.
static int64_t motion_at(const ArmReplan *search, int64_t count, double time, double *q) {
    int64_t k = 1;
    while (k < count - 1 && search->knot_times[k] <= time) k++;
    const double *before = search->knots + (k - 1) * search->width, *after = before + search->width;
    double fraction = (time - search->knot_times[k - 1]) / (search->knot_times[k] - search->knot_times[k - 1]);
    for (int64_t j = 0; j < search->width; j++)
        q[j] = fraction < 1.0 ? before[j] + fraction * (after[j] - before[j]) : after[j];
    return k;
}

// Move straight between two random times where that is free and saves a waypoint. Returns the number of waypoints.
static int64_t shorten_motion(ArmReplan *search, int64_t count, uint64_t *random, const SceneTables *scene,
                              Scratch *scratch) {
    int64_t width = search->width;
    double *a = search->memory + 2 * search->column_count, *b = a + width;
    for (int64_t tried = 0; tried < search->shortcuts && count > 2; tried++) {
        double duration = search->knot_times[count - 1];
        double one = duration * draw_uniform(random), two = duration * draw_uniform(random);
        double begin = draw_uniform(random) < FROM_END ? 0.0 : min_number(one, two);
        double end = draw_uniform(random) < FROM_END ? duration : max_number(one, two);
        int64_t first = motion_at(search, count, begin, a), last = motion_at(search, count, end, b);
        // Waypoints first .. behind - 1 are replaced by the ends of the shortcut; the start and the goal remain.
        int64_t behind = end == duration ? count - 1 : last, kept = (begin > 0.0) + (end < duration);
        if (behind - first <= kept || !timed_edge_is_free(search, a, begin, b, end, scene, scratch)) continue;
        int64_t row = first;
        if (begin > 0.0) {
            copy_row(a, search->knots + row * width, width);
            search->knot_times[row++] = begin;
        }
        if (end < duration) {
            copy_row(b, search->knots + row * width, width);
            search->knot_times[row++] = end;
        }
        for (int64_t k = behind; k < count; k++, row++) {
            copy_row(search->knots + k * width, search->knots + row * width, width);
            search->knot_times[row] = search->knot_times[k];
        }
        count = row;
    }
    return count;
}

// Search for a motion of the arm from its start to its goal in the time of the waypoints, and shorten it.
//
// Returns its number of waypoints in `knots`, 0 if none is found; a call with more samples then goes on with the search.
EXPORT int64_t rr1_replan_arm(ArmReplan *search, uint64_t *random, const SceneTables *scene, Scratch *scratch) {
    scratch->first_open_column = search->first_column;
    scratch->last_open_column = search->first_column + search->width;
    scratch->left_out = search->left_out;
    int64_t count = grow_timed_tree(search, search->times[search->count - 1], random, scene, scratch);
    if (count) count = shorten_motion(search, count, random, scene, scratch);
    scratch->last_open_column = 0;
    return count;
}
