// A path that is being shortened.
#ifndef RR1_SHORTCUT_H
#define RR1_SHORTCUT_H

#include <stdint.h>

enum { SHORTCUT_FRESH, SHORTCUT_SKIPPING, SHORTCUT_CUTTING, SHORTCUT_SKIPPING_AGAIN, SHORTCUT_DONE };

// A shortcut in collision: the section that it would have replaced, by arc lengths along the path.
typedef struct {
    double begin;
    double end;
    int64_t joint;  // the one that was straightened; -1: all
} FailedShortcut;

// Capacity of the list of failed shortcuts.
enum { SHORTCUT_MEMORY = 64 };

typedef struct {
    double *points;  // waypoints, with capacity for two more per shortcut; shape (capacity, nq)
    double *piece;   // scratch, shape (capacity, nq)
    double *along;   // scratch: lengths along the path up to each waypoint; shape (capacity,)
    int64_t column_count;
    int64_t size;    // waypoints in use
    int64_t stage;   // SHORTCUT_FRESH to begin with
    int64_t place;   // waypoint to continue from when skipping
    int64_t tried;   // shortcuts so far
    int64_t idle;    // consecutive shortcuts without gain
    int64_t edges;   // checked so far
    int64_t failed_count;
    FailedShortcut failed[64];
} ShortcutPath;

#endif
