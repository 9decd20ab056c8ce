/* The recursions of vsalog's estimators as a C programmer tunes them by hand, to measure the production step against.
 *
 * The same arithmetic as vsalog/estimators/rls.py and qr.py, and nothing around it: no functionals, no uncertainty. The number of
 * unknowns N is known when it is compiled (-DN=4), so that loops are unrolled and vectorised without rests, and what a sample
 * needs stays in registers. One pass writes P and multiplies it by the regressors of the next sample. Whole rows of P: one
 * triangle alone has half the arithmetic, but its rows are of unlike lengths, and takes two and a half times as long for N = 18
 * (compile with -DTRIANGLE to see).
 */
#include <math.h>
#include <stddef.h>

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
