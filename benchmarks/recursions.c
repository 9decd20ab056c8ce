/* The recursions of vsalog's estimators as a C programmer tunes them by hand, to measure the production step against.
 *
 * The same arithmetic as vsalog/estimators/rls.py, qr.py and vsalog/filters/square_root_smoother.py, and nothing around it: no
 * functionals, no uncertainty. The number of unknowns N is known when it is compiled (-DN=4), so that loops are unrolled and
 * vectorised without rests, and what a sample needs stays in registers. One pass writes P and multiplies it by the regressors of the next sample. Whole rows of P: one
 * triangle alone has half the arithmetic, but its rows are of unlike lengths, and takes two and a half times as long for N = 18
 * (compile with -DTRIANGLE to see).
 */
#include <math.h>
#include <stddef.h>

/* Rows of an instant's measurement, and of a step of the random walk. */
#define ROWS (N + 1)
#define STEPS 1

/* Enhanced recursive least squares: Flacco 2012 eq. 23, 39, 41. */
void rls_run(ptrdiff_t count, const double *restrict F, const double *restrict y, double c, double *restrict alpha,
             double *restrict P)
{
    double g[N], next[N];
    for (int i = 0; i < N; i++) {
        g[i] = 0.0;
        for (int j = 0; j < N && count > 0; j++)
            g[i] += P[i * N + j] * F[j];
    }
    for (ptrdiff_t k = 0; k < count; k++) {
        const double *f = F + k * N, *following = k + 1 < count ? f + N : f;
        double rho = 0.0, error = y[k];
        for (int i = 0; i < N; i++) {
            rho += f[i] * g[i];
            error -= f[i] * alpha[i];
            next[i] = 0.0;
        }
        double gain = c / (1.0 + c * rho), step = gain * error;
        for (int i = 0; i < N; i++) {
            double w = gain * g[i], x = following[i];
            alpha[i] += step * g[i];
#ifdef TRIANGLE
            double p = P[i * N + i] - w * g[i], sum = p * x;
            P[i * N + i] = p;
            for (int j = i + 1; j < N; j++) {
                p = P[i * N + j] - w * g[j];
                P[i * N + j] = p;
                next[j] += p * x;
                sum += p * following[j];
            }
            next[i] += sum;
#else
            for (int j = 0; j < N; j++) {
                double p = P[i * N + j] - w * g[j];
                P[i * N + j] = p;
                next[j] += p * x;
            }
#endif
        }
        for (int i = 0; i < N; i++)
            g[i] = next[i];
    }
}

/* Rotate samples into [R p] and solve after each: Flacco 2014 eq. 21-23. */
void qr_run(ptrdiff_t count, const double *restrict F, const double *restrict y, double forgetting, double *restrict Rp,
            double *restrict xi)
{
    double row[N + 1];
    for (ptrdiff_t k = 0; k < count; k++) {
        for (int j = 0; j < N; j++)
            row[j] = F[k * N + j];
        row[N] = y[k];
        for (int i = 0; i < N; i++) {
            double *R = Rp + i * (N + 1);
            if (forgetting != 1.0)
                for (int j = i; j <= N; j++)
                    R[j] *= forgetting;
            double x = row[i], r = R[i];
            if (x == 0.0)
                continue;
            double h = sqrt(r * r + x * x), cosine = r / h, sine = x / h;
            R[i] = h;
            for (int j = i + 1; j <= N; j++) {
                double p = R[j], q = row[j];
                R[j] = cosine * p + sine * q;
                row[j] = cosine * q - sine * p;
            }
        }
        for (int i = N - 1; i >= 0; i--) {
            double s = Rp[i * (N + 1) + N];
            for (int j = i + 1; j < N; j++)
                s -= Rp[i * (N + 1) + j] * xi[j];
            xi[i] = s / Rp[i * (N + 1) + i];
        }
    }
}

/* Householder's triangle of the first columns of A, as vsalog/filters/square_root_smoother.py has it. */
static inline void triangularise(double *restrict A, int rows, int width, int columns)
{
    double dots[ROWS + N];
    for (int j = 0; j < (columns < rows ? columns : rows); j++) {
        double norm = 0.0;
        for (int i = j; i < rows; i++)
            norm += A[i * width + j] * A[i * width + j];
        norm = sqrt(norm);
        if (norm == 0.0)
            continue;
        double head = A[j * width + j], alpha = head > 0.0 ? -norm : norm, scale = 1.0 / (norm * (norm + fabs(head)));
        A[j * width + j] = head - alpha;
        for (int c = j + 1; c < width; c++)
            dots[c] = 0.0;
        for (int i = j; i < rows; i++) {
            double own = A[i * width + j];
            for (int c = j + 1; c < width; c++)
                dots[c] += own * A[i * width + c];
        }
        for (int i = j; i < rows; i++) {
            double own = A[i * width + j] * scale;
            for (int c = j + 1; c < width; c++)
                A[i * width + c] -= own * dots[c];
            A[i * width + j] = 0.0;
        }
        A[j * width + j] = alpha;
    }
}

/* Square-root Kalman filter and Rauch-Tung-Striebel smoother of a random walk of N states.
 *
 * An instant is measured by a triangle of rows, and a step of the walk is one row. Z: count x (N + 1) x (N + 1); W: (count - 1) x 1 x N; mean, root, before, smoothed: as in square_root_smoother.py.
 */
void smoother_run(ptrdiff_t count, const double *restrict Z, const double *restrict W, double *restrict mean,
                  double *restrict root, double *restrict before, double *restrict smoothed_mean,
                  double *restrict smoothed_root)
{
    double x[N] = {0.0}, U[N * N] = {0.0}, array[(ROWS + N) * (ROWS + N)], walk[(N + STEPS) * N], e[ROWS];
    for (int i = 0; i < N; i++)
        U[i * N + i] = 1.0;
    for (ptrdiff_t k = 0; k < count; k++) {
        const double *z = Z + k * ROWS * (N + 1);
        if (k > 0) {
            for (int i = 0; i < N * N; i++)
                walk[i] = U[i];
            for (int i = 0; i < STEPS * N; i++)
                walk[N * N + i] = W[(k - 1) * STEPS * N + i];
            triangularise(walk, N + STEPS, N, N);
            for (int i = 0; i < N * N; i++)
                U[i] = walk[i];
        }
        for (int i = 0; i < N * N; i++)
            before[k * N * N + i] = U[i];
        for (int i = 0; i < ROWS; i++) {
            e[i] = z[i * (N + 1) + N];
            for (int j = 0; j < N; j++)
                e[i] -= z[i * (N + 1) + j] * x[j];
            for (int j = 0; j < ROWS + N; j++)
                array[i * (ROWS + N) + j] = i == j;
        }
        for (int i = 0; i < N; i++) {
            for (int j = 0; j < ROWS; j++) {
                double total = 0.0;
                for (int h = i; h < N; h++)
                    total += U[i * N + h] * z[j * (N + 1) + h];
                array[(ROWS + i) * (ROWS + N) + j] = total;
            }
            for (int j = 0; j < N; j++)
                array[(ROWS + i) * (ROWS + N) + ROWS + j] = U[i * N + j];
        }
        triangularise(array, ROWS + N, ROWS + N, ROWS + N);
        for (int i = 0; i < ROWS; i++) {
            for (int h = 0; h < i; h++)
                e[i] -= array[h * (ROWS + N) + i] * e[h];
            e[i] /= array[i * (ROWS + N) + i];
            for (int j = 0; j < N; j++)
                x[j] += array[i * (ROWS + N) + ROWS + j] * e[i];
        }
        for (int i = 0; i < N; i++) {
            mean[k * N + i] = x[i];
            for (int j = 0; j < N; j++)
                U[i * N + j] = root[(k * N + i) * N + j] = array[(ROWS + i) * (ROWS + N) + ROWS + j];
        }
    }
    ptrdiff_t last = count - 1;
    for (int i = 0; i < N; i++)
        smoothed_mean[last * N + i] = mean[last * N + i];
    for (int i = 0; i < N * N; i++)
        smoothed_root[last * N * N + i] = root[last * N * N + i];
    double C[N * N], stack[(2 * N + STEPS) * N];
    for (ptrdiff_t k = count - 2; k >= 0; k--) {
        const double *P = root + k * N * N, *V = before + (k + 1) * N * N, *after = smoothed_root + (k + 1) * N * N;
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                double total = 0.0;
                for (int h = 0; h <= (i < j ? i : j); h++)
                    total += P[h * N + i] * P[h * N + j];
                C[i * N + j] = total;
            }
        for (int i = 0; i < N; i++) {
            double *c = C + i * N;
            for (int j = 0; j < N; j++) {
                for (int h = 0; h < j; h++)
                    c[j] -= V[h * N + j] * c[h];
                c[j] /= V[j * N + j];
            }
            for (int j = N - 1; j >= 0; j--) {
                for (int h = j + 1; h < N; h++)
                    c[j] -= V[j * N + h] * c[h];
                c[j] /= V[j * N + j];
            }
        }
        for (int i = 0; i < N; i++) {
            double total = mean[k * N + i];
            for (int j = 0; j < N; j++)
                total += C[i * N + j] * (smoothed_mean[(k + 1) * N + j] - mean[k * N + j]);
            smoothed_mean[k * N + i] = total;
        }
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                double own = P[i * N + j], later = 0.0;
                for (int h = 0; h < N; h++) {
                    own -= P[i * N + h] * C[j * N + h];
                    later += after[i * N + h] * C[j * N + h];
                }
                stack[i * N + j] = own;
                stack[(N + STEPS + i) * N + j] = later;
            }
        for (int i = 0; i < STEPS; i++)
            for (int j = 0; j < N; j++) {
                double total = 0.0;
                for (int h = 0; h < N; h++)
                    total += W[(k * STEPS + i) * N + h] * C[j * N + h];
                stack[(N + i) * N + j] = total;
            }
        triangularise(stack, 2 * N + STEPS, N, N);
        for (int i = 0; i < N * N; i++)
            smoothed_root[k * N * N + i] = stack[i];
    }
}
