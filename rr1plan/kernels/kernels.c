// All kernels as one translation unit, so that functions called in loops are inlined.
#include <stddef.h>

#include "scene_tables.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

// One configuration: exact distances.
#include "fk.c"
#include "gjk.c"
#include "mesh_gap.c"
#include "distance.c"
#include "certify_curve.c"
#include "clearance.c"
#include "raster.c"
#include "pair_lists.c"
#include "place_solids.c"
#include "map_distances.c"
#include "coordination.c"
#include "certify_timed.c"
// Eight at once: spheres, clearance maps, separating directions.
#include "fk_simd.c"
#include "sphere_tests.c"
#include "clearance_map.c"
#include "gjk_simd.c"
#include "mesh_simd.c"
#include "broad_phase.c"
#include "certify_edge.c"
// Loops of planners, which certify edges.
#include "trees.c"
#include "tree_samples.c"
#include "rrt_connect.c"
#include "check_endpoints.c"
#include "shortcut.c"
#include "replan_arm.c"
#include "roadmap.c"
#include "astar.c"
#include "polyline.c"
#include "chain.c"
#include "inverse_kinematics.c"
// Motions along paths.
#include "path_grid.c"
#include "parameterize.c"
#include "timed_pieces.c"
#include "blends.c"
#include "hops.c"
// Entries for tests.
#include "probes.c"
#include "planner_probes.c"
// Simulations, which pages do not have.
#include "arm_dynamics.h"
#ifndef __wasm__
#include "arm_dynamics.c"
#include "sample_pieces.c"
#endif
#include "../binding/cpu_level.c"
// Offsets of all tables as this compiler has them; made by the build from the headers.
#include "layout.inc"
