// Arena allocator for arrays whose size is only known at run time.
//
// Kernels do not allocate memory. If the block is used up, a kernel returns ARENA_FULL and its caller repeats
// the call with a larger one.
#ifndef RR1_ARENA_H
#define RR1_ARENA_H

#include <stdint.h>

typedef struct {
    double *memory;
    int64_t size;  // numbers
    int64_t used;  // numbers
} Arena;

enum { ARENA_FULL = -2 };

#endif
