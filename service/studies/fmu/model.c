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

static int get(Model *m, const unsigned *vr, size_t n, double *value) {
    solve(m);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= N_VARIABLES) return 3;
        value[i] = m->v[vr[i]];
    }
    return 0;
}

static int set(Model *m, const unsigned *vr, size_t n, const double *value) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 1 || vr[i] >= FIRST_OUTPUT) return 3;
        m->v[vr[i]] = value[i];
    }
    return 0;
}

static Model *make(const char *token) {
    if (!token || strcmp(token, TOKEN)) return NULL;
    Model *m = malloc(sizeof *m);
    if (m) { start(m); solve(m); }
    return m;
}

#define OK(name, ...) EXPORT int name(__VA_ARGS__) { return 0; }
#define NO(name) EXPORT int name(void) { return 3; }

#if FMI_VERSION == 2
EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int logging) { return type == 1 ? make(guid) : NULL; }
EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT int fmi2Reset(void *c) { start(c); solve(c); return 0; }
EXPORT int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *v) { return get(c, vr, n, v); }
EXPORT int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *v) { return set(c, vr, n, v); }
EXPORT int fmi2DoStep(void *c, double t, double h, int keep) { ((Model *)c)->v[0] = t + h; solve(c); return 0; }
OK(fmi2SetDebugLogging, void *c, int on, size_t n, const char *const *categories)
OK(fmi2SetupExperiment, void *c, int has, double tolerance, double t0, int stops, double t1)
OK(fmi2EnterInitializationMode, void *c)
OK(fmi2ExitInitializationMode, void *c)
OK(fmi2Terminate, void *c)
NO(fmi2GetInteger) NO(fmi2GetBoolean) NO(fmi2GetString) NO(fmi2SetInteger) NO(fmi2SetBoolean) NO(fmi2SetString)
NO(fmi2GetFMUstate) NO(fmi2SetFMUstate) NO(fmi2FreeFMUstate) NO(fmi2SerializedFMUstateSize) NO(fmi2SerializeFMUstate)
NO(fmi2DeSerializeFMUstate) NO(fmi2GetDirectionalDerivative) NO(fmi2SetRealInputDerivatives)
NO(fmi2GetRealOutputDerivatives) NO(fmi2CancelStep) NO(fmi2GetStatus) NO(fmi2GetRealStatus) NO(fmi2GetIntegerStatus)
NO(fmi2GetBooleanStatus) NO(fmi2GetStringStatus)
#else
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early, const unsigned *intermediate, size_t n,
                                         void *environment, void *log, void *update) { return make(token); }
EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
EXPORT void fmi3FreeInstance(void *c) { free(c); }
EXPORT int fmi3Reset(void *c) { start(c); solve(c); return 0; }
EXPORT int fmi3GetFloat64(void *c, const unsigned *vr, size_t n, double *v, size_t nv) {
    return nv == n ? get(c, vr, n, v) : 3;
}
EXPORT int fmi3SetFloat64(void *c, const unsigned *vr, size_t n, const double *v, size_t nv) {
    return nv == n ? set(c, vr, n, v) : 3;
}
EXPORT int fmi3DoStep(void *c, double t, double h, bool keep, bool *event, bool *stop, bool *early, double *last) {
    ((Model *)c)->v[0] = t + h;
    solve(c);
    *event = *stop = *early = false;
    *last = t + h;
    return 0;
}
OK(fmi3SetDebugLogging, void *c, bool on, size_t n, const char *const *categories)
OK(fmi3EnterInitializationMode, void *c, bool has, double tolerance, double t0, bool stops, double t1)
OK(fmi3ExitInitializationMode, void *c)
OK(fmi3EnterStepMode, void *c)
OK(fmi3EnterConfigurationMode, void *c)
OK(fmi3ExitConfigurationMode, void *c)
OK(fmi3Terminate, void *c)
NO(fmi3GetFloat32) NO(fmi3GetInt8) NO(fmi3GetUInt8) NO(fmi3GetInt16) NO(fmi3GetUInt16) NO(fmi3GetInt32) NO(fmi3GetUInt32)
NO(fmi3GetInt64) NO(fmi3GetUInt64) NO(fmi3GetBoolean) NO(fmi3GetString) NO(fmi3GetBinary) NO(fmi3GetClock)
NO(fmi3SetFloat32) NO(fmi3SetInt8) NO(fmi3SetUInt8) NO(fmi3SetInt16) NO(fmi3SetUInt16) NO(fmi3SetInt32) NO(fmi3SetUInt32)
NO(fmi3SetInt64) NO(fmi3SetUInt64) NO(fmi3SetBoolean) NO(fmi3SetString) NO(fmi3SetBinary) NO(fmi3SetClock)
NO(fmi3GetNumberOfVariableDependencies) NO(fmi3GetVariableDependencies) NO(fmi3GetFMUState) NO(fmi3SetFMUState)
NO(fmi3FreeFMUState) NO(fmi3SerializedFMUStateSize) NO(fmi3SerializeFMUState) NO(fmi3DeserializeFMUState)
NO(fmi3GetDirectionalDerivative) NO(fmi3GetAdjointDerivative) NO(fmi3GetIntervalDecimal) NO(fmi3GetIntervalFraction)
NO(fmi3GetShiftDecimal) NO(fmi3GetShiftFraction) NO(fmi3SetIntervalDecimal) NO(fmi3SetIntervalFraction)
NO(fmi3SetShiftDecimal) NO(fmi3SetShiftFraction) NO(fmi3EvaluateDiscreteStates) NO(fmi3UpdateDiscreteStates)
NO(fmi3EnterEventMode) NO(fmi3EnterContinuousTimeMode) NO(fmi3CompletedIntegratorStep) NO(fmi3SetTime)
NO(fmi3SetContinuousStates) NO(fmi3GetContinuousStateDerivatives) NO(fmi3GetEventIndicators) NO(fmi3GetContinuousStates)
NO(fmi3GetNominalsOfContinuousStates) NO(fmi3GetNumberOfEventIndicators) NO(fmi3GetNumberOfContinuousStates)
NO(fmi3GetOutputDerivatives) NO(fmi3ActivateModelPartition)
#endif
