# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A roadmap: free configurations, and edges between near ones; `ways.py` looks for the shortest way along them.

Vertices are joined to their nearest ones, as many as keep shortest ways in reach (Karaman and Frazzoli,
Sampling-based algorithms for optimal motion planning, 2011).

Edge e is the pair of half-edges 2 e and 2 e + 1, one for each direction; the half-edges out of a vertex are a
linked list. Columns that wrap around hold angles in [-pi, pi), and edges go the short way.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, int8, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw_between
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, OUT1, OUT2, jit

# How far the samples got.
GOING, FULL = range(2)
# What is known of an edge.
UNKNOWN, FREE, BLOCKED = range(3)

# Entries of `counts`: vertices and edges so far, samples drawn, edges asked for.
VERTICES, EDGES, SAMPLES, ASKED = range(4)

TURN = 2.0 * np.pi
_BLOCK = 64
MARKS = types.Array(boolean, 1, "C", readonly=True)
_STATES = int8[::1]
# Ends and next half-edges in the list, what is known of each, lengths of edges, first half-edges of vertices.
GRAPH = types.Tuple((INT1, INT1, _STATES, OUT1, INT1))


@jit(F64(F64), inline=True, allocates=False)
def _short_way(difference):
    """The same turn, the short way."""
    return difference - TURN * np.rint(difference / TURN)


@jit(F64(OUT2, I64, I64, MARKS), allocates=False)
def vertex_distance(vertices, a, b, wraps):
    """Distance of two vertices, the short way."""
    square = 0.0
    for j in range(len(wraps)):
        difference = vertices[j, a] - vertices[j, b]
        if wraps[j]:
            difference = _short_way(difference)
        square += difference * difference
    return np.sqrt(square)


@jit(types.void(OUT2, I64, FLOATS1, MARKS, OUT1), allocates=False)
def _square_distances(vertices, count, q, wraps, squares):
    """Squared distances of the first vertices from q."""
    for i in range(count):
        squares[i] = 0.0
    for j in range(len(q)):
        value = q[j]
        row = vertices[j]
        if wraps[j]:
            for i in range(count):
                difference = _short_way(row[i] - value)
                squares[i] += difference * difference
        else:
            for i in range(count):
                difference = row[i] - value
                squares[i] += difference * difference


@jit(I64(OUT2, I64, FLOATS1, MARKS, I64, OUT1, INT1, OUT1), allocates=False)
def nearest_few(vertices, count, q, wraps, most, squares, nearest, distances):
    """The nearest vertices, nearest first, the first of equals before the others; how many there are.

    Args:
        vertices: One a column, shape (nq, capacity).
        count: How many there are.
        q: Configuration, shape (nq,).
        wraps: Which columns are angles that wrap around, shape (nq,).
        most: How many to find.
        squares: Scratch memory, shape (count,).
        nearest: Out: their indices, shape (most,).
        distances: Out: their distances, shape (most,).
    """
    _square_distances(vertices, count, q, wraps, squares)
    found = 0
    for i in range(count):
        if found == most and squares[i] >= distances[found - 1]:
            continue
        k = found if found < most else most - 1
        while k > 0 and distances[k - 1] > squares[i]:
            distances[k], nearest[k] = distances[k - 1], nearest[k - 1]
            k -= 1
        distances[k], nearest[k] = squares[i], i
        found = min(found + 1, most)
    for k in range(found):
        distances[k] = np.sqrt(distances[k])
    return found


@jit(I64(I64, I64), entry=True, ahead=False, allocates=False)
def neighbours_of(count, nq):
    """How many neighbours a vertex is joined to among so many."""
    return int(np.ceil(np.e * (1.0 + 1.0 / nq) * np.log(count + 1.0)))


@jit(types.void(GRAPH, INT1, I64, I64, F64), allocates=False)
def _join(graph, counts, a, b, length):
    """One more edge."""
    ends, following, known, lengths, first = graph
    e = counts[EDGES]
    counts[EDGES] = e + 1
    lengths[e] = length
    for h, origin, target in ((2 * e, a, b), (2 * e + 1, b, a)):
        ends[h] = target
        known[h] = UNKNOWN
        following[h] = first[origin]
        first[origin] = h


@jit(types.void(OUT2, GRAPH, INT1, FLOATS1, MARKS, I64, OUT1, INT1, OUT1), allocates=False)
def _insert(vertices, graph, counts, q, wraps, among, squares, nearest, distances):
    """One more vertex, joined to the nearest of the first `among`."""
    nq = len(q)
    v = counts[VERTICES]
    found = nearest_few(
        vertices, among, q, wraps, min(len(nearest), neighbours_of(among, nq)), squares, nearest, distances
    )
    for j in range(nq):
        vertices[j, v] = q[j]
    graph[4][v] = -1
    counts[VERTICES] = v + 1
    for k in range(found):
        _join(graph, counts, v, nearest[k], distances[k])


@jit(I64(OUT2, GRAPH, INT1, STATE, FLOATS1, FLOATS1, MARKS, I64, CONTEXT), entry=True, ahead=False)
def sample(vertices, graph, counts, state, lower, extent, wraps, samples, context):
    """Draw configurations and insert those that are free.

    Args:
        vertices: One a column, shape (nq, capacity).
        graph: See `GRAPH`.
        counts: See the constants of this file, shape (4,).
        state: Of the generator, shape (1,).
        lower: Corner of the box to sample, shape (nq,).
        extent: Its sides, shape (nq,).
        wraps: Which columns wrap around, shape (nq,).
        samples: `counts[SAMPLES]` to stop at.
        context: See `edge_code`.

    Returns:
        GOING, or FULL when the arrays have to be made larger.
    """
    nq, capacity = vertices.shape
    most = neighbours_of(capacity, nq)
    q, squares, nearest, distances = np.empty(nq), np.empty(capacity), np.empty(most, np.int64), np.empty(most)
    while counts[SAMPLES] < samples:
        if counts[VERTICES] == capacity or counts[EDGES] + most > len(graph[3]):
            return FULL
        draw_between(state, lower, extent, q)
        counts[SAMPLES] += 1
        counts[ASKED] += 1
        if edge_code(q, q, context) == 0:
            _insert(vertices, graph, counts, q, wraps, counts[VERTICES], squares, nearest, distances)
    return GOING


@jit(types.void(OUT2, GRAPH, INT1, FLOATS2, MARKS), entry=True, ahead=False)
def attach(vertices, graph, counts, ends, wraps):
    """Insert the ends of a question: its start, then its goals; the start is joined to each goal, too.

    Args:
        vertices: One a column, shape (nq, capacity).
        graph: See `GRAPH`.
        counts: See the constants of this file.
        ends: Start and goals, shape (k, nq).
        wraps: Which columns wrap around, shape (nq,).
    """
    known, nq = counts[VERTICES], vertices.shape[0]
    most = neighbours_of(known, nq)
    squares, nearest, distances = np.empty(known), np.empty(most, np.int64), np.empty(most)
    for i in range(len(ends)):
        _insert(vertices, graph, counts, ends[i], wraps, known, squares, nearest, distances)
    for i in range(1, len(ends)):
        _join(graph, counts, known, known + i, vertex_distance(vertices, known, known + i, wraps))


@jit(types.void(OUT2, GRAPH, INT1, FLOATS2, MARKS), entry=True, ahead=False)
def learn(vertices, graph, counts, path, wraps):
    """Insert the waypoints of a free path, and its edges; they are asked for like all others.

    Args:
        vertices: One a column, shape (nq, capacity).
        graph: See `GRAPH`.
        counts: See the constants of this file.
        path: Waypoints, shape (n, nq).
        wraps: Which columns wrap around, shape (nq,).
    """
    most = neighbours_of(counts[VERTICES] + len(path), vertices.shape[0])
    squares, nearest, distances = np.empty(counts[VERTICES] + len(path)), np.empty(most, np.int64), np.empty(most)
    for i in range(len(path)):
        v = counts[VERTICES]
        _insert(vertices, graph, counts, path[i], wraps, v, squares, nearest, distances)
        if i > 0:
            _join(graph, counts, v - 1, v, vertex_distance(vertices, v - 1, v, wraps))


@jit(types.void(GRAPH, INT1, I64, I64), entry=True, ahead=False, allocates=False)
def detach(graph, counts, vertices, edges):
    """Take back all vertices and edges after the first so many."""
    ends, following, first = graph[0], graph[1], graph[4]
    for e in range(counts[EDGES] - 1, edges - 1, -1):
        # The latest edge is at the head of both lists.
        for h in (2 * e + 1, 2 * e):
            first[ends[h ^ 1]] = following[h]
    counts[EDGES] = edges
    counts[VERTICES] = vertices
