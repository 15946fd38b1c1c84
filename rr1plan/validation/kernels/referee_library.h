// Functions that the referee needs from the C library. WebAssembly has no library: square roots are instructions, the
// page provides trigonometric functions, and sorting is below.
#ifndef RR1_REFEREE_LIBRARY_H
#define RR1_REFEREE_LIBRARY_H

#include <stddef.h>
#include <stdint.h>

#ifndef __wasm__
#include <math.h>
#include <stdlib.h>
#else
#define INFINITY __builtin_inf()
#define fabs __builtin_fabs
#define sqrt __builtin_sqrt

__attribute__((import_module("math"), import_name("sin"))) double sin(double angle);
__attribute__((import_module("math"), import_name("cos"))) double cos(double angle);
__attribute__((import_module("math"), import_name("atan2"))) double atan2(double y, double x);

// Insertion sort of items of eight or sixteen bytes: the owners along an axis are few and nearly sorted.
static inline void qsort(void *items, size_t count, size_t size, int (*compare)(const void *, const void *)) {
    char *rows = items;
    for (size_t i = 1; i < count; i++)
        for (size_t k = i; k > 0 && compare(rows + (k - 1) * size, rows + k * size) > 0; k--)
            for (size_t byte = 0; byte < size; byte++) {
                char kept = rows[k * size + byte];
                rows[k * size + byte] = rows[(k - 1) * size + byte];
                rows[(k - 1) * size + byte] = kept;
            }
}
#endif

#endif
