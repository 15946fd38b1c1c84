# mypy: disable-error-code="no-untyped-def,no-untyped-call"
"""The shortest free way along a roadmap.

An edge is only asked for when it is part of the shortest way that may be free (Bohlin and Kavraki, Path planning using
lazy PRM, 2000), and remembered. So the answer is the shortest way along the free edges, whatever was asked before.
Columns that wrap around are unrolled along it.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, types

from rr1plan._kernels.edges import CONTEXT, edge_code
from rr1plan._kernels.jit import F64, FLOATS1, I64, INT1, OUT1, OUT2, jit
from rr1plan._kernels.roadmap import ASKED, BLOCKED, FREE, GRAPH, MARKS, TURN, VERTICES, vertex_distance

# How far the search got: not yet, found, there is none.
GOING, FOUND, NONE = range(3)


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


@jit(F64(OUT2, I64, I64, I64, MARKS), allocates=False)
def _least_ahead(vertices, v, begin, end, wraps):
    """Distance of a vertex from the nearest of the vertices begin .. end - 1."""
    best = np.inf
    for g in range(begin, end):
        best = min(best, vertex_distance(vertices, v, g, wraps))
    return best


@jit(I64(OUT2, GRAPH, INT1, I64, MARKS, INT1))
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


@jit(types.void(OUT2, GRAPH, INT1, I64, FLOATS1, MARKS, OUT2), allocates=False)
def _unroll(vertices, graph, way, rows, begin, wraps, path):
    """Waypoints of a way, from a begin on, wrapping columns without jumps."""
    ends = graph[0]
    for j in range(len(begin)):
        path[0, j] = begin[j]
        for k in range(rows):
            value = vertices[j, ends[way[k]]]
            if wraps[j]:
                value += TURN * np.rint((path[k, j] - value) / TURN)
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


@jit(types.Tuple((I64, I64))(OUT2, GRAPH, INT1, I64, FLOATS1, MARKS, I64, OUT2, CONTEXT), entry=True, ahead=False)
def find_way(vertices, graph, counts, start, begin, wraps, rounds, path, context):
    """The shortest free way from an attached start to the nearest of its goals, by so many attempts.

    Args:
        vertices: One a column, shape (nq, capacity).
        graph: See `roadmap.GRAPH`.
        counts: See `roadmap.py`.
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
