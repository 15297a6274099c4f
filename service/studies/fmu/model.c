/* Operating point of a hydraulic pump as a table: multilinear in speed, temperature, flow share and leakage scale, linear in the
   rest. No dependencies but the C library. Compiled with FMI_VERSION 2 or 3. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "map.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* value references: 0 time, then inputs, parameters, outputs, status */
#define FIRST_OUTPUT (1 + N_INPUTS)
#define STATUS (FIRST_OUTPUT + N_OUTPUTS)
#define N_VARIABLES (STATUS + 1)
enum { SPEED, TEMPERATURE, FLOW, RESERVOIR, LEAKAGE, SYSTEM, SETTING, DRAIN };
enum { SOLVED, CLAMPED, NO_STEADY_STATE };

typedef struct { double v[N_VARIABLES]; } Model;

static void start(Model *m) {
    memset(m->v, 0, sizeof m->v);
    memcpy(m->v + 1, STARTS, sizeof STARTS);
}

static void solve(Model *m) {
    const double *u = m->v + 1;
    double x[4] = {u[SPEED], u[TEMPERATURE], 0.0, u[LEAKAGE]}, w[4];
    int cell[4], status = SOLVED;
    x[2] = u[SPEED] > 0.0 ? u[FLOW] / (u[SPEED] * DELIVERY) : 0.0;
    for (int a = 0; a < 4; a++) {
        const double *axis = AXES[a];
        int n = LENGTHS[a], i = 0;
        if (!(x[a] >= axis[0] - 1e-9 && x[a] <= axis[n - 1] + 1e-9)) status = CLAMPED;
        if (!(x[a] >= axis[0])) x[a] = axis[0];
        if (x[a] > axis[n - 1]) x[a] = axis[n - 1];
        while (i < n - 2 && x[a] > axis[i + 1]) i++;
        cell[a] = i;
        w[a] = (x[a] - axis[i]) / (axis[i + 1] - axis[i]);
    }
    double d[N_LINEAR] = {u[RESERVOIR] - ORIGIN[0], u[SYSTEM] - ORIGIN[1], u[SETTING] - ORIGIN[2], u[DRAIN] - ORIGIN[3]};
    double sum[N_OUTPUTS] = {0.0};
    for (int corner = 0; corner < 16; corner++) {
        double weight = 1.0;
        int node = 0;
        for (int a = 0; a < 4; a++) {
            int up = (corner >> a) & 1;
            weight *= up ? w[a] : 1.0 - w[a];
            node = node * LENGTHS[a] + cell[a] + up;
        }
        if (weight == 0.0) continue;
        const double *at = MAP + (size_t)node * N_OUTPUTS * (1 + N_LINEAR);
        for (int k = 0; k < N_OUTPUTS; k++, at += 1 + N_LINEAR) {
            double value = at[0];
            for (int j = 0; j < N_LINEAR; j++) value += at[1 + j] * d[j];
            sum[k] += weight * value;
        }
    }
    for (int k = 0; k < N_OUTPUTS; k++)
        if (!isfinite(sum[k])) { m->v[STATUS] = NO_STEADY_STATE; return; } /* the last values stay */
    memcpy(m->v + FIRST_OUTPUT, sum, sizeof sum);
    m->v[STATUS] = status;
}

static Model *make(const char *token) {
    if (!token || strcmp(token, TOKEN)) return NULL;
    Model *m = malloc(sizeof *m);
    if (m) { start(m); solve(m); }
    return m;
}

static void reset(Model *m) { start(m); solve(m); }
static int go_on(Model *m, double t, double h) {
    m->v[0] = t + h;
    solve(m);
    return 0;
}

static void refresh(Model *m) { solve(m); }

#include "fmi.h"
