// Multi-start inverse kinematics: descents within joint limits.
//
// Each step of a descent (Levenberg-Marquardt) solves (J^T J + mu I) d = -J^T e over the free joints: a
// joint at a limit with an outward gradient is fixed, the step is clipped to the limits, mu decreases with the error
// and increases otherwise. For the damping see Sugihara, Solvability-unconcerned inverse kinematics by the
// Levenberg-Marquardt method, IEEE T-RO 2011; for the active set Bertsekas, Projected Newton methods, SIAM J. Control
// Optim. 1982.
#include "chain.h"
#include "random.h"

#define IK_CONVERGED 1e-20  // squared error: 1e-10 m
// The squared error has to halve every IK_PATIENCE steps; a descent of a search has at most IK_STEPS.
enum { IK_PATIENCE = 5, IK_STEPS = 40 };
// A descent of a search ends if the predicted reduction of the squared error is below this fraction, which detects
// convergence to a local minimum.
#define IK_MIN_REDUCTION 0.05
#define IK_FIRST_MU 0.1
#define IK_MIN_MU 1e-9
#define IK_MAX_MU 1e9
// Tolerance of limits for rounding errors [rad].
#define IK_LIMIT_SLACK 1e-12

// Solve H y = x for the first n rows by Cholesky decomposition, in place, with rows of H of length `stride`. Returns 0
// if H is not positive definite. Only the lower triangle of H is read. Reciprocals of the factor's diagonal are kept.
static int solve_cholesky(double *h, double *x, int64_t n, int64_t stride) {
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j <= i; j++) {
            double total = h[i * stride + j];
            for (int64_t k = 0; k < j; k++) total -= h[i * stride + k] * h[j * stride + k];
            if (i > j) {
                h[i * stride + j] = total * h[j * stride + j];
            } else if (total > 0.0) {
                h[i * stride + i] = 1.0 / sqrt_number(total);
            } else {
                return 0;
            }
        }
    for (int64_t i = 0; i < n; i++) {
        double total = x[i];
        for (int64_t k = 0; k < i; k++) total -= h[i * stride + k] * x[k];
        x[i] = total * h[i * stride + i];
    }
    for (int64_t i = n - 1; i >= 0; i--) {
        double total = x[i];
        for (int64_t k = i + 1; k < n; k++) total -= h[k * stride + i] * x[k];
        x[i] = total * h[i * stride + i];
    }
    return 1;
}

// Normal equations over the free columns, and scratch memory.
typedef struct {
    int64_t count;
    int64_t stride;         // nq
    int64_t *free;          // free columns, shape (count,)
    double *gradient;       // J^T e, shape (count,)
    double *normal;         // J^T J, lower triangle, rows of `stride`
    double *factor;         // the same shape
    double *step;           // shape (nq,)
    double *trial;          // shape (nq,)
    double (*jacobian)[6];  // shape (nq, 6)
} NormalEquations;

// Size of that memory [numbers]. Matrices of many joints are too large for the stack.
INLINE int64_t descent_memory(int64_t nq) { return 2 * nq * nq + 10 * nq; }

static NormalEquations equations_in(double *memory, int64_t nq) {
    double *vectors = memory + 2 * nq * nq;
    return (NormalEquations){
        .stride = nq,
        .normal = memory,
        .factor = memory + nq * nq,
        .gradient = vectors,
        .step = vectors + nq,
        .trial = vectors + 2 * nq,
        .free = (int64_t *)(vectors + 3 * nq),
        .jacobian = (double (*)[6])(vectors + 4 * nq),
    };
}

// Fill the normal equations at q. Columns with zero gradient are omitted.
static void linearize(const double *q, const double *lower, const double *upper, const double error[6], int rows,
                      NormalEquations *equations) {
    double (*jacobian)[6] = equations->jacobian;
    int64_t count = 0;
    for (int64_t j = 0; j < equations->stride; j++) {
        double gradient = 0.0;
        for (int r = 0; r < rows; r++) gradient += jacobian[j][r] * error[r];
        if (gradient == 0.0 || (q[j] <= lower[j] && gradient > 0.0) || (q[j] >= upper[j] && gradient < 0.0)) continue;
        equations->gradient[count] = gradient;
        equations->free[count] = j;
        for (int64_t i = 0; i <= count; i++) {
            double total = 0.0;
            for (int r = 0; r < rows; r++) total += jacobian[j][r] * jacobian[equations->free[i]][r];
            equations->normal[count * equations->stride + i] = total;
        }
        count++;
    }
    equations->count = count;
}

// Write a damped step within the limits to `trial`. Returns the predicted reduction of the squared error, negative if
// there is no step.
static double damped_step(const double *q, const double *lower, const double *upper, double damping,
                          const NormalEquations *equations) {
    int64_t nq = equations->stride, count = equations->count;
    double *step = equations->step, *factor = equations->factor, *trial = equations->trial, reduction = 0.0;
    for (int64_t i = 0; i < count; i++) {
        step[i] = equations->gradient[i];
        for (int64_t j = 0; j < i; j++) factor[i * nq + j] = equations->normal[i * nq + j];
        factor[i * nq + i] = equations->normal[i * nq + i] + damping;
    }
    if (!solve_cholesky(factor, step, count, nq)) return -1.0;
    for (int64_t j = 0; j < nq; j++) trial[j] = q[j];
    for (int64_t i = 0; i < count; i++) {
        int64_t j = equations->free[i];
        trial[j] = min_number(max_number(q[j] - step[i], lower[j]), upper[j]);
        reduction += equations->gradient[i] * step[i];
    }
    return reduction;
}

// Minimize the squared error locally from q within limits. Returns the final squared error.
//
// At most `steps` evaluations; ends if the predicted reduction of the error is below a fraction. `memory`:
// see `descent_memory`.
static double descend(const Chain *chain, const IkTarget *target, double *q, int64_t nq, const double *lower,
                      const double *upper, int64_t steps, double min_reduction, double *memory) {
    Pose poses[chain->joint_count + 1];
    double error[6];
    NormalEquations equations = equations_in(memory, nq);
    const double *normal = equations.normal, *trial = equations.trial;
    double cost = ik_error(chain, target, q, poses, error), mu = IK_FIRST_MU, past = INFINITY, trace = 0.0;
    int moved = 1;
    for (int64_t k = 0; k < steps && cost >= IK_CONVERGED; k++) {
        if (k % IK_PATIENCE == 0) {
            if (cost > 0.5 * past) break;
            past = cost;
        }
        if (moved) {
            int rows = ik_jacobian(chain, target, poses, error, nq, equations.jacobian);
            linearize(q, lower, upper, error, rows, &equations);
            trace = 0.0;
            for (int64_t i = 0; i < equations.count; i++) trace += normal[i * nq + i];
        }
        if (equations.count == 0) break;
        moved = 0;
        // In proportion to the squared error (Sugihara); the second term keeps the matrix positive definite despite rounding.
        double damping = mu * min_number(cost, 1.0) + 1e-12 * (1.0 + trace);
        double reduction = damped_step(q, lower, upper, damping, &equations);
        if (0.0 <= reduction && reduction < min_reduction * cost) break;
        if (reduction >= 0.0) {
            double after = ik_error(chain, target, trial, poses, error);
            if (after < cost) {
                for (int64_t j = 0; j < nq; j++) q[j] = trial[j];
                cost = after;
                moved = 1;
            }
        }
        mu = moved ? max_number(0.2 * mu, IK_MIN_MU) : min_number(10.0 * mu, IK_MAX_MU);
    }
    return cost;
}

EXPORT int64_t rr1_descent_memory(int64_t nq) { return descent_memory(nq); }

// See `descend`.
EXPORT double rr1_descend(const Chain *chain, const IkTarget *target, double *q, int64_t nq, const double *lower,
                          const double *upper, int64_t steps, double *memory) {
    return descend(chain, target, q, nq, lower, upper, steps, 0.0, memory);
}

static int is_reached(const IkSearch *search, const double *q) {
    double errors[2];
    rr1_chain_errors(search->chain, search->target, q, errors);
    return errors[0] <= search->position_tolerance && errors[1] <= search->orientation_tolerance;
}

// Add whole turns to q within the limits, so that it is as near as possible to the preferred configuration.
static void take_nearest_copy(const IkSearch *search, double *q) {
    for (int64_t j = 0; j < search->column_count; j++) {
        double lower = search->lower[j], upper = search->upper[j];
        double fewest = __builtin_ceil((lower - IK_LIMIT_SLACK - q[j]) / WHOLE_TURN);
        double most = __builtin_floor((upper + IK_LIMIT_SLACK - q[j]) / WHOLE_TURN);
        if (!(search->wraps[j] > 0.0) || !(fewest <= most)) continue;
        double turns = __builtin_floor((search->preferred[j] - q[j]) / WHOLE_TURN + 0.5);
        turns = min_number(max_number(turns, fewest), most);
        if (turns != 0.0) q[j] = min_number(max_number(q[j] + turns * WHOLE_TURN, lower), upper);
    }
}

// Whether every solution so far differs from q by more than the separation in some joint, modulo whole turns.
static int is_distinct(const IkSearch *search, const double *q) {
    int64_t nq = search->column_count;
    for (int64_t i = 0; i < search->solution_count; i++) {
        int near = 1;
        for (int64_t j = 0; j < nq; j++) {
            double d = q[j] - search->solutions[i * nq + j];
            if (search->wraps[j] > 0.0) d -= WHOLE_TURN * __builtin_floor(d / WHOLE_TURN + 0.5);
            near = near && abs_number(d) <= search->separation;
        }
        if (near) return 0;
    }
    return 1;
}

// Write the next start and its target: the whole target for a seed, a random point of its box for other starts.
//
// Returns whether the target was reduced to a point.
static int take_start(const IkSearch *search, uint64_t *random, double *q, IkTarget *aim) {
    int64_t nq = search->column_count;
    *aim = *search->target;
    if (search->starts < search->seed_count) {
        for (int64_t j = 0; j < nq; j++) q[j] = search->seeds[search->starts * nq + j];
        return 0;
    }
    int narrower = 0;
    for (int r = 0; r < 3; r++) {
        if (!(aim->lower[r] < aim->upper[r])) continue;
        narrower = 1;
        aim->lower[r] += draw_uniform(random) * (search->target->upper[r] - search->target->lower[r]);
        aim->upper[r] = aim->lower[r];
    }
    for (int64_t j = 0; j < nq; j++) {
        double share = draw_uniform(random);
        q[j] = search->extent[j] > 0.0 ? search->corner[j] + share * search->extent[j] : search->preferred[j];
    }
    return narrower;
}

// Descend from one start after the other until a new solution is found or there were `starts` in all.
//
// Returns whether there is a new solution; it is appended to `solutions`.
EXPORT int64_t rr1_search_ik(IkSearch *search, uint64_t *random, int64_t starts) {
    const Chain *chain = search->chain;
    int64_t nq = search->column_count;
    double *q = search->memory, *memory = q + nq;
    while (search->starts < starts) {
        IkTarget aim;
        int narrower = take_start(search, random, q, &aim);
        search->starts++;
        double cost = descend(chain, &aim, q, nq, search->lower, search->upper, IK_STEPS, IK_MIN_REDUCTION, memory);
        if (narrower && !is_reached(search, q))
            cost = descend(chain, search->target, q, nq, search->lower, search->upper, IK_STEPS, IK_MIN_REDUCTION,
                           memory);
        if (cost < search->nearest_squared) {
            search->nearest_squared = cost;
            for (int64_t j = 0; j < nq; j++) search->nearest[j] = q[j];
        }
        if (!is_reached(search, q)) continue;
        take_nearest_copy(search, q);
        if (is_distinct(search, q)) {
            for (int64_t j = 0; j < nq; j++) search->solutions[search->solution_count * nq + j] = q[j];
            search->solution_count++;
            return 1;
        }
    }
    return 0;
}
