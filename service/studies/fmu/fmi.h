/* The functions of FMI 2.0 and 3.0 for co-simulation over make, reset, go_on and refresh of a Model, whose v holds the values
   by reference; refresh brings its outputs up to date before they are read. */
static int get(Model *m, const unsigned *vr, size_t n, double *value) {
    refresh(m);
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

#define OK(name, ...) EXPORT int name(__VA_ARGS__) { return 0; }
#define NO(name) EXPORT int name(void) { return 3; }

#if FMI_VERSION == 2
EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int logging) { return type == 1 ? make(guid) : NULL; }
EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT int fmi2Reset(void *c) { reset(c); return 0; }
EXPORT int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *v) { return get(c, vr, n, v); }
EXPORT int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *v) { return set(c, vr, n, v); }
EXPORT int fmi2DoStep(void *c, double t, double h, int keep) { return go_on(c, t, h); }
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
EXPORT int fmi3Reset(void *c) { reset(c); return 0; }
EXPORT int fmi3GetFloat64(void *c, const unsigned *vr, size_t n, double *v, size_t nv) {
    return nv == n ? get(c, vr, n, v) : 3;
}
EXPORT int fmi3SetFloat64(void *c, const unsigned *vr, size_t n, const double *v, size_t nv) {
    return nv == n ? set(c, vr, n, v) : 3;
}
EXPORT int fmi3DoStep(void *c, double t, double h, bool keep, bool *event, bool *stop, bool *early, double *last) {
    *event = *stop = *early = false;
    *last = t + h;
    return go_on(c, t, h);
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
