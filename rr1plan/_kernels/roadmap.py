# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""A roadmap: free configurations, edges between near ones, the shortest way along them.

Vertices are joined to their nearest ones, as many as keep shortest ways in reach (Karaman and Frazzoli,
Sampling-based algorithms for optimal motion planning, 2011). An edge is only asked for when it is part of
the shortest way that may be free (Bohlin and Kavraki, Path planning using lazy PRM, 2000), and remembered. So
the answer is the shortest way along the free edges, whatever was asked before.

Edge e is the pair of half-edges 2 e and 2 e + 1, one for each direction; the half-edges out of a vertex are a
linked list. Columns that wrap around hold angles in [-pi, pi), edges go the short way, and ways are unrolled.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, int8, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.generator import STATE, draw_between
from rr1plan._kernels.jit import F64, FLOATS1, FLOATS2, I64, INT1, OUT1, OUT2, jit

GOING, FOUND, NONE, FULL = range(4)
UNKNOWN, FREE, BLOCKED = range(3)

# Entries of `counts`: vertices and edges so far, samples drawn, edges asked for.
VERTICES, EDGES, SAMPLES, ASKED = range(4)

_TURN = 2.0 * np.pi
_BLOCK = 64
_MARKS = types.Array(boolean, 1, "C", readonly=True)
_STATES = int8[::1]
# Ends and next half-edges in the list, what is known of each, lengths of edges, first half-edges of vertices.
GRAPH = types.Tuple((INT1, INT1, _STATES, OUT1, INT1))


@jit(F64(F64), inline=True, allocates=False)
def _short_way(difference):
    """The same turn, the short way."""
    return difference - _TURN * np.rint(difference / _TURN)


@jit(F64(OUT2, I64, I64, _MARKS), allocates=False)
def _distance(vertices, a, b, wraps):
    """Distance of two vertices."""
    square = 0.0
    for j in range(len(wraps)):
        difference = vertices[j, a] - vertices[j, b]
        if wraps[j]:
            difference = _short_way(difference)
        square += difference * difference
    return np.sqrt(square)


@jit(types.void(OUT2, I64, FLOATS1, _MARKS, OUT1), allocates=False)
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


@jit(I64(OUT2, I64, FLOATS1, _MARKS, I64, OUT1, INT1, OUT1), allocates=False)
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


@jit(I64(I64, I64), allocates=False)
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


@jit(types.void(OUT2, GRAPH, INT1, FLOATS1, _MARKS, I64, OUT1, INT1, OUT1), allocates=False)
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


@jit(I64(OUT2, GRAPH, INT1, STATE, FLOATS1, FLOATS1, _MARKS, I64, CONTEXT))
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


@jit(types.void(OUT2, GRAPH, INT1, FLOATS2, _MARKS))
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
        _join(graph, counts, known, known + i, _distance(vertices, known, known + i, wraps))


@jit(types.void(OUT2, GRAPH, INT1, FLOATS2, _MARKS))
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
            _join(graph, counts, v - 1, v, _distance(vertices, v - 1, v, wraps))


@jit(types.void(GRAPH, INT1, I64, I64), allocates=False)
def detach(graph, counts, vertices, edges):
    """Take back all vertices and edges after the first so many."""
    ends, following, first = graph[0], graph[1], graph[4]
    for e in range(counts[EDGES] - 1, edges - 1, -1):
        # The latest edge is at the head of both lists.
        for h in (2 * e + 1, 2 * e):
            first[ends[h ^ 1]] = following[h]
    counts[EDGES] = edges
    counts[VERTICES] = vertices


@jit(types.void(INT1, INT1, OUT1, I64, I64), allocates=False)
def _rise(heap, place, costs, i, v):
    """Put v where it belongs between place i of the heap and the top."""
    while i > 0:
        above = (i - 1) // 2
        if costs[heap[above]] <= costs[v]:
            break
        heap[i] = heap[above]
        place[heap[i]] = i
        i = above
    heap[i] = v
    place[v] = i


@jit(I64(INT1, INT1, OUT1, I64), allocates=False)
def _pop(heap, place, costs, count):
    """Take the cheapest of a heap of so many."""
    top, v = heap[0], heap[count - 1]
    size = count - 1
    i = 0
    while 2 * i + 1 < size:
        below = 2 * i + 1
        if below + 1 < size and costs[heap[below + 1]] < costs[heap[below]]:
            below += 1
        if costs[heap[below]] >= costs[v]:
            break
        heap[i] = heap[below]
        place[heap[i]] = i
        i = below
    heap[i] = v
    place[v] = i
    return top


@jit(F64(OUT2, I64, I64, I64, _MARKS), allocates=False)
def _least_ahead(vertices, v, begin, end, wraps):
    """Distance of a vertex from the nearest of the vertices begin .. end - 1."""
    best = np.inf
    for g in range(begin, end):
        best = min(best, _distance(vertices, v, g, wraps))
    return best


@jit(I64(OUT2, GRAPH, INT1, I64, _MARKS, INT1))
def _shortest_way(vertices, graph, counts, start, wraps, way):
    """Half-edges of the shortest way, none of them known to be blocked, from `start` to any later vertex; -1: no way.

    A* (Hart, Nilsson, Raphael 1968).
    """
    ends, following, known, lengths, first = graph
    size = counts[VERTICES]
    lowest, costs, ahead = np.empty(size), np.empty(size), np.empty(size)
    via, heap, place = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for v in range(size):
        lowest[v] = np.inf
    lowest[start], costs[start], via[start] = 0.0, 0.0, -1
    heap[0], place[start], count = start, 0, 1
    while count > 0:
        v = _pop(heap, place, costs, count)
        count -= 1
        if v > start:
            rows = 0
            while via[v] >= 0:
                way[rows] = via[v]
                v = ends[via[v] ^ 1]
                rows += 1
            for k in range(rows // 2):
                way[k], way[rows - 1 - k] = way[rows - 1 - k], way[k]
            return rows
        h = first[v]
        while h >= 0:
            w = ends[h]
            length = lowest[v] + lengths[h // 2]
            if known[h] != BLOCKED and length < lowest[w]:
                if lowest[w] == np.inf:
                    ahead[w] = _least_ahead(vertices, w, start + 1, size, wraps)
                    place[w] = -1
                if place[w] < 0 or heap[place[w]] != w or place[w] >= count:
                    place[w] = count
                    count += 1
                lowest[w], via[w] = length, h
                costs[w] = length + ahead[w]
                _rise(heap, place, costs, place[w], w)
            h = following[h]
    return -1


@jit(types.void(OUT2, GRAPH, INT1, I64, FLOATS1, _MARKS, OUT2), allocates=False)
def _unroll(vertices, graph, way, rows, begin, wraps, path):
    """Waypoints of a way, from a begin on, wrapping columns without jumps."""
    ends = graph[0]
    for j in range(len(begin)):
        path[0, j] = begin[j]
        for k in range(rows):
            value = vertices[j, ends[way[k]]]
            if wraps[j]:
                value += _TURN * np.rint((path[k, j] - value) / _TURN)
            path[k + 1, j] = value


@jit(boolean(GRAPH, INT1, INT1, I64, OUT2, boolean, CONTEXT), allocates=False)
def _is_free(graph, counts, way, rows, path, again, context):
    """Whether a way is free; its edges are asked for, in its own direction, and remembered."""
    known = graph[2]
    free = True
    for k in range(rows):
        h = way[k]
        if known[h] == FREE and not again:
            continue
        counts[ASKED] += 1
        if edge_code(path[k], path[k + 1], context) == 0:
            known[h] = FREE
        else:
            known[h] = BLOCKED
            known[h ^ 1] = BLOCKED
            free = False
    return free


@jit(types.Tuple((I64, I64))(OUT2, GRAPH, INT1, I64, FLOATS1, _MARKS, I64, OUT2, CONTEXT))
def find_way(vertices, graph, counts, start, begin, wraps, rounds, path, context):
    """The shortest free way from an attached start to the nearest of its goals, by so many attempts.

    Args:
        vertices: One a column, shape (nq, capacity).
        graph: See `GRAPH`.
        counts: See the constants of this file.
        start: Index of the start; all later vertices are goals.
        begin: The start itself, not wrapped, shape (nq,).
        wraps: Which columns wrap around, shape (nq,).
        rounds: How many ways to try.
        path: Out: waypoints, shape (counts[VERTICES] + 1, nq).
        context: See `edge_code`.

    Returns:
        FOUND, NONE (there is no way) or GOING (all that were tried are blocked), and the number of waypoints.
    """
    again = False
    for j in range(len(wraps)):
        again = again or wraps[j]
    way = np.empty(counts[VERTICES], np.int64)
    for _ in range(rounds):
        rows = _shortest_way(vertices, graph, counts, start, wraps, way)
        if rows < 0:
            return NONE, 0
        _unroll(vertices, graph, way, rows, begin, wraps, path)
        if _is_free(graph, counts, way, rows, path, again, context):
            return FOUND, rows + 1
    return GOING, 0
