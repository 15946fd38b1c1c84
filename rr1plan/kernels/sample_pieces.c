// Piecewise polynomials at given times, for set-points of simulations.
#include <stdint.h>

// Values and their first two derivatives at some times, shape (3, count, columns).
//
// `coefficients`: of each piece, lowest power first, shape (pieces, terms, columns). `piece`, `local`: for each time
// its piece and the time since the start of the piece, shape (count,). Horner's scheme, in the order of operations of
// `Trajectory.__call__`.
EXPORT void rr1_sample_pieces(const double *coefficients, int64_t terms, int64_t columns, const int64_t *piece,
                              const double *local, int64_t count, double *out) {
    for (int64_t i = 0; i < count; i++) {
        const double *c = coefficients + piece[i] * terms * columns;
        for (int64_t derivative = 0; derivative < 3; derivative++) {
            double *row = out + (derivative * count + i) * columns;
            for (int64_t j = 0; j < columns; j++) row[j] = 0.0;
            for (int64_t k = terms - 1; k >= derivative; k--) {
                double first = derivative > 0 ? (double)k : 1.0, second = derivative > 1 ? (double)(k - 1) : 1.0;
                for (int64_t j = 0; j < columns; j++)
                    row[j] = row[j] * local[i] + c[k * columns + j] * first * second;
            }
        }
    }
}
