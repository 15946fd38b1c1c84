// A growing roadmap: samples, and edges to their nearest neighbors.
//
// Vertices are joined to k nearest neighbors, with k of PRM* (Karaman and Frazzoli, Sampling-based algorithms for
// optimal motion planning, 2011).
#include "random.h"
#include "roadmap.h"

// Distance of two vertices, with joints that wrap.
static double vertex_distance(const RoadmapGraph *graph, int64_t a, int64_t b) {
    double square = 0.0;
    for (int64_t j = 0; j < graph->column_count; j++) {
        const double *row = graph->vertices + j * graph->capacity;
        double difference = row[a] - row[b];
        if (graph->wraps[j]) difference -= nearest_turns(difference, WHOLE_TURN);
        square += difference * difference;
    }
    return sqrt_number(square);
}

// Find the nearest of the first `count` vertices, nearest first, ties by index. Returns their number.
//
// At most `max_count` are written to `nearest` and `distances`; `squares` is scratch of `count` numbers.
static int64_t find_neighbors(const RoadmapGraph *graph, int64_t count, const double *q, int64_t max_count,
                              double *squares, int64_t *nearest, double *distances) {
    for (int64_t i = 0; i < count; i++) squares[i] = 0.0;
    for (int64_t j = 0; j < graph->column_count; j++) {
        const double *row = graph->vertices + j * graph->capacity;
        double value = q[j];
        if (graph->wraps[j]) {
            for (int64_t i = 0; i < count; i++) {
                double difference = row[i] - value;
                difference -= nearest_turns(difference, WHOLE_TURN);
                squares[i] += difference * difference;
            }
        } else {
            for (int64_t i = 0; i < count; i++) {
                double difference = row[i] - value;
                squares[i] += difference * difference;
            }
        }
    }
    int64_t found = 0;
    for (int64_t i = 0; i < count; i++) {
        if (found == max_count && squares[i] >= distances[found - 1]) continue;
        int64_t k = found < max_count ? found++ : max_count - 1;
        for (; k > 0 && distances[k - 1] > squares[i]; k--) {
            distances[k] = distances[k - 1];
            nearest[k] = nearest[k - 1];
        }
        distances[k] = squares[i];
        nearest[k] = i;
    }
    for (int64_t k = 0; k < found; k++) distances[k] = sqrt_number(distances[k]);
    return found;
}

static void add_edge(RoadmapGraph *graph, int64_t a, int64_t b, double length) {
    int64_t e = graph->edge_count++, origins[2] = {a, b};
    graph->lengths[e] = length;
    for (int64_t side = 0; side < 2; side++) {
        int64_t h = 2 * e + side;
        graph->ends[h] = origins[1 - side];
        graph->known[h] = EDGE_UNKNOWN;
        graph->next[h] = graph->first[origins[side]];
        graph->first[origins[side]] = h;
    }
}

// Add a vertex and join it to the nearest of the first `among` vertices.
static void insert_vertex(RoadmapGraph *graph, const double *q, int64_t among) {
    int64_t v = graph->vertex_count++, *nearest = graph->indices;
    double *squares = graph->distances, *distances = squares + graph->capacity;
    int64_t found = find_neighbors(graph, among, q, graph->degrees[among], squares, nearest, distances);
    for (int64_t j = 0; j < graph->column_count; j++) graph->vertices[j * graph->capacity + v] = q[j];
    graph->first[v] = -1;
    for (int64_t k = 0; k < found; k++) add_edge(graph, v, nearest[k], distances[k]);
}

// Draw configurations from a box until `samples` have been drawn in all, and insert those that are free.
//
// `q` is scratch, shape (nq,). Returns ROADMAP_GOING, or ROADMAP_FULL if the arrays have to be enlarged.
EXPORT int64_t rr1_sample_roadmap(RoadmapGraph *graph, uint64_t *random, const double *lower, const double *extent,
                                  double *q, int64_t samples, const SceneTables *scene, Scratch *scratch) {
    int64_t max_degree = graph->degrees[graph->capacity];
    while (graph->samples < samples) {
        if (graph->vertex_count == graph->capacity || graph->edge_count + max_degree > graph->edge_capacity)
            return ROADMAP_FULL;
        draw_in_box(random, lower, extent, graph->column_count, q);
        graph->samples++;
        graph->checks++;
        if (rr1_certify_edge(scene, scratch, q, q) == EDGE_FREE) insert_vertex(graph, q, graph->vertex_count);
    }
    return ROADMAP_GOING;
}

// Insert the ends of a query, its start, then its goals, shape (count, nq); the start is also joined to each goal.
EXPORT void rr1_attach_ends(RoadmapGraph *graph, const double *ends, int64_t count) {
    int64_t start = graph->vertex_count;
    for (int64_t i = 0; i < count; i++) insert_vertex(graph, ends + i * graph->column_count, start);
    for (int64_t i = 1; i < count; i++) add_edge(graph, start, start + i, vertex_distance(graph, start, start + i));
}

// Insert the waypoints of a free path, shape (count, nq), and its edges, which are checked like all others.
EXPORT void rr1_learn_path(RoadmapGraph *graph, const double *path, int64_t count) {
    for (int64_t i = 0; i < count; i++) {
        int64_t v = graph->vertex_count;
        insert_vertex(graph, path + i * graph->column_count, v);
        if (i > 0) add_edge(graph, v - 1, v, vertex_distance(graph, v - 1, v));
    }
}

// Keep the first `vertices` vertices and `edges` edges, remove the others.
EXPORT void rr1_truncate_roadmap(RoadmapGraph *graph, int64_t vertices, int64_t edges) {
    for (int64_t e = graph->edge_count - 1; e >= edges; e--)
        // The latest edge is at the head of both lists.
        for (int64_t h = 2 * e + 1; h >= 2 * e; h--) graph->first[graph->ends[h ^ 1]] = graph->next[h];
    graph->edge_count = edges;
    graph->vertex_count = vertices;
}
