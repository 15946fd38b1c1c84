// Maps of the distance of two bodies, over the one or two columns of q that move them relative to each other.
//
// Links close to each other in the chain are always near, so spheres never separate them, but few joints move them
// relative to each other. A cell of the map holds a lower bound of the distance anywhere in it: the distance at its
// middle minus a bound of the relative motion. Undecided cells are divided into quarters, down to the finest.
#include "scene_tables.h"

// Added to the travel for rounding errors [m].
#define MAP_TRAVEL_ROUNDING 1e-9
// Cells are stored in single precision [m].
#define MAP_CELL_ROUNDING 1e-7
// Parts of a cell along each side, a power of two.
enum { MAP_PARTS = 4 };
// A bound is sharp enough if it is MAP_SHARP times the distance in the middle, or MAP_PADDING, the usual size of
// paddings [m]; distances up to MAP_CONTACT are contacts [m].
#define MAP_SHARP 0.6
#define MAP_PADDING 0.0025
#define MAP_CONTACT 1e-5

typedef struct {
    double around;  // lower bound within some reach of a configuration [m]
    double middle;  // lower bound in the configuration [m]
} MapBounds;

// Bounds of the distance of the first pair within `reach` of q, both up to `most`.
static MapBounds bound_distance(const double q[2], const double reach[2], double most, const ExactTables *exact,
                                ExactScratch *scratch) {
    const ExactPair *pair = &exact->pairs[0];
    int64_t bodies[2] = {pair->body, pair->other};
    double moved = 0.0;
    place_joints(q, exact, scratch);
    for (int k = 0; k < 2; k++) {
        if (!moves(&exact->bodies[bodies[k]])) continue;
        place_body(bodies[k], exact, scratch);
        bound_travel(bodies[k], reach, exact, scratch);
        moved += scratch->travel[bodies[k] * scratch->travel_stride + pair->shared];
    }
    moved = moved * SLACK + MAP_TRAVEL_ROUNDING;
    double enough = most + moved;
    GapBounds gap = fine_gap(bodies[0], bodies[1], enough, enough, &scratch->directions[0], exact, scratch);
    return (MapBounds){gap.lower - moved, gap.lower};
}

// An undecided square of parts of cells, and a lower bound of the distance in it [m].
typedef struct {
    int64_t x, y, size;
    double bound;
} MapSquare;

INLINE float lesser_float(float a, double b) { return (double)a < b ? a : (float)b; }

// Compute lower bounds of the distance of the first pair, cell by cell, at most `most` [m].
//
// `distances` has shape (rows, width), rows a power of two, width equal to it or 1. `ranges`: low, high, low, high of
// the one or two columns of q of the map [rad or m].
EXPORT void rr1_map_distances(const double *ranges, double most, int64_t rows, int64_t width, const ExactTables *exact,
                              ExactScratch *scratch, float *distances) {
    int64_t across = width > 1 ? MAP_PARTS : 1;
    double part = (ranges[1] - ranges[0]) / (double)(rows * MAP_PARTS);
    double part2 = (ranges[3] - ranges[2]) / (double)(width * across);
    double q[2] = {0.0, 0.0}, reach[2] = {0.0, 0.0};
    MapSquare stack[4 * 64];
    int64_t count = 1;
    stack[0] = (MapSquare){0, 0, rows * MAP_PARTS, -INFINITY};
    scratch->directions[0] = (Vec3){0.0, 0.0, 0.0};
    for (int64_t i = 0; i < rows * width; i++) distances[i] = (float)most;
    while (count > 0) {
        MapSquare square = stack[--count];
        int64_t x = square.x, y = square.y, size = square.size, i = x / MAP_PARTS, k = y / across;
        int64_t cells = size > MAP_PARTS ? size / MAP_PARTS : 1;
        float *cell = &distances[i * width + k];
        if (size < MAP_PARTS && (*cell <= MAP_CONTACT || *cell <= square.bound - MAP_CELL_ROUNDING)) {
            // Smaller squares cannot improve this cell.
            *cell = lesser_float(*cell, square.bound - MAP_CELL_ROUNDING);
            continue;
        }
        if (width > 1) {
            q[1] = ranges[2] + ((double)y + 0.5 * (double)size) * part2;
            reach[1] = 0.5 * (double)size * part2 * SLACK + 1e-12;
        }
        q[0] = ranges[0] + ((double)x + 0.5 * (double)size) * part;
        reach[0] = 0.5 * (double)size * part * SLACK + 1e-12;
        MapBounds bounds = bound_distance(q, reach, most, exact, scratch);
        // A bound of a square holds for its parts.
        double bound = max_number(square.bound, bounds.around);
        int sharp = bounds.middle <= MAP_CONTACT || bound >= min_number(MAP_SHARP * bounds.middle, MAP_PADDING);
        if (bound >= most || size == 1 || (size <= MAP_PARTS && sharp)) {
            double least = min_number(bound, most) - MAP_CELL_ROUNDING;
            for (int64_t row = i; row < i + cells; row++)
                for (int64_t column = k; column < k + cells && column < width; column++)
                    distances[row * width + column] = lesser_float(distances[row * width + column], least);
            continue;
        }
        int64_t half = size / 2;
        for (int64_t one = 0; one < 2; one++)
            for (int64_t other = 0; other < (width > 1 ? 2 : 1); other++)
                stack[count++] = (MapSquare){x + one * half, y + other * half, half, bound};
    }
}

// Count the cells before each corner of a map with less than the least distance [m]: a summed-area table.
//
// `distances` has shape (rows, width), `counts` (rows + 1, width + 1): small integers, so that many maps fit the cache.
EXPORT void rr1_count_near_cells(const float *distances, int64_t rows, int64_t width, double least, int16_t *counts) {
    for (int64_t y = 0; y <= width; y++) counts[y] = 0;
    for (int64_t x = 0; x < rows; x++) {
        int16_t along = 0, *row = counts + (x + 1) * (width + 1);
        row[0] = 0;
        for (int64_t y = 0; y < width; y++) {
            along = (int16_t)(along + !((double)distances[x * width + y] >= least));
            row[y + 1] = (int16_t)(row[y + 1 - (width + 1)] + along);
        }
    }
}
