#include <math.h>

/* One rigid axle on an exponential surface: motor speed w, train speed v, torque t.
   p: radius, load, gear, efficiency, motor and wheelset inertia, mass, axles alike, transfer,
   resistance a, b and c, 1/lag, command, and a, b and c of the surface. */
static inline void rates(const double *restrict p, double w, double v, double t,
                         double *dw, double *dv, double *dt) {
    double slip = p[0] / p[2] * w - v, size = fabs(slip);
    double adhesion = p[16] * copysign(exp(-p[14] * size) - exp(-p[15] * size), slip);
    double force = adhesion * p[1] * 9.81 / (1.0 + adhesion * p[8]);
    double load = p[0] * force, inertia = p[5] / p[2];
    double to_wheel = 1.0 / (p[2] * p[3]), to_motor = p[3] / p[2];
    int driving = (inertia / p[4] * t + load) * w >= 0;
    *dw = (t - load * (driving ? to_wheel : to_motor))
        * (driving ? 1.0 / (p[4] + inertia * to_wheel) : 1.0 / (p[4] + inertia * to_motor));
    double speed = 3.6 * fabs(v), share = v * 100.0;
    share = share > 1.0 ? 1.0 : share < -1.0 ? -1.0 : share;
    *dv = p[7] * force / p[6] - (p[9] + speed * (p[10] + speed * p[11])) * share;
    *dt = p[12] * (p[13] - t);
}

/* No array overlaps another, so that what depends on p alone is computed once. */
#define WIDTH 64
void steps(long runs, long count, double h, const double *restrict p,
           double *restrict w, double *restrict v, double *restrict t) {
    for (long first = 0; first < runs; first += WIDTH) {
        long last = first + WIDTH < runs ? first + WIDTH : runs;
        for (long step = 0; step < count; step++) {
            #pragma GCC ivdep
            for (long i = first; i < last; i++) {
                double w1, v1, t1, w2, v2, t2, w3, v3, t3, w4, v4, t4, k = 0.5 * h;
                rates(p, w[i], v[i], t[i], &w1, &v1, &t1);
                rates(p, w[i] + k * w1, v[i] + k * v1, t[i] + k * t1, &w2, &v2, &t2);
                rates(p, w[i] + k * w2, v[i] + k * v2, t[i] + k * t2, &w3, &v3, &t3);
                rates(p, w[i] + h * w3, v[i] + h * v3, t[i] + h * t3, &w4, &v4, &t4);
                w[i] += h / 6 * (w1 + 2 * (w2 + w3) + w4);
                v[i] += h / 6 * (v1 + 2 * (v2 + v3) + v4);
                t[i] += h / 6 * (t1 + 2 * (t2 + t3) + t4);
            }
        }
    }
}
