// The shortest free path along a roadmap.
//
// An edge is checked only when it is part of the shortest path that may be free, and the result is stored (Bohlin and
// Kavraki, Path planning using lazy PRM, 2000). So the result is the shortest path along free edges, independent of
// earlier checks. Columns that wrap around are unrolled along it.
#include "roadmap.h"

// A binary heap of vertices by cost, least first; `place` is the last index of each vertex in the heap.
typedef struct {
    int64_t *vertices, *place, count;
    const double *costs;
} VertexHeap;

INLINE void heap_put(VertexHeap *heap, int64_t i, int64_t v) {
    heap->vertices[i] = v;
    heap->place[v] = i;
}

// Sift v up from index i of the heap.
static void heap_raise(VertexHeap *heap, int64_t i, int64_t v) {
    while (i > 0) {
        int64_t above = (i - 1) / 2;
        if (heap->costs[heap->vertices[above]] <= heap->costs[v]) break;
        heap_put(heap, i, heap->vertices[above]);
        i = above;
    }
    heap_put(heap, i, v);
}

// Remove the vertex of least cost.
static int64_t heap_pop(VertexHeap *heap) {
    int64_t top = heap->vertices[0], size = --heap->count, v = heap->vertices[size], i = 0;
    while (2 * i + 1 < size) {
        int64_t below = 2 * i + 1;
        if (below + 1 < size && heap->costs[heap->vertices[below + 1]] < heap->costs[heap->vertices[below]]) below++;
        if (heap->costs[heap->vertices[below]] >= heap->costs[v]) break;
        heap_put(heap, i, heap->vertices[below]);
        i = below;
    }
    heap_put(heap, i, v);
    return top;
}

// Distance of a vertex from the nearest goal: an admissible heuristic. Goals are the vertices begin .. end - 1.
static double goal_distance(const RoadmapGraph *graph, int64_t v, int64_t begin, int64_t end) {
    double best = INFINITY;
    for (int64_t goal = begin; goal < end; goal++) best = min_number(best, vertex_distance(graph, v, goal));
    return best;
}

// Write the half-edges of the shortest path from `start` to any later vertex, none of them known to be blocked. Returns
// their number, or -1.
//
// A* (Hart, Nilsson, Raphael 1968).
static int64_t shortest_path(const RoadmapGraph *graph, int64_t start, int64_t *steps) {
    int64_t size = graph->vertex_count, capacity = graph->capacity;
    double *best = graph->distances, *costs = best + capacity, *ahead = costs + capacity;
    int64_t *via = graph->indices;
    VertexHeap heap = {via + capacity, via + 2 * capacity, 1, costs};
    for (int64_t v = 0; v < size; v++) best[v] = INFINITY;
    best[start] = costs[start] = 0.0;
    via[start] = -1;
    heap_put(&heap, 0, start);
    while (heap.count > 0) {
        int64_t v = heap_pop(&heap);
        if (v > start) {
            int64_t rows = 0;
            for (; via[v] >= 0; v = graph->ends[via[v] ^ 1]) steps[rows++] = via[v];
            for (int64_t k = 0; k < rows / 2; k++) {
                int64_t step = steps[k];
                steps[k] = steps[rows - 1 - k];
                steps[rows - 1 - k] = step;
            }
            return rows;
        }
        for (int64_t h = graph->first[v]; h >= 0; h = graph->next[h]) {
            int64_t w = graph->ends[h];
            double length = best[v] + graph->lengths[h / 2];
            if (graph->known[h] == EDGE_KNOWN_BLOCKED || length >= best[w]) continue;
            if (best[w] == INFINITY) {
                ahead[w] = goal_distance(graph, w, start + 1, size);
                heap.place[w] = -1;
            }
            int64_t place = heap.place[w];
            // A removed vertex may be inserted again.
            if (place < 0 || place >= heap.count || heap.vertices[place] != w) place = heap.count++;
            best[w] = length;
            via[w] = h;
            costs[w] = length + ahead[w];
            heap_raise(&heap, place, w);
        }
    }
    return -1;
}

// Write the waypoints of a path from `begin` on, without jumps in columns that wrap around.
static void unroll_path(const RoadmapGraph *graph, const int64_t *steps, int64_t rows, const double *begin,
                        double *path) {
    int64_t nq = graph->column_count;
    for (int64_t j = 0; j < nq; j++) {
        path[j] = begin[j];
        for (int64_t k = 0; k < rows; k++) {
            double value = graph->vertices[j * graph->capacity + graph->ends[steps[k]]];
            if (graph->wraps[j]) value += nearest_turns(path[k * nq + j] - value, WHOLE_TURN);
            path[(k + 1) * nq + j] = value;
        }
    }
}

// Whether a path is free. Edges are checked in the direction of the path, and the results are stored.
//
// `recheck`: also check edges that are known to be free, because a copy shifted by a whole turn is another edge.
static int roadmap_path_is_free(RoadmapGraph *graph, const int64_t *steps, int64_t rows, const double *path, int recheck,
                                const SceneTables *scene, Scratch *scratch) {
    int64_t nq = graph->column_count;
    int free = 1;
    for (int64_t k = 0; k < rows; k++) {
        int64_t h = steps[k];
        if (graph->known[h] == EDGE_KNOWN_FREE && !recheck) continue;
        graph->checks++;
        if (rr1_certify_edge(scene, scratch, path + k * nq, path + (k + 1) * nq) == EDGE_FREE) {
            graph->known[h] = EDGE_KNOWN_FREE;
        } else {
            graph->known[h] = graph->known[h ^ 1] = EDGE_KNOWN_BLOCKED;
            free = 0;
        }
    }
    return free;
}

// The shortest free path from an attached start to the nearest of its goals, which are all later vertices; at most
// `attempts` paths are tried.
//
// `begin` is the start, not wrapped. Writes the waypoints to `path`, shape (vertex_count + 1, nq), their number to
// `rows`. Returns ASTAR_FOUND, ASTAR_NONE (there is no path), or ASTAR_GOING (all paths tried are blocked).
EXPORT int64_t rr1_find_roadmap_path(RoadmapGraph *graph, int64_t start, const double *begin, int64_t attempts,
                                     double *path, int64_t *rows, const SceneTables *scene, Scratch *scratch) {
    int64_t *steps = graph->indices + 3 * graph->capacity;
    int recheck = 0;
    *rows = 0;
    for (int64_t j = 0; j < graph->column_count; j++) recheck = recheck || graph->wraps[j];
    for (; attempts > 0; attempts--) {
        int64_t count = shortest_path(graph, start, steps);
        if (count < 0) return ASTAR_NONE;
        unroll_path(graph, steps, count, begin, path);
        if (roadmap_path_is_free(graph, steps, count, path, recheck, scene, scratch)) {
            *rows = count + 1;
            return ASTAR_FOUND;
        }
    }
    return ASTAR_GOING;
}
