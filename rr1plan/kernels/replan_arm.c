// A new motion of one arm among others whose motions are given: a search in its configurations and in time.
//
// A tree grows from the start of the arm. Samples are drawn from the configurations and times that the arm can reach
// from its start, and from which it can reach its goal in time, at its largest speeds: all other samples are useless
// (informed sampling: Gammell et al., 2014; in space and time: Grothe et al., ST-RRT*, 2022). Each new vertex is
// connected straight to the goal if that is free. Shortcuts then remove detours of the tree.
//
// Only pairs that involve the arm are tested; the caller knows that all others are free.
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

static const double *start_of(const ArmReplan *arm) { return arm->points + arm->first_column; }

static const double *goal_of(const ArmReplan *arm) {
    return arm->points + (arm->count - 1) * arm->column_count + arm->first_column;
}

// The time that the arm needs between two configurations at its largest speeds.
INLINE double least_time(const ArmReplan *arm, const double *a, const double *b) {
    double longest = 0.0;
    for (int64_t j = 0; j < arm->width; j++) longest = max_number(longest, abs_number(b[j] - a[j]) / arm->velocity[j]);
    return longest;
}

// Write the configuration of all arms at a time on the edge before waypoint `k`, on which this arm moves from a to b.
static void place_arms(const ArmReplan *arm, int64_t k, double time, const double *a, const double *b, double share,
                       double *q) {
    int64_t nq = arm->column_count;
    const double *before = arm->points + (k - 1) * nq, *after = before + nq;
    double fraction = (time - arm->times[k - 1]) / (arm->times[k] - arm->times[k - 1]);
    for (int64_t c = 0; c < nq; c++) q[c] = fraction < 1.0 ? before[c] + fraction * (after[c] - before[c]) : after[c];
    for (int64_t j = 0; j < arm->width; j++)
        q[arm->first_column + j] = share < 1.0 ? a[j] + share * (b[j] - a[j]) : b[j];
}

// Whether the arm can move straight from a to b in a span of time while the others follow their motions.
static int timed_edge_is_free(const ArmReplan *arm, const double *a, double begin, const double *b, double end,
                              const SceneTables *scene, Scratch *scratch) {
    double *from = arm->memory, *to = from + arm->column_count, time = begin;
    int64_t k = 1;
    while (k < arm->count - 1 && arm->times[k] <= begin) k++;
    place_arms(arm, k, begin, a, b, 0.0, from);
    while (time < end) {
        time = min_number(arm->times[k], end);
        place_arms(arm, k, time, a, b, (time - begin) / (end - begin), to);
        if (!edge_from_free_is_free(scene, scratch, from, to)) return 0;
        double *passed = from;
        from = to;
        to = passed;
        if (k == arm->count - 1) break;
        k += time == arm->times[k];
    }
    return 1;
}

// Draw a configuration and a time that can be part of a motion. Returns the time, below zero if rounding leaves none.
static double draw_timed_sample(const ArmReplan *arm, double duration, uint64_t *random, double *q) {
    const double *start = start_of(arm), *goal = goal_of(arm);
    double time = duration * draw_uniform(random), left = duration - time;
    double kept = draw_uniform(random) < NEAR_LINE ? 1.0 - LINE_SHARE : 1.0;
    for (int64_t j = 0; j < arm->width; j++) {
        double speed = arm->velocity[j];
        double low = max_number(arm->lower[j], max_number(start[j] - speed * time, goal[j] - speed * left));
        double high = min_number(arm->upper[j], min_number(start[j] + speed * time, goal[j] + speed * left));
        if (!(low <= high)) return -1.0;
        double line = start[j] + time / duration * (goal[j] - start[j]);
        q[j] = line + kept * (low + draw_uniform(random) * (high - low) - line);
    }
    return time;
}

// The vertex from which the arm best reaches a sample in time, below zero: none.
static int64_t best_vertex(const ArmReplan *arm, int64_t size, const double *q, double time) {
    int64_t best = -1;
    double least = INFINITY;
    for (int64_t i = 0; i < size; i++) {
        double span = time - arm->reached[i], needed = least_time(arm, arm->vertices + i * arm->width, q);
        double cost = needed + TIME_WEIGHT * span;
        if (span <= 0.0 || needed > span || cost >= least) continue;
        least = cost;
        best = i;
    }
    return best;
}

// Write the motion to the goal by way of a vertex. Returns its number of waypoints.
static int64_t trace_motion(ArmReplan *arm, int64_t vertex, double duration) {
    int64_t width = arm->width, count = 1;
    for (int64_t i = vertex; i >= 0; i = arm->parents[i]) count++;
    int64_t row = count - 1;
    for (int64_t j = 0; j < width; j++) arm->knots[row * width + j] = goal_of(arm)[j];
    arm->knot_times[row] = duration;
    for (int64_t i = vertex; i >= 0; i = arm->parents[i]) {
        row--;
        for (int64_t j = 0; j < width; j++) arm->knots[row * width + j] = arm->vertices[i * width + j];
        arm->knot_times[row] = arm->reached[i];
    }
    return count;
}

// Grow the tree until it reaches the goal. Returns the number of waypoints of the motion, 0 if there is none.
static int64_t grow_timed_tree(ArmReplan *arm, double duration, uint64_t *random, const SceneTables *scene,
                               Scratch *scratch) {
    const double *goal = goal_of(arm);
    int64_t width = arm->width, size = 1;
    double *q = arm->memory + 2 * arm->column_count;
    for (int64_t j = 0; j < width; j++) arm->vertices[j] = start_of(arm)[j];
    arm->reached[0] = 0.0;
    arm->parents[0] = -1;
    if (timed_edge_is_free(arm, arm->vertices, 0.0, goal, duration, scene, scratch))
        return trace_motion(arm, 0, duration);
    for (int64_t drawn = 0; drawn < arm->samples; drawn++) {
        double time = draw_timed_sample(arm, duration, random, q);
        int64_t parent = time > 0.0 ? best_vertex(arm, size, q, time) : -1;
        if (parent < 0) continue;
        const double *from = arm->vertices + parent * width;
        double begin = arm->reached[parent], fraction = min_number(1.0, LONGEST_EDGE * duration / (time - begin));
        double *to = arm->vertices + size * width;
        for (int64_t j = 0; j < width; j++) to[j] = fraction < 1.0 ? from[j] + fraction * (q[j] - from[j]) : q[j];
        time = begin + fraction * (time - begin);
        if (time >= duration || !timed_edge_is_free(arm, from, begin, to, time, scene, scratch)) continue;
        arm->reached[size] = time;
        arm->parents[size] = parent;
        if (timed_edge_is_free(arm, to, time, goal, duration, scene, scratch))
            return trace_motion(arm, size, duration);
        size++;
    }
    return 0;
}

// The configuration of the new motion at a time, and the first waypoint after it.
static int64_t motion_at(const ArmReplan *arm, int64_t count, double time, double *q) {
    int64_t k = 1;
    while (k < count - 1 && arm->knot_times[k] <= time) k++;
    const double *before = arm->knots + (k - 1) * arm->width, *after = before + arm->width;
    double fraction = (time - arm->knot_times[k - 1]) / (arm->knot_times[k] - arm->knot_times[k - 1]);
    for (int64_t j = 0; j < arm->width; j++)
        q[j] = fraction < 1.0 ? before[j] + fraction * (after[j] - before[j]) : after[j];
    return k;
}

// Move straight between two random times where that is free and saves a waypoint. Returns the number of waypoints.
static int64_t shorten_motion(ArmReplan *arm, int64_t count, uint64_t *random, const SceneTables *scene,
                              Scratch *scratch) {
    int64_t width = arm->width;
    double *a = arm->memory + 2 * arm->column_count, *b = a + width;
    for (int64_t tried = 0; tried < arm->shortcuts && count > 2; tried++) {
        double duration = arm->knot_times[count - 1];
        double one = duration * draw_uniform(random), two = duration * draw_uniform(random);
        double begin = draw_uniform(random) < FROM_END ? 0.0 : min_number(one, two);
        double end = draw_uniform(random) < FROM_END ? duration : max_number(one, two);
        int64_t first = motion_at(arm, count, begin, a), last = motion_at(arm, count, end, b);
        // Waypoints first .. behind - 1 are replaced by the ends of the shortcut; the start and the goal remain.
        int64_t behind = end == duration ? count - 1 : last, kept = (begin > 0.0) + (end < duration);
        if (behind - first <= kept || !timed_edge_is_free(arm, a, begin, b, end, scene, scratch)) continue;
        int64_t row = first;
        if (begin > 0.0) {
            for (int64_t j = 0; j < width; j++) arm->knots[row * width + j] = a[j];
            arm->knot_times[row++] = begin;
        }
        if (end < duration) {
            for (int64_t j = 0; j < width; j++) arm->knots[row * width + j] = b[j];
            arm->knot_times[row++] = end;
        }
        for (int64_t k = behind; k < count; k++, row++) {
            for (int64_t j = 0; j < width; j++) arm->knots[row * width + j] = arm->knots[k * width + j];
            arm->knot_times[row] = arm->knot_times[k];
        }
        count = row;
    }
    return count;
}

// Search for a motion of the arm from its start to its goal in the time of the waypoints, and shorten it.
//
// Returns its number of waypoints in `knots`, 0 if none is found.
EXPORT int64_t rr1_replan_arm(ArmReplan *arm, uint64_t *random, const SceneTables *scene, Scratch *scratch) {
    scratch->first_open_column = arm->first_column;
    scratch->last_open_column = arm->first_column + arm->width;
    int64_t count = grow_timed_tree(arm, arm->times[arm->count - 1], random, scene, scratch);
    if (count) count = shorten_motion(arm, count, random, scene, scratch);
    scratch->last_open_column = 0;
    return count;
}
