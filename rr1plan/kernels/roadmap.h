// A roadmap: free configurations, and edges between near ones.
#ifndef RR1_ROADMAP_H
#define RR1_ROADMAP_H

#include <stdint.h>

// State of an edge.
enum { EDGE_UNKNOWN, EDGE_KNOWN_FREE, EDGE_KNOWN_BLOCKED };

// Edge e is the pair of half-edges 2 e and 2 e + 1, one for each direction; the half-edges out of a vertex are a linked
// list. Columns that wrap around hold angles in [-pi, pi], and edges go the short way.
typedef struct {
    double *vertices;       // one per column, shape (nq, capacity)
    int64_t *ends;          // target vertex of a half-edge, shape (2 edge_capacity,)
    int64_t *next;          // next half-edge out of the same vertex, -1: none; shape (2 edge_capacity,)
    int8_t *known;          // state of a half-edge; shape (2 edge_capacity,)
    double *lengths;        // of edges, shape (edge_capacity,)
    int64_t *first;         // first half-edge out of a vertex, -1: none; shape (capacity,)
    const uint8_t *wraps;   // which columns wrap around, shape (nq,)
    const int64_t *degrees;  // number of neighbors of a new vertex by the number of vertices; shape (capacity + 1,)
    int64_t column_count;   // nq
    int64_t capacity;
    int64_t edge_capacity;
    int64_t vertex_count;
    int64_t edge_count;
    int64_t samples;        // drawn so far
    int64_t checks;         // samples and edges checked so far
    double *distances;      // scratch, shape (3, capacity)
    int64_t *indices;       // scratch, shape (4, capacity)
} RoadmapGraph;

enum { ROADMAP_GOING, ROADMAP_FULL };
enum { ASTAR_GOING, ASTAR_FOUND, ASTAR_NONE };

#endif
