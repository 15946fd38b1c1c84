// Cells of a grid over two columns of q that are in contact: the image of an obstacle in a configuration space.
//
// A cell is either one configuration, its center, or all configurations around it. A block of cells is free of contact
// of a pair of bodies if their gap at its middle exceeds their largest relative displacement in it (Schwarzer, Saha and
// Latombe 2005), and in contact if one of the bodies, shrunk by that displacement, still touches the other. Other
// blocks are quartered with the remaining pairs. So only cells at the boundary of the image are tested one by one, and
// all cells have the result of such a test. Cells of the second kind are marked if they are proven to be entirely in
// contact.
#include "raster_tables.h"
#include "scene_tables.h"

// Rounding of gaps at one configuration [m]; smaller gaps count as contact.
#define RASTER_ROUNDING 1e-12

enum { BLOCK_FREE, BLOCK_CONTACT, BLOCK_OPEN };

typedef struct {
    const RasterTables *tables;
    const ExactTables *exact;
    ExactScratch *scratch;
    int64_t seen;  // number of the block for which bodies were last placed
    double half[2];  // half the size of a cell [rad or m]
    uint8_t *cells;
} Raster;

// Cells from `low` to before `high` along each column.
typedef struct {
    int64_t low[2];
    int64_t high[2];
} Block;

// Half sizes of a core without points nearer to its surface than `depth` [m]. Returns 0 if nothing is left or known.
static int erode(int64_t kind, const double size[3], double depth, double eroded[3]) {
    if (kind != BODY_BOX && kind != BODY_CYLINDER) return 0;
    for (int k = 0; k < 3; k++) {
        eroded[k] = size[k] - depth;
        if (!(eroded[k] > 0.0)) return 0;
    }
    return 1;
}

// Whether bodies in contact provably stay in contact if they move relative to each other by at most `moved`.
//
// A ball of this radius inside one of them still contains its center after the motion, so it suffices that the center
// is in the other one. The radii around the cores are the first part of it.
static int stays_in_contact(const ExactPair *pair, double padding, double moved, const Raster *raster) {
    const ExactTables *exact = raster->exact;
    double radius = exact->shapes[pair->body].radius + exact->shapes[pair->other].radius;
    double depth = moved - radius - padding, size[3];
    // If the radii suffice, the gap was decisive already; the inside of surfaces is unknown.
    if (depth < 0.0 || exact->bodies[pair->other].kind > BODY_CORNERS) return 0;
    Core cores[2] = {core_of(placed_body(pair->body, exact, raster->scratch)),
                     core_of(placed_body(pair->other, exact, raster->scratch))};
    for (int side = 1; side >= 0; side--) {
        Core one = cores[side], two = cores[1 - side];
        if (!erode(one.kind, one.size, depth, size)) continue;
        one.size = size;
        const Vec3 *p = &raster->scratch->centers[pair->body], *o = &raster->scratch->centers[pair->other];
        // Any nonzero initial direction is valid; the centers may coincide.
        Vec3 direction = {p->x - o->x, p->y - o->y, p->z - o->z + 1e-9};
        if (side == 0) direction = (Vec3){-direction.x, -direction.y, -direction.z};
        return core_gap(&two, &one, 0.0, RASTER_ROUNDING, &direction).upper <= 0.0;
    }
    return 0;
}

// State of a pair in the block for which joints were placed.
static int judge_block(int64_t p, Raster *raster) {
    const RasterTables *tables = raster->tables;
    const ExactTables *exact = raster->exact;
    const ExactPair *pair = &tables->pairs[p];
    double moved = place_pair(pair, raster->seen, exact, raster->scratch), padding = tables->padding[p];
    double most = moved > 0.0 ? moved * SLACK + ROUNDING : 0.0, enough = padding + most + RASTER_ROUNDING;
    double quick = quick_gap(pair->body, pair->other, enough, exact, raster->scratch);
    if (quick >= enough) return BLOCK_FREE;
    if (most > COARSE && quick > padding) return BLOCK_OPEN;
    GapBounds gap = fine_gap(pair->body, pair->other, padding, enough, &tables->directions[p], exact, raster->scratch);
    if (gap.lower >= enough) return BLOCK_FREE;
    if (most == 0.0) return BLOCK_CONTACT;
    if (gap.upper + most <= padding) return BLOCK_CONTACT;
    if (gap.upper <= padding && stays_in_contact(pair, padding, most, raster)) return BLOCK_CONTACT;
    return BLOCK_OPEN;
}

static void place_block(const Block *block, Raster *raster) {
    const RasterTables *tables = raster->tables;
    for (int k = 0; k < 2; k++) {
        const double *centers = k ? tables->second : tables->first;
        double low = centers[block->low[k]], high = centers[block->high[k] - 1];
        raster->scratch->q[tables->columns[k]] = block->high[k] - block->low[k] > 1 ? 0.5 * (low + high) : low;
        raster->scratch->reach[tables->columns[k]] = 0.5 * (high - low) + raster->half[k];
    }
    place_joints(raster->scratch->q, raster->exact, raster->scratch);
    raster->seen++;
}

// Mark the cells of a block in contact; `count` pairs are undecided in the block that contains it.
static void fill_block(const Block *block, int64_t level, const int64_t *pairs, int64_t count, Raster *raster) {
    int64_t *open = raster->tables->open + level * raster->tables->pair_count, left = 0;
    place_block(block, raster);
    for (int64_t k = 0; k < count; k++) {
        int found = judge_block(pairs[k], raster);
        if (found == BLOCK_CONTACT) {
            int64_t width = raster->tables->counts[1];
            for (int64_t i = block->low[0]; i < block->high[0]; i++)
                for (int64_t j = block->low[1]; j < block->high[1]; j++) raster->cells[i * width + j] = 1;
            return;
        }
        if (found == BLOCK_OPEN) open[left++] = pairs[k];
    }
    if (left == 0 || (block->high[0] - block->low[0] == 1 && block->high[1] - block->low[1] == 1)) return;
    int64_t middle[2] = {(block->low[0] + block->high[0]) / 2, (block->low[1] + block->high[1]) / 2};
    for (int part = 0; part < 4; part++) {
        Block quarter = *block;
        for (int k = 0; k < 2; k++) *(part >> k & 1 ? &quarter.low[k] : &quarter.high[k]) = middle[k];
        if (quarter.low[0] < quarter.high[0] && quarter.low[1] < quarter.high[1])
            fill_block(&quarter, level + 1, open, left, raster);
    }
}

// Set the cells of some rows to 1 if one of the pairs from `first_pair` on is in contact, to 0 otherwise.
//
// Rows are values of the first column; cells have the shape `counts`, of at most 2^RASTER_LEVELS / 4 along each. half:
// 0 for the centers of cells, half their size for cells that are entirely in contact [rad or m], shape (2,).
EXPORT void rr1_raster_pairs(const ExactTables *exact, ExactScratch *scratch, const RasterTables *tables,
                             int64_t first_pair, int64_t last_pair, int64_t first_row, int64_t last_row,
                             const double *half, uint8_t *cells) {
    Raster raster = {tables, exact, scratch, 0, {half[0], half[1]}, cells};
    Block block = {{first_row, 0}, {last_row, tables->counts[1]}};
    for (int64_t c = first_row * tables->counts[1]; c < last_row * tables->counts[1]; c++) cells[c] = 0;
    for (int64_t b = 0; b < exact->body_count; b++) scratch->placed_at[b] = -1;
    for (int64_t k = 0; k < exact->column_count; k++) {
        scratch->q[k] = tables->configuration[k];
        scratch->reach[k] = 0.0;
    }
    int64_t *all = tables->open;
    for (int64_t p = first_pair; p < last_pair; p++) {
        tables->directions[p] = (Vec3){0.0, 0.0, 0.0};
        all[p - first_pair] = p;
    }
    if (first_row < last_row && first_pair < last_pair) fill_block(&block, 1, all, last_pair - first_pair, &raster);
}
