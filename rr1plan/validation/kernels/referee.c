// The referee's own kernels as one translation unit. They share no source with those of the planners.
#include "referee_tables.h"
#include "referee_simd.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#include "referee_gjk.c"
#include "penetration.c"
#include "motion_bounds.c"
#include "referee_clearance.c"
#include "referee_broad_phase.c"
#include "memory.c"
#include "surfaces.c"
#include "part_tree.c"
#include "search.c"
#include "referee_extremes.c"
#include "limits.c"
#ifndef __wasm__
#include "referee_probes.c"  // for tests
#endif
#include "../../binding/cpu_level.c"
// Offsets in all tables for this compiler; the build generates them from the headers.
#include "layout.inc"
