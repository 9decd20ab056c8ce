/* The recursions of vsalog's estimators in plain C, to measure the compiled Python against.
 *
 * The same arithmetic as vsalog/estimators/rls.py and qr.py, without anything around it. Rows are contiguous and nothing
 * aliases, so the compiler is free to vectorise whatever it may without changing the order of a sum.
 */
#include <math.h>
#include <stddef.h>

/* Enhanced recursive least squares: Flacco 2012 eq. 23, 39, 41. */
void rls_run(ptrdiff_t count, ptrdiff_t n, const double *restrict F, const double *restrict y, double c,
             double *restrict alpha, double *restrict P, double *restrict g)
{
    for (ptrdiff_t k = 0; k < count; k++) {
        const double *f = F + k * n;
        double rho = 0.0, error = y[k];
        for (ptrdiff_t i = 0; i < n; i++) {
            double s = 0.0;
            for (ptrdiff_t j = 0; j < n; j++)
                s += P[i * n + j] * f[j];
            g[i] = s;
            rho += f[i] * s;
            error -= f[i] * alpha[i];
        }
        double a = (c + c * rho) / (1.0 + c * rho);
        double gain = a / (1.0 + rho);
        for (ptrdiff_t i = 0; i < n; i++) {
            double w = gain * g[i];
            alpha[i] += w * error;
            for (ptrdiff_t j = 0; j < n; j++)
                P[i * n + j] -= w * g[j];
        }
    }
}

/* Rotate samples into [R p] and solve after each: Flacco 2014 eq. 21-23. */
void qr_run(ptrdiff_t count, ptrdiff_t n, const double *restrict F, const double *restrict y, double forgetting,
            double *restrict Rp, double *restrict row, double *restrict xi)
{
    ptrdiff_t width = n + 1;
    for (ptrdiff_t k = 0; k < count; k++) {
        for (ptrdiff_t j = 0; j < n; j++)
            row[j] = F[k * n + j];
        row[n] = y[k];
        for (ptrdiff_t i = 0; i < n; i++) {
            double *R = Rp + i * width;
            if (forgetting != 1.0)
                for (ptrdiff_t j = i; j < width; j++)
                    R[j] *= forgetting;
            double x = row[i], r = R[i];
            if (x == 0.0)
                continue;
            double h = sqrt(r * r + x * x), cosine = r / h, sine = x / h;
            R[i] = h;
            for (ptrdiff_t j = i + 1; j < width; j++) {
                double p = R[j], q = row[j];
                R[j] = cosine * p + sine * q;
                row[j] = cosine * q - sine * p;
            }
        }
        for (ptrdiff_t i = n - 1; i >= 0; i--) {
            double s = Rp[i * width + n];
            for (ptrdiff_t j = i + 1; j < n; j++)
                s -= Rp[i * width + j] * xi[j];
            xi[i] = s / Rp[i * width + i];
        }
    }
}
