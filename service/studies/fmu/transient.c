/* The transient pump at its ports: the simulation's own kernels, translated, in steps of fixed length. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "kernels.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* value references: 0 time, then inputs, health, numbers of pump and circuit, outputs, status */
#define FIRST_HEALTH (1 + N_INPUTS)
#define FIRST_NUMBER (FIRST_HEALTH + N_HEALTH)
#define FIRST_OUTPUT (FIRST_NUMBER + N_NUMBERS)
#define STATUS (FIRST_OUTPUT + N_OUTPUTS)
#define N_VARIABLES (STATUS + 1)
enum { SPEED_IN, SUCTION_IN, FLOW_IN, CASE_LINE_IN, TEMPERATURE_IN };
enum { RUNNING, DIVERGED };

typedef struct {
    double v[N_VARIABLES], y[N_STATES], row[N_ROW], flows[3 * N_FLOWS], states[4 * N_STATES];
    double clearances[2 * N_PISTONS], chambers[N_PISTONS * N_COLUMNS], A[36], b[6];
    T_parameters_Pump pump;
    T_parameters_Circuit circuit;
} Model;

#define VEC(name) (Vec){m->name, sizeof m->name / sizeof(double)}

static void begin(Model *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->v + 1, STARTS, sizeof STARTS);
    memcpy(m->y, STATE, sizeof STATE);
    memcpy(m->v + FIRST_OUTPUT, FIRST_OUTPUTS, sizeof FIRST_OUTPUTS);
    for (int k = 0; k < 2 * N_PISTONS; k++) m->clearances[k] = 1.0;
}

static void prepare(Model *m) {
    const double *u = m->v + 1;
    /* tuples of doubles in the order of the numbers: pump, then circuit */
    memcpy(&m->pump, m->v + FIRST_NUMBER, sizeof m->pump);
    memcpy(&m->circuit, m->v + FIRST_NUMBER + sizeof m->pump / sizeof(double), sizeof m->circuit);
    memset(m->row, 0, sizeof m->row);
    for (int i = 0; i < N_INPUTS; i++) if (INPUT_COLUMN[i] >= 0) m->row[INPUT_COLUMN[i]] = u[i];
    m->row[AMBIENT_COLUMN] = AMBIENT;
    for (int i = 0; i < N_HEALTH; i++) m->row[HEALTH_COLUMN[i]] = m->v[FIRST_HEALTH + i];
    m->pump.v_piston.v_n = N_PISTONS; /* the arrays' length; gaps stay as they are */
    m->pump.v_slipper.v_variable = 0.0;
}

static bool step(Model *m, const T_scene_Scene *scene, double dt) {
    T_step_Scratch scratch = {
        {m->clearances, N_PISTONS, 2}, {m->chambers, N_PISTONS, N_COLUMNS}, {m->A, 6, 6}, {m->b, 6}, {m->b, 0}};
    m->y[P_I] = (m->v[1 + CASE_LINE_IN] + AMBIENT) * 1.0e5; /* the far end of the drain is the other model's */
    bool ok = loop_advance(m->pump, m->circuit, *scene, VEC(y), dt, 0.0, 1, scratch,
                           (Mat){m->states, 4, N_STATES}, (Mat){m->flows, 3, N_FLOWS});
    if (m->y[P_D] < 0.0 || m->y[P_C] < 0.0) return false; /* nothing pulls a fluid */
    if (m->y[THETA] >= 6.283185307179586) m->y[THETA] -= 6.283185307179586;
    return ok;
}

static int advance(Model *m, double h) {
    if (m->v[STATUS] != RUNNING) return 3;
    prepare(m);
    T_scene_Scene scene = scene_scene_of(m->pump, m->circuit, VEC(row));
    double slow = m->v[1 + SPEED_IN] > FULL_STEP_RPM ? FULL_STEP_RPM / m->v[1 + SPEED_IN] : 1.0;
    int n = (int)ceil(h / (STEP_S * slow * slow * slow * slow) - 1.0e-9);
    if (n < 1) n = 1;
    double dt = h / n, sums[N_FLOWS] = {0.0};
    for (int i = 0; i < n; i++) {
        if (!step(m, &scene, dt)) { m->v[STATUS] = DIVERGED; return 3; }
        for (int j = 0; j < N_FLOWS; j++) sums[j] += m->flows[j] / n;
    }
    double *out = m->v + FIRST_OUTPUT;
    out[0] = m->y[P_D] / 1.0e5 - AMBIENT;
    out[1] = m->y[P_C] / 1.0e5 - AMBIENT;
    out[2] = fmax(m->y[P_CTRL], FLOOR) / 1.0e5 - AMBIENT;
    out[3] = sums[Q_SUCTION] * 6.0e4;
    out[4] = sums[Q_DRAIN] * 6.0e4;
    out[5] = sums[TORQUE];
    out[6] = m->y[ALPHA] * 57.29577951308232;
    out[7] = scene.v_T - 273.15 + fluid_throttling_heating(m->pump.v_fluid, scene.v_T, m->y[P_D], m->y[P_C]);
    return 0;
}

static Model *make(const char *token) {
    if (!token || strcmp(token, TOKEN)) return NULL;
    Model *m = malloc(sizeof *m);
    if (m) begin(m);
    return m;
}

static void reset(Model *m) { begin(m); }
static int go_on(Model *m, double t, double h) {
    m->v[0] = t + h;
    return advance(m, h);
}

static void refresh(Model *m) {}

#include "fmi.h"
