// A grid over two columns of q, and the pairs of bodies whose contacts are drawn on it.
#ifndef RR1_RASTER_TABLES_H
#define RR1_RASTER_TABLES_H

#include "exact_tables.h"

// Largest number of times that blocks of cells are quartered.
enum { RASTER_LEVELS = 16 };

typedef struct {
    int64_t columns[2];           // of q
    int64_t counts[2];            // cells along each
    const double *first;          // centers of the cells along the first column [rad or m]
    const double *second;         // along the second
    const double *configuration;  // values of all columns; those of the two are replaced
    int64_t pair_count;
    const ExactPair *pairs;
    const double *padding;
    Vec3 *directions;  // for each pair, where its last search ended
    int64_t *open;           // pairs that are undecided in a block, shape (RASTER_LEVELS, pair_count)
} RasterTables;

#endif
