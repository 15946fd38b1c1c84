// Non-convex meshes: their triangles under trees of boxes, in the frame of the box around each mesh.
#ifndef RR1_MESH_TABLES_H
#define RR1_MESH_TABLES_H

#include <stdint.h>

typedef struct {
    int64_t root;    // of `nodes`
    int64_t closed;  // 1 if some of its triangles enclose a volume
} MeshRange;

// The boxes of LANES children: x of all, then y, then z [m]. Both corners of absent children are at MESH_NOWHERE.
typedef struct {
    double low[24];
    double high[24];
} MeshNode;

#define MESH_NOWHERE 1e30

typedef struct {
    double corners[9];  // one after the other [m]; those of a closed surface all face outward, or all inward
} MeshTriangle;

typedef struct {
    const MeshRange *ranges;  // of each mesh
    const MeshNode *nodes;
    const int64_t *children;  // first child of each node: a node, or on the lowest level -1 - a triangle
    const MeshTriangle *triangles;
    const int64_t *is_closed;  // 1 for each triangle of a closed surface, 0 for those of an open one
} MeshTables;

// Capacity for waiting nodes and triangles: for a tree of at most 16 levels.
enum { MESH_STACK = 128 };

#endif
