/* FMI 3.0 for co-simulation: one communication step is one tick. */
#include "fmi3.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef struct {
    instance of;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} component;

static fmi3Status told(component *c, int good) {
    if (good) return fmi3OK;
    if (c->log) c->log(c->environment, fmi3Error, "error", c->of.error);
    return fmi3Error;
}

#define FMI FMI3_Export
#define REFERENCES fmi3Instance instance, const fmi3ValueReference references[], size_t count

FMI const char *fmi3GetVersion(void) { return "3.0"; }

FMI fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    return fmi3OK;
}

FMI fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference required[], size_t required_count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    component *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    c->environment = environment;
    c->log = log;
    if (!event_mode && instance_open(&c->of, token, resources)) return c;
    if (event_mode) snprintf(c->of.error, ERROR_TEXT, "eventModeUsed: this FMU has no event mode");
    told(c, 0);
    instance_close(&c->of);
    free(c);
    return NULL;
}

FMI void fmi3FreeInstance(fmi3Instance instance) {
    component *c = instance;
    if (c) instance_close(&c->of);
    free(c);
}

FMI fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                           fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
    component *c = instance;
    c->of.now->begin_s = c->of.now->v[V_TIME].d = start;
    return fmi3OK;
}

FMI fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    ((component *)instance)->of.running = 1;
    return fmi3OK;
}

FMI fmi3Status fmi3Terminate(fmi3Instance instance) {
    ((component *)instance)->of.running = 0;
    return fmi3OK;
}

FMI fmi3Status fmi3Reset(fmi3Instance instance) {
    instance_reset(&((component *)instance)->of);
    return fmi3OK;
}

FMI fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_set_state,
                          fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    component *c = instance;
    int good = instance_step(&c->of, time, step);
    *event = *terminate = *early = 0;
    *last = c->of.now->v[V_TIME].d;
    return told(c, good);
}

/* ---- values ---- */

static fmi3Status wrong(component *c, const char *what, unsigned reference) {
    snprintf(c->of.error, ERROR_TEXT, "%s: value reference %u: no such variable, or not as many values", what, reference);
    return told(c, 0);
}

#define ACCESS(NAME, TYPE, VALUES, KINDS, WRITING, COPY)                                          \
    FMI fmi3Status NAME(REFERENCES, VALUES values[], size_t n) {                                  \
        component *c = instance;                                                                  \
        size_t at = 0;                                                                            \
        for (size_t k = 0; k < count; k++) {                                                      \
            slot *v = instance_slot(&c->of, references[k], KINDS, WRITING);                       \
            if (!v || !v_size[references[k]] || n - at < v_size[references[k]])                   \
                return wrong(c, #NAME, (unsigned)references[k]);                                  \
            for (size_t j = 0; j < v_size[references[k]]; j++, v++, at++) COPY;                   \
        }                                                                                         \
        return at == n ? fmi3OK : wrong(c, #NAME, count ? (unsigned)references[count - 1] : 0);   \
    }
#define BOTH(TYPE, KINDS, MEMBER)                                                                 \
    ACCESS(fmi3Get##TYPE, TYPE, fmi3##TYPE, KINDS, 0, values[at] = (fmi3##TYPE)v->MEMBER)         \
    ACCESS(fmi3Set##TYPE, TYPE, const fmi3##TYPE, KINDS, 1, v->MEMBER = values[at])

BOTH(Float64, "d", d)
BOTH(Int32, "i", i)
BOTH(Int64, "l", i)
BOTH(Boolean, "b", i)

/* ---- types that no variable has ---- */

#define NONE(NAME, ...) \
    FMI fmi3Status NAME(__VA_ARGS__) { return fmi3Error; }
#define NO_TYPE(TYPE)                                                        \
    NONE(fmi3Get##TYPE, REFERENCES, fmi3##TYPE values[], size_t n)           \
    NONE(fmi3Set##TYPE, REFERENCES, const fmi3##TYPE values[], size_t n)

NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(UInt32)
NO_TYPE(UInt64)
NO_TYPE(String)
NONE(fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t n)
NONE(fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t n)
NONE(fmi3GetClock, REFERENCES, fmi3Clock values[])
NONE(fmi3SetClock, REFERENCES, const fmi3Clock values[])

/* ---- states ---- */

FMI fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    component *c = instance;
    free(*state);
    *state = instance_copy(c->of.now);
    return *state ? fmi3OK : fmi3Error;
}

FMI fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    memcpy(((component *)instance)->of.now, state, instance_bytes());
    return fmi3OK;
}

FMI fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    free(*state);
    *state = NULL;
    return fmi3OK;
}

FMI fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    *size = instance_bytes();
    return fmi3OK;
}

FMI fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size != instance_bytes()) return fmi3Error;
    memcpy(bytes, state, size);
    return fmi3OK;
}

FMI fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                       fmi3FMUState *state) {
    if (size != instance_bytes()) return fmi3Error;
    if (!*state) *state = malloc(size);
    if (!*state) return fmi3Error;
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* ---- what co-simulation without events does not have ---- */

FMI fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                              fmi3Boolean visible, fmi3Boolean logging,
                                              fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    return NULL;
}

FMI fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging,
                                                   fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                   fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                                   fmi3UnlockPreemptionCallback unlock) {
    return NULL;
}

NONE(fmi3EnterEventMode, fmi3Instance instance)
NONE(fmi3EnterStepMode, fmi3Instance instance)
NONE(fmi3EnterContinuousTimeMode, fmi3Instance instance)
NONE(fmi3EnterConfigurationMode, fmi3Instance instance)
NONE(fmi3ExitConfigurationMode, fmi3Instance instance)
NONE(fmi3GetNumberOfVariableDependencies, fmi3Instance instance, fmi3ValueReference reference, size_t *n)
NONE(fmi3GetVariableDependencies, fmi3Instance instance, fmi3ValueReference dependent, size_t elements[],
     fmi3ValueReference independents[], size_t of[], fmi3DependencyKind kinds[], size_t n)
#define DERIVATIVE                                                                                              \
    fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknown_count,                           \
        const fmi3ValueReference knowns[], size_t known_count, const fmi3Float64 seed[], size_t seed_count,     \
        fmi3Float64 sensitivity[], size_t sensitivity_count
NONE(fmi3GetDirectionalDerivative, DERIVATIVE)
NONE(fmi3GetAdjointDerivative, DERIVATIVE)
NONE(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t n)
NONE(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NONE(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
     fmi3IntervalQualifier qualifiers[])
NONE(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
NONE(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NONE(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
NONE(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NONE(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
NONE(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NONE(fmi3EvaluateDiscreteStates, fmi3Instance instance)
NONE(fmi3UpdateDiscreteStates, fmi3Instance instance, fmi3Boolean *needed, fmi3Boolean *terminate, fmi3Boolean *nominals,
     fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next)
NONE(fmi3CompletedIntegratorStep, fmi3Instance instance, fmi3Boolean no_set_state, fmi3Boolean *event,
     fmi3Boolean *terminate)
NONE(fmi3SetTime, fmi3Instance instance, fmi3Float64 time)
NONE(fmi3SetContinuousStates, fmi3Instance instance, const fmi3Float64 states[], size_t n)
NONE(fmi3GetContinuousStateDerivatives, fmi3Instance instance, fmi3Float64 derivatives[], size_t n)
NONE(fmi3GetEventIndicators, fmi3Instance instance, fmi3Float64 indicators[], size_t n)
NONE(fmi3GetContinuousStates, fmi3Instance instance, fmi3Float64 states[], size_t n)
NONE(fmi3GetNominalsOfContinuousStates, fmi3Instance instance, fmi3Float64 nominals[], size_t n)
NONE(fmi3GetNumberOfEventIndicators, fmi3Instance instance, size_t *n)
NONE(fmi3GetNumberOfContinuousStates, fmi3Instance instance, size_t *n)
NONE(fmi3ActivateModelPartition, fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
