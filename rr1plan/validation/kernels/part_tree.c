// Trees of boxes around the parts of a body: split at the median of the longest side until few parts are left.

typedef struct {
    const double *low, *high;  // of the parts' boxes, shape (parts, 3) [m]
    int64_t most;               // largest number of parts of a leaf
    int64_t *order;
    SurfaceBox *boxes;
    SurfaceNode *nodes;
    int64_t count;  // nodes so far
} TreeWork;

static inline double part_middle(const TreeWork *w, int64_t i, int axis) {
    return w->low[3 * w->order[i] + axis] + w->high[3 * w->order[i] + axis];
}

// Order parts so that those before `middle` are not farther along an axis than those after it (Hoare's selection).
static void select_middle(TreeWork *w, int64_t begin, int64_t end, int64_t middle, int axis) {
    int64_t low = begin, high = end - 1;
    while (low < high) {
        double pivot = part_middle(w, (low + high) / 2, axis);
        int64_t i = low, j = high;
        while (i <= j) {
            while (part_middle(w, i, axis) < pivot) i++;
            while (part_middle(w, j, axis) > pivot) j--;
            if (i > j) break;
            int64_t other = w->order[i];
            w->order[i++] = w->order[j];
            w->order[j--] = other;
        }
        if (middle <= j) {
            high = j;
        } else if (middle >= i) {
            low = i;
        } else {
            return;
        }
    }
}

static void add_node(TreeWork *w, int64_t begin, int64_t end) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double least[3] = {INFINITY, INFINITY, INFINITY}, most[3] = {-INFINITY, -INFINITY, -INFINITY};
    int64_t node = w->count++;
    for (int64_t i = begin; i < end; i++) {
        for (int k = 0; k < 3; k++) {
            low[k] = lesser(low[k], w->low[3 * w->order[i] + k]);
            high[k] = greater(high[k], w->high[3 * w->order[i] + k]);
            least[k] = lesser(least[k], part_middle(w, i, k));
            most[k] = greater(most[k], part_middle(w, i, k));
        }
    }
    int axis = 0;
    for (int k = 0; k < 3; k++) {
        double middle = 0.5 * (low[k] + high[k]), half = 0.5 * (high[k] - low[k]);
        w->boxes[node].center[k] = middle;
        // Covers the rounding of the middle and the half size.
        w->boxes[node].half[k] = half + 4e-16 * (fabs(middle) + half);
        if (most[k] - least[k] > most[axis] - least[axis]) axis = k;
    }
    int leaf = end - begin <= w->most;
    if (!leaf) {
        int64_t middle = (begin + end) / 2;
        select_middle(w, begin, end, middle, axis);
        add_node(w, begin, middle);
        add_node(w, middle, end);
    }
    w->nodes[node] = (SurfaceNode){w->count, leaf ? begin : end, end};
}

// Build the tree of parts with boxes from `low` to `high`, shape (count, 3) each [m]. Returns the number of its nodes,
// which is less than twice the number of parts.
//
// `order` returns the parts in the order of the leaves. `boxes` and `nodes` have room for 2 * count.
EXPORT int64_t rr1_build_tree(const double *low, const double *high, int64_t count, int64_t most, int64_t *order,
                              SurfaceBox *boxes, SurfaceNode *nodes) {
    TreeWork w = {low, high, most, order, boxes, nodes, 0};
    for (int64_t i = 0; i < count; i++) order[i] = i;
    add_node(&w, 0, count);
    return w.count;
}
