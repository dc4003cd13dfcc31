/* The model of peers_model.py by Heun's method, exact plays: N runs side by side. */
#include <math.h>
#define N 16
#define FLAT _Pragma("GCC unroll 32")
#define EACH _Pragma("omp simd") for (int i = 0; i < N; i++)
typedef double lane[N];
static const double R[8] = {.01, .02, .03, .04, .05, .06, .07, .08};

static inline double nozzle(double area, double one, double other, double warm, const double *c) {
  double up = fmax(one, other), down = fmin(one, other), ratio = down / up;
  double inside = fmin(fmax(ratio, CRITICAL), 0.999), z = (inside - MIDDLE) / HALF, s = c[DEGREE];
  FLAT for (int j = DEGREE - 1; j >= 0; j--) s = s * z + c[j];
  double size = area * up * sqrt(2 * 1.4 / (0.4 * 287.0 * warm) * s) * fmin((1 - ratio) / 0.001, 1.0);
  return one >= other ? size : -size;
}

static inline void rates(const lane *y, const lane *f, double u, const lane *q, const double *c, const double *w,
                         lane *d) {
  EACH {
    double o = y[0][i], p = y[1][i], x = y[2][i], v = y[3][i], l0 = q[4][i], warm = q[10][i];
    double gauge = p - q[9][i], strain = x / l0, sine = q[16][i], co2 = 1 - sine * sine;
    double flow = nozzle(q[0][i] * fmax(o, 0), q[3][i], p, warm, c) - nozzle(q[0][i] * fmax(-o, 0), p, q[9][i], warm, c);
    double ratio = 1 - strain, scale = M_PI * q[5][i] * q[5][i], over = 1 / (sine * sine);
    double volume = scale * l0 * ratio * (1 - co2 * ratio * ratio) * over;
    double swept = -scale * (1 - 3 * co2 * ratio * ratio) * over * (x <= 0 ? fmax(v, 0) : v);
    double n = 1 - q[7][i] * strain, loop = 0;
    double surface = 2 * M_PI * q[5][i] * l0 * sine / (n * sqrt(1 - co2 * n * n));
    FLAT for (int j = 0; j < 8; j++) loop += w[j] * (strain - fmax(strain - R[j], fmin(strain + R[j], f[j][i])));
    double force = scale * gauge * (3 * co2 * over * n * n - over - q[15][i] * loop);
    double limit = q[14][i] + (q[12][i] + (q[11][i] - q[12][i]) * exp(-fabs(v) / q[13][i])) * surface * fmax(gauge, 0);
    double m = q[8][i], driving = force - m * 9.80665;
    double slip = fmax(fmin((driving + m * v / 5e-4) / limit, 1), -1), pushed = (driving - limit * slip) / m;
    d[0][i] = (u / q[2][i] - o) / q[1][i];
    d[1][i] = (287.0 * warm * flow - p * swept) / volume;
    d[2][i] = v;
    d[3][i] = x <= 0 ? fmax(pushed, 0) : pushed;
  }
}

static void lanes(int samples, int substeps, double h, const double *u, const lane *q, const double *c, const double *w, double *top,
                  double *path) {
  lane y[4], f[8], k1[4], k2[4], z[4];
  EACH { y[0][i] = 0; y[1][i] = 101325.0; y[2][i] = 0; y[3][i] = 0; top[i] = 0; FLAT for (int j = 0; j < 8; j++) f[j][i] = 0; }
  for (int row = 0; row < samples; row++) {
    if (path) path[row] = y[2][0];
    EACH top[i] = fmax(top[i], y[2][i]);
    for (int sub = 0; sub < substeps; sub++) {
      rates(y, f, u[row], q, c, w, k1);
      for (int s = 0; s < 4; s++) EACH z[s][i] = y[s][i] + h * k1[s][i];
      rates(z, f, u[row], q, c, w, k2);
      for (int s = 0; s < 4; s++) EACH y[s][i] += h / 2 * (k1[s][i] + k2[s][i]);
      EACH {
        double down = y[2][i] <= 0, strain = (y[2][i] = down ? 0 : y[2][i]) / q[4][i];
        y[3][i] = down ? fmax(y[3][i], 0) : y[3][i];
        FLAT for (int j = 0; j < 8; j++) f[j][i] = fmax(strain - R[j], fmin(strain + R[j], f[j][i]));
      }
    }
  }
}

/* q: runs x 17 parameters (the sine of the braid angle last); top: largest position of each; path: of the first. */
void batch(int runs, int samples, int substeps, double h, const double *u, const double *q, const double *c, const double *w,
           double *top, double *path) {
#pragma omp parallel for schedule(dynamic, 4)
  for (int b = 0; b < runs / N; b++) {
    lane p[17];
    for (int k = 0; k < 17; k++) EACH p[k][i] = q[(b * N + i) * 17 + k];
    lanes(samples, substeps, h, u, (const lane *)p, c, w, top + b * N, b == 0 ? path : 0);
  }
}
