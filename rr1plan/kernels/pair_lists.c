// The pairs of a scene, listed once: pairs of solids from pairs of elements, and sorted for the certified edge.
#include "arm_geometry.h"
#include "exact_tables.h"
#include "pair_tables.h"
#include "simd.h"

// Number of joints that two chains have in common: they coincide from the root until they part.
static int64_t common_joints(const int64_t *links, const int64_t *first_link, int64_t a, int64_t b) {
    const int64_t *one = links + first_link[a], *end = links + first_link[a + 1];
    const int64_t *other = links + first_link[b], *other_end = links + first_link[b + 1];
    int64_t count = 0;
    while (one + count < end && other + count < other_end && one[count] == other[count]) count++;
    return count;
}

// List pairs of solids: those that move relative to each other, then the others, each in the order of the pairs of
// elements.
//
// checked: pairs of elements; elements: that of each solid; chains: which chain of joints carries each solid; links,
// first_link: the joints of all chains, and where each chain begins; surfaceless: 1 for solids that have to be second in
// `rows`. order, first: room for a number for each solid, and for each element and one more. index, owner, rows: for
// each pair its solids, its pair of elements, and its solids in the order of measurement with the number of joints that
// move both. Returns the number of moving pairs.
EXPORT int64_t rr1_list_solid_pairs(
    const NumberPair *checked, int64_t checked_count, const int64_t *elements, int64_t solid_count,
    int64_t element_count, const int64_t *chains, const int64_t *links, const int64_t *first_link,
    const uint8_t *surfaceless, int64_t *order, int64_t *first, NumberPair *index, int64_t *owner, ExactPair *rows
) {
    for (int64_t e = 0; e <= element_count; e++) first[e] = 0;
    for (int64_t i = 0; i < solid_count; i++) first[elements[i] + 1]++;
    for (int64_t e = 0; e < element_count; e++) first[e + 1] += first[e];
    // After this loop, each entry is the end of its element and the start of the next one.
    for (int64_t i = 0; i < solid_count; i++) order[first[elements[i]]++] = i;
    int64_t moving = 0;
    for (int write = 0; write < 2; write++) {
        int64_t next[2] = {0, moving};
        for (int64_t k = 0; k < checked_count; k++) {
            int64_t a = checked[k].one, b = checked[k].other;
            for (int64_t i = a ? first[a - 1] : 0; i < first[a]; i++) {
                for (int64_t j = b ? first[b - 1] : 0; j < first[b]; j++) {
                    int64_t one = order[i], two = order[j], stays = chains[one] == chains[two];
                    if (!write) {
                        moving += !stays;
                        continue;
                    }
                    int64_t row = next[stays]++;
                    index[row] = (NumberPair){one, two};
                    owner[row] = k;
                    rows[row] = (ExactPair){
                        .body = surfaceless[one] ? two : one,
                        .other = surfaceless[one] ? one : two,
                        .shared = stays ? 0 : common_joints(links, first_link, chains[one], chains[two]),
                    };
                }
            }
        }
    }
    return moving;
}

// Number the solids that do not move but have a pair with a body: `obstacle` of each solid, -1 for all others. Returns
// their number.
//
// pairs: the moving pairs; body: the body of each solid, -1: none.
EXPORT int64_t rr1_number_obstacles(
    const NumberPair *pairs, int64_t pair_count, const int64_t *body, int64_t solid_count, int64_t *obstacle
) {
    for (int64_t i = 0; i < solid_count; i++) obstacle[i] = -1;
    for (int64_t k = 0; k < pair_count; k++) {
        if (body[pairs[k].one] < 0) obstacle[pairs[k].one] = 0;
        if (body[pairs[k].other] < 0) obstacle[pairs[k].other] = 0;
    }
    int64_t count = 0;
    for (int64_t i = 0; i < solid_count; i++) {
        if (obstacle[i] == 0) obstacle[i] = count++;
    }
    return count;
}

typedef struct {
    int64_t key;
    int64_t row;
} KeyedRow;

// Sort rows by ascending keys, stably. Returns the memory with the result, which is one of the two.
static KeyedRow *sorted_rows(KeyedRow *rows, KeyedRow *other, int64_t count) {
    for (int64_t width = 1; width < count; width *= 2) {
        for (int64_t begin = 0; begin < count; begin += 2 * width) {
            int64_t middle = begin + width < count ? begin + width : count;
            int64_t end = begin + 2 * width < count ? begin + 2 * width : count;
            for (int64_t k = begin, a = begin, b = middle; k < end; k++) {
                int from_first = a < middle && (b >= end || rows[a].key <= rows[b].key);
                other[k] = from_first ? rows[a++] : rows[b++];
            }
        }
        KeyedRow *sorted = other;
        other = rows;
        rows = sorted;
    }
    return rows;
}

// List the blocks of obstacles with which some body of each group has a pair. Returns their number.
static int64_t list_obstacle_blocks(
    const Group *groups, int64_t group_count, const int32_t *pair_of, int64_t columns, NearBlock *blocks, int64_t *first
) {
    int64_t count = 0, before = 0;
    for (int64_t g = 0; g < group_count; g++) {
        first[g] = count;
        for (int64_t column = 0; column < columns; column += LANES) {
            int64_t lanes = 0, obstacles = 0;
            for (int64_t lane = 0; lane < LANES; lane++) {
                int64_t found = 0;
                for (int64_t b = groups[g].first_body; b < groups[g].last_body; b++) {
                    found |= pair_of[b * columns + column + lane] >= 0;
                }
                lanes |= found << lane;
                obstacles += found;
            }
            if (lanes) blocks[count++] = (NearBlock){column, lanes, before};
            before += obstacles;
        }
    }
    first[group_count] = count;
    return count;
}

// List the pairs for the certified edge, without clearance maps.
//
// pairs, rows: moving pairs from `rr1_list_solid_pairs`; body, obstacle: for each solid, from `rr1_number_obstacles`;
// bodies, groups: of `ArmGeometry`, whose chains have at most `joint_count` joints; columns: of `pair_of`, a multiple
// of LANES; room: four numbers for each pair of bodies. solids: for each body pair. counts: of group pairs, blocks of
// obstacles, blocks of groups.
EXPORT void rr1_list_body_pairs(
    const NumberPair *pairs, const ExactPair *rows, int64_t pair_count, const int64_t *body, const int64_t *obstacle,
    const Body *bodies, int64_t body_count, const Group *groups, int64_t group_count, int64_t joint_count,
    int64_t columns, int64_t *room, int32_t *pair_of, BodyPair *body_pairs, NumberPair *solids,
    GroupPair *group_pairs, NearBlock *obstacle_blocks, int64_t *first_obstacle_block,
    NearBlock *group_blocks, int64_t *first_group_block, int64_t counts[3]
) {
    for (int64_t k = 0; k < body_count * columns; k++) pair_of[k] = -1;
    int64_t both = 0;
    for (int64_t k = 0; k < pair_count; k++) both += body[pairs[k].one] >= 0 && body[pairs[k].other] >= 0;
    KeyedRow *keyed = (KeyedRow *)room;
    int64_t next = 0;
    for (int64_t k = 0; k < pair_count; k++) {
        int64_t one = pairs[k].one, two = pairs[k].other;
        if (body[one] < 0) {
            pair_of[body[two] * columns + obstacle[one]] = (int32_t)k;
        } else if (body[two] < 0) {
            pair_of[body[one] * columns + obstacle[two]] = (int32_t)k;
        } else {
            int64_t group = bodies[body[one]].group, other = bodies[body[two]].group;
            // Sorted by both groups, then by the number of joints that move both bodies.
            keyed[next++] = (KeyedRow){(group * group_count + other) * joint_count + rows[k].shared, k};
        }
    }
    keyed = sorted_rows(keyed, (KeyedRow *)room + both, both);
    int64_t families = 0, blocks = 0, group_done = 0;
    for (int64_t i = 0; i < both; i++) {
        int64_t k = keyed[i].row, one = pairs[k].one, two = pairs[k].other;
        solids[i] = pairs[k];
        body_pairs[i] = (BodyPair){body[one], body[two], rows[k].shared, k, .map = -1};
        if (i == 0 || keyed[i].key != keyed[i - 1].key) {
            int64_t group = bodies[body[one]].group, other = bodies[body[two]].group, column = other - other % LANES;
            int same_group = families > 0 && group_pairs[families - 1].group == group;
            group_pairs[families] = (GroupPair){group, other, rows[k].shared, .first = i, .map = -1};
            while (group_done <= group) first_group_block[group_done++] = blocks;
            if (!same_group || group_blocks[blocks - 1].first != column) {
                group_blocks[blocks++] = (NearBlock){column, 0, families};
            }
            group_blocks[blocks - 1].lanes |= (int64_t)1 << other % LANES;
            families++;
        }
        group_pairs[families - 1].last = i + 1;
    }
    while (group_done <= group_count) first_group_block[group_done++] = blocks;
    counts[0] = families;
    counts[1] = list_obstacle_blocks(groups, group_count, pair_of, columns, obstacle_blocks, first_obstacle_block);
    counts[2] = blocks;
}
