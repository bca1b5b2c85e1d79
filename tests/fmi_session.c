/* What an importer may do to an FMU, sane or not; with 3 or 2 for FMI_VERSION. Prints "ok". */
#if FMI_VERSION == 3
#include "fmi3.c"
#define NAME(x) fmi3##x
typedef fmi3Status status;
#else
#include "fmi2.c"
#define NAME(x) fmi2##x
typedef fmi2Status status;
#endif
#include <math.h>

#define NEED(test)                                                                                 \
    do {                                                                                           \
        if (!(test)) {                                                                             \
            printf("line %d: %s\n", __LINE__, #test);                                              \
            return 1;                                                                              \
        }                                                                                          \
    } while (0)

#if FMI_VERSION == 3
static fmi3Instance begun(const char *token)
{
    return fmi3InstantiateCoSimulation("one", token, NULL, false, false, false, false, NULL, 0,
                                       NULL, NULL, NULL);
}
static status initialized(fmi3Instance c)
{
    const status s = fmi3EnterInitializationMode(c, false, 0, 3.0, false, 0);
    return s ? s : fmi3ExitInitializationMode(c);
}
static status set(fmi3Instance c, fmi3ValueReference r, double x)
{
    return fmi3SetFloat64(c, &r, 1, &x, 1);
}
static status get(fmi3Instance c, fmi3ValueReference r, double *x)
{
    return fmi3GetFloat64(c, &r, 1, x, 1);
}
static status step(fmi3Instance c, double from, double h)
{
    bool a, b, d;
    double last;
    return fmi3DoStep(c, from, h, true, &a, &b, &d, &last);
}
#define STATE fmi3FMUState
#define KEEP fmi3GetFMUState
#define RESTORE fmi3SetFMUState
#define FORGET fmi3FreeFMUState
#define SIZE fmi3SerializedFMUStateSize
#define WRITE fmi3SerializeFMUState
#define READ fmi3DeserializeFMUState
typedef fmi3Byte byte;
typedef fmi3Instance component;
#else
static const fmi2CallbackFunctions functions = {NULL, calloc, free, NULL, NULL};
static fmi2Component begun(const char *token)
{
    return fmi2Instantiate("one", fmi2CoSimulation, token, NULL, &functions, 0, 0);
}
static status initialized(fmi2Component c)
{
    status s = fmi2SetupExperiment(c, 0, 0, 3.0, 0, 0);
    s = s ? s : fmi2EnterInitializationMode(c);
    return s ? s : fmi2ExitInitializationMode(c);
}
static status set(fmi2Component c, fmi2ValueReference r, double x)
{
    return fmi2SetReal(c, &r, 1, &x);
}
static status get(fmi2Component c, fmi2ValueReference r, double *x)
{
    return fmi2GetReal(c, &r, 1, x);
}
static status step(fmi2Component c, double from, double h)
{
    return fmi2DoStep(c, from, h, 1);
}
#define STATE fmi2FMUstate
#define KEEP fmi2GetFMUstate
#define RESTORE fmi2SetFMUstate
#define FORGET fmi2FreeFMUstate
#define SIZE fmi2SerializedFMUstateSize
#define WRITE fmi2SerializeFMUstate
#define READ fmi2DeSerializeFMUstate
typedef fmi2Byte byte;
typedef fmi2Component component;
#endif

static int outputs(component c, double found[MODEL_VARIABLES])
{
    unsigned r;
    for (r = 0; r < MODEL_VARIABLES; r++) {
        found[r] = 0;
        if (fmu_variables[r].kind == 'r' && (get(c, r, &found[r]) || !isfinite(found[r]))) {
            printf("%s is not read\n", fmu_variables[r].name);
            return 0;
        }
    }
    return 1;
}

int main(void)
{
    component c = begun(MODEL_TOKEN);
    double first[MODEL_VARIABLES], then[MODEL_VARIABLES], again[MODEL_VARIABLES];
    const double bad[3] = {NAN, INFINITY, -INFINITY};
    STATE kept = NULL, copied = NULL;
    size_t size = 0;
    byte *bytes;
    unsigned r;
    int k;
    NEED(c && !begun("another"));
    NEED(step(c, 3.0, 1e-3) == NAME(Error));
    NEED(initialized(c) == NAME(OK) && outputs(c, first));
    NEED(get(c, MODEL_VARIABLES, &then[0]) == NAME(Error));
    for (r = 1; r < MODEL_VARIABLES; r++) {
        const char role = fmu_variables[r].causality;
        for (k = 0; k < 3 && fmu_variables[r].kind == 'r'; k++) {
            NEED(set(c, r, bad[k]) == NAME(Error));
        }
        if (fmu_variables[r].kind == 'r') {
            NEED(set(c, r, first[r]) == (role == 'i' || role == 'p' ? NAME(OK) : NAME(Error)));
        }
    }
    NEED(set(c, 1, 0.4) == NAME(OK));
    for (k = 0; k < 50; k++) {
        NEED(step(c, 3.0 + 1e-3 * k, 1e-3) == NAME(OK));
    }
    NEED(KEEP(c, &kept) == NAME(OK) && SIZE(c, kept, &size) == NAME(OK));
    bytes = (byte *)malloc(size);
    NEED(bytes && WRITE(c, kept, bytes, size) == NAME(OK));
    NEED(step(c, 3.05, 0.5) == NAME(OK) && outputs(c, then));
    NEED(RESTORE(c, kept) == NAME(OK) && step(c, 3.05, 0.5) == NAME(OK) && outputs(c, again));
    NEED(memcmp(then, again, sizeof then) == 0 && memcmp(first, then, sizeof then) != 0);
    NEED(READ(c, bytes, size, &copied) == NAME(OK) && RESTORE(c, copied) == NAME(OK));
    NEED(step(c, 3.05, 0.5) == NAME(OK) && outputs(c, again));
    NEED(memcmp(then, again, sizeof then) == 0);
    NEED(step(c, 9.0, 1e-3) == NAME(Error) && step(c, 3.55, NAN) == NAME(Error));
    NEED(step(c, 3.55, -1e-3) == NAME(Error) && step(c, 3.55, 1e-3) == NAME(OK));
    NEED(NAME(Reset)(c) == NAME(OK) && initialized(c) == NAME(OK) && outputs(c, again));
    NEED(memcmp(first, again, sizeof first) == 0);
    NEED(FORGET(c, &kept) == NAME(OK) && FORGET(c, &copied) == NAME(OK));
    NEED(NAME(Terminate)(c) == NAME(OK));
    free(bytes);
    NAME(FreeInstance)(c);
    printf("ok\n");
    return 0;
}
