// Solids that do not move: described by their shapes and placed at the poses of their objects, once for a scene, and
// again when an object has been moved.
#include "fixed_solids.h"
#include "scene_tables.h"
#include "support_table.h"

// Represents an infinite extent of a half-space [m]; infinity times zero would be NaN.
#define ENDLESS 1e12

// Describe a shape with a closed form; for corners, cells and triangles, which have tables, only note that.
static void describe(const ShapeSize *given, FixedSolid *solid, SolidShape *shape) {
    const double *size = given->size;
    // Half sizes of its box and of its core in the exact kernel, the ball around it, and the radius around the core.
    double half[3] = {0}, core[3] = {0}, ball = 0.0, radius = 0.0, offset = 0.0;
    *shape = (SolidShape){0};
    solid->kind = OBSTACLE_ROUNDED_BOX;
    solid->is_exact = 1;
    solid->core = CORE_CLOSED_FORM;
    switch (given->kind) {
    case BODY_POINT:
        ball = radius = half[0] = half[1] = half[2] = size[0];
        break;
    case BODY_SEGMENT:
        radius = half[0] = half[1] = size[0];
        core[2] = 0.5 * size[1];
        ball = half[2] = core[2] + radius;
        break;
    case BODY_BOX:
        for (int k = 0; k < 3; k++) half[k] = core[k] = 0.5 * size[k];
        ball = __builtin_sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
        break;
    case BODY_CYLINDER:
        half[0] = half[1] = size[0];
        half[2] = 0.5 * size[1];
        for (int k = 0; k < 3; k++) core[k] = half[k];
        ball = __builtin_sqrt(half[0] * half[0] + half[2] * half[2]);
        solid->kind = OBSTACLE_CYLINDER;
        break;
    case BODY_HALF_SPACE:
        ball = half[0] = half[1] = half[2] = ENDLESS;
        for (int k = 0; k < 3; k++) core[k] = size[k];
        offset = size[3];
        solid->kind = OBSTACLE_HALF_SPACE;
        break;
    default:
        solid->is_exact = 0;
        solid->core = CORE_LEFT_OUT;
        return;
    }
    shape->ball_radius = ball;
    shape->core_margin = shape->radius = radius;
    for (int k = 0; k < 3; k++) {
        shape->box_half[k] = half[k];
        shape->size[k] = core[k];
        if (given->kind != BODY_HALF_SPACE) shape->half[k] = core[k];
    }
    shape->offset = offset;
}

// Describe solids object after object, after those of `links`, which have no bodies and no rows for cores. Returns the
// number of solids left for the caller to describe.
//
// sizes, frames: for each solid; counts, poses: for each object; first_body: of the first solid.
EXPORT int64_t rr1_describe_solids(
    FixedSolids *fixed, const FixedSolids *links, const ShapeSize *sizes, const Transform *frames, const int64_t *counts,
    const Transform *poses, int64_t first_body
) {
    SolidShape *shapes = (SolidShape *)fixed->shapes;
    Transform *in_objects = (Transform *)fixed->frames;
    int64_t left = 0, i = 0, object = 0;
    for (; i < links->count; i++) {
        fixed->solids[i] = links->solids[i];
        fixed->solids[i].body = fixed->solids[i].first_point = -1;
        shapes[i] = links->shapes[i];
        in_objects[i] = links->frames[i];
    }
    for (; object < links->object_count; object++) fixed->objects[object] = links->objects[object];
    for (; object < fixed->object_count; object++) {
        fixed->objects[object] = *poses++;
        for (int64_t end = i + *counts++; i < end; i++, sizes++, frames++) {
            fixed->solids[i] = (FixedSolid){.object = object, .body = first_body++, .obstacle = -1};
            describe(sizes, &fixed->solids[i], &shapes[i]);
            in_objects[i] = *frames;
            left += fixed->solids[i].core == CORE_LEFT_OUT;
        }
    }
    return left;
}

static void placed_point(const Pose *at, const double p[3], double out[3]) {
    for (int r = 0; r < 3; r++) {
        const double *R = at->rotation + 3 * r;
        out[r] = R[0] * p[0] + R[1] * p[1] + R[2] * p[2] + at->origin[r];
    }
}

static Pose pose_of(const FixedSolids *fixed, int64_t i) {
    const double *A = fixed->objects[fixed->solids[i].object].values, *B = fixed->frames[i].values;
    Pose at;
    for (int r = 0; r < 3; r++, A += 4) {
        for (int c = 0; c < 3; c++) at.rotation[3 * r + c] = A[0] * B[c] + A[1] * B[4 + c] + A[2] * B[8 + c];
        at.origin[r] = A[0] * B[3] + A[1] * B[7] + A[2] * B[11] + A[3];
    }
    return at;
}

static void set_body(const SolidShape *shape, const Pose *at, ExactShape *row, Pose *pose, Vec3 *center) {
    for (int k = 0; k < 9; k++) row->rotation[k] = at->rotation[k];
    for (int k = 0; k < 3; k++) row->origin[k] = at->origin[k];
    placed_point(at, shape->ball_center, row->ball_center);
    row->ball_radius = shape->ball_radius;
    row->radius = shape->core_margin;
    for (int k = 0; k < 3; k++) {
        row->box_center[k] = shape->box_center[k];
        row->box_half[k] = shape->box_half[k];
        row->size[k] = shape->size[k];
    }
    row->offset = shape->offset;
    *pose = *at;
    *center = (Vec3){row->ball_center[0], row->ball_center[1], row->ball_center[2]};
}

// Low x, y, z, high x, y, z of the box around a solid, `stride` numbers apart.
static void set_shape(
    const FixedSolid *solid, const SolidShape *shape, const Pose *at, ObstacleShape *row, double *box, int64_t stride
) {
    const double *box_half = shape->box_half, *normal = shape->size;  // the latter for a half-space
    if (solid->kind == OBSTACLE_HALF_SPACE) {
        double height = shape->offset;
        *row = (ObstacleShape){.low = -INFINITY};
        for (int r = 0; r < 3; r++) {
            const double *R = at->rotation + 3 * r;
            row->rotation[3 * r + 2] = R[0] * normal[0] + R[1] * normal[1] + R[2] * normal[2];
            height += row->rotation[3 * r + 2] * at->origin[r];
        }
        for (int k = 0; k < 3; k++) {
            row->center[k] = height * row->rotation[3 * k + 2];
            box[k * stride] = -INFINITY;
            box[(3 + k) * stride] = INFINITY;
        }
        // If the normal is parallel to an axis, the box ends at the plane.
        for (int k = 0; k < 3; k++) {
            double along = row->rotation[3 * k + 2];
            if (row->rotation[3 * ((k + 1) % 3) + 2] != 0.0 || row->rotation[3 * ((k + 2) % 3) + 2] != 0.0) continue;
            box[(along > 0.0 ? 3 + k : k) * stride] = height / along;
        }
        return;
    }
    for (int k = 0; k < 9; k++) row->rotation[k] = at->rotation[k];
    placed_point(at, shape->box_center, row->center);
    const double *half = solid->is_exact ? shape->half : box_half;
    for (int k = 0; k < 3; k++) row->half[k] = half[k];
    row->radius = shape->radius;
    row->low = -half[2];
    for (int k = 0; k < 3; k++) {
        const double *R = at->rotation + 3 * k;
        double extent = abs_number(R[0]) * box_half[0] + abs_number(R[1]) * box_half[1] + abs_number(R[2]) * box_half[2];
        box[k * stride] = row->center[k] - extent;
        box[(3 + k) * stride] = row->center[k] + extent;
    }
}

static void set_core(
    const FixedSolids *fixed, int64_t i, const Pose *at, const CoreRange *core, CoreShape *shape, Vec3 *points,
    Ball *blocks
) {
    const FixedSolid *solid = &fixed->solids[i];
    placed_point(at, fixed->shapes[i].middle, shape->middle);
    shape->radius = 0.0;
    shape->reach = fixed->shapes[i].reach;
    for (int k = 0; k < 9; k++) shape->axes[k] = at->rotation[k];
    int64_t count = core->last_point - core->first_point;
    for (int64_t k = 0; k < count; k++) {
        placed_point(at, (const double *)&fixed->points[solid->first_point + k], (double *)&points[core->first_point + k]);
    }
    double largest = max_number(max_number(abs_number(at->origin[0]), abs_number(at->origin[1])), abs_number(at->origin[2]));
    for (int64_t k = 0; k < (count + BLOCK_POINTS - 1) / BLOCK_POINTS; k++) {
        const Ball *block = &fixed->blocks[solid->first_block + k];
        placed_point(at, block->center, blocks[core->first_block + k].center);
        // Rounding error of a product with a rotation and a sum.
        blocks[core->first_block + k].radius = block->radius + 1e-14 * (1.0 + largest);
    }
}

// The exact kernel's rows of all solids that have one: `placed` and `centers` belong to its scratch memory.
EXPORT void rr1_place_bodies(const FixedSolids *fixed, ExactShape *shapes, Pose *placed, Vec3 *centers) {
    for (int64_t i = 0; i < fixed->count; i++) {
        int64_t b = fixed->solids[i].body;
        Pose at = pose_of(fixed, i);
        if (b >= 0) set_body(&fixed->shapes[i], &at, &shapes[b], &placed[b], &centers[b]);
    }
}

// The cores of all solids that have one.
EXPORT void rr1_place_cores(
    const FixedSolids *fixed, const CoreRange *cores, CoreShape *shapes, Vec3 *points, Ball *blocks
) {
    for (int64_t i = 0; i < fixed->count; i++) {
        int64_t core = fixed->solids[i].core;
        Pose at = pose_of(fixed, i);
        if (core >= 0 && fixed->solids[i].first_point >= 0) set_core(fixed, i, &at, &cores[core], &shapes[core], points, blocks);
    }
}

// Bound of the rounding error of a gap to obstacles with these positions [m].
static double obstacle_rounding(const ObstacleShape *shapes, int64_t count) {
    double largest = 0.0;
    for (int64_t o = 0; o < count; o++) {
        const ObstacleShape *row = &shapes[o];
        for (int k = 0; k < 9; k++) largest = max_number(largest, abs_number(row->rotation[k]));
        for (int k = 0; k < 3; k++) largest = max_number(largest, abs_number(row->center[k]));
        for (int k = 0; k < 3; k++) largest = max_number(largest, row->half[k]);
        largest = max_number(largest, row->radius);
    }
    return 1e-12 * largest;
}

// Tables of `count` obstacles: those of all solids with a row there; the other rows are empty. Returns a bound of the
// rounding error of a gap to them [m].
EXPORT double rr1_place_obstacles(
    FixedSolids *fixed, const int64_t *rows, int64_t count, ObstacleKind *kinds, ObstacleShape *shapes, double *boxes,
    int64_t *core
) {
    for (int64_t o = 0; o < count; o++) {
        kinds[o] = (ObstacleKind){0};
        shapes[o] = (ObstacleShape){0};
        core[o] = CORE_CLOSED_FORM;
        for (int k = 0; k < 3; k++) {
            boxes[k * count + o] = INFINITY;
            boxes[(3 + k) * count + o] = -INFINITY;
        }
    }
    for (int64_t i = 0; i < fixed->count; i++) {
        FixedSolid *solid = &fixed->solids[i];
        int64_t o = solid->obstacle = rows[i];
        if (o < 0) continue;
        Pose at = pose_of(fixed, i);
        kinds[o] = (ObstacleKind){solid->kind, solid->is_exact};
        core[o] = solid->core;
        set_shape(solid, &fixed->shapes[i], &at, &shapes[o], &boxes[o], count);
    }
    return obstacle_rounding(shapes, count);
}

// Move consecutive objects to poses, shape (count, 4, 4): afterwards tables and scratch memory are as if they had been
// built with these poses.
EXPORT void rr1_move_objects(SceneTables *scene, Scratch *scratch, int64_t first, int64_t count, const double *poses) {
    const FixedSolids *fixed = scene->fixed;
    const ObstacleTables *obstacles = scene->obstacles;
    const ArmGeometry *arm = scene->arm;
    ExactScratch *exact = scratch->exact;
    for (int64_t object = 0; object < count; object++) {
        for (int k = 0; k < 16; k++) fixed->objects[first + object].values[k] = poses[16 * object + k];
    }
    for (int64_t i = 0; i < fixed->count; i++) {
        const FixedSolid *solid = &fixed->solids[i];
        if (solid->object < first || solid->object >= first + count) continue;
        Pose at = pose_of(fixed, i);
        if (solid->body >= 0) {
            int64_t b = solid->body;
            set_body(
                &fixed->shapes[i], &at, (ExactShape *)&scene->exact->shapes[b], &exact->poses[b], &exact->centers[b]
            );
        }
        if (solid->obstacle >= 0) {
            int64_t o = solid->obstacle;
            ObstacleShape *row = (ObstacleShape *)&obstacles->shapes[o];
            set_shape(solid, &fixed->shapes[i], &at, row, (double *)&obstacles->boxes[o], obstacles->count);
        }
        if (solid->core >= 0) {
            CoreShape *shape = (CoreShape *)&arm->core_shapes[solid->core];
            set_core(
                fixed, i, &at, &arm->cores[solid->core], shape, (Vec3 *)arm->points, (Ball *)arm->blocks
            );
        }
    }
    scene->margin = scene->bare_margin + obstacle_rounding(obstacles->shapes, obstacles->count);
}

// Replace all solids after the first `link_count`, which are those of `link_objects`, by the solids of another scene.
// Number and kinds of solids have to agree, and meshes and point clouds have to be equal. Afterwards tables and scratch
// memory are those of that scene.
//
// sizes, frames: for each solid; poses: for each object.
EXPORT void rr1_replace_solids(
    SceneTables *scene, Scratch *scratch, int64_t link_count, int64_t link_objects, const ShapeSize *sizes,
    const Transform *frames, const double *poses
) {
    const FixedSolids *fixed = scene->fixed;
    for (int64_t i = link_count; i < fixed->count; i++, sizes++, frames++) {
        if (fixed->solids[i].core == CORE_CLOSED_FORM) describe(sizes, &fixed->solids[i], (SolidShape *)&fixed->shapes[i]);
        ((Transform *)fixed->frames)[i] = *frames;
    }
    rr1_move_objects(scene, scratch, link_objects, fixed->object_count - link_objects, poses);
}
