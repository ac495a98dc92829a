/* FMI 2.0 for co-simulation: one communication step is one tick. */
#include "fmi2.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

enum { MOST_PATH = 1024 };

typedef struct {
    instance of;
    const fmi2CallbackFunctions *callbacks;
    char name[64];
} component;

static fmi2Status told(component *c, int good) {
    if (good) return fmi2OK;
    if (c->callbacks && c->callbacks->logger)
        c->callbacks->logger(c->callbacks->componentEnvironment, c->name, fmi2Error, "error", "%s", c->of.error);
    return fmi2Error;
}

#define FMI FMI2_Export
#define REFERENCES fmi2Component instance, const fmi2ValueReference references[], size_t count

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }

FMI fmi2Status fmi2SetDebugLogging(fmi2Component instance, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    return fmi2OK;
}

/* Path of a URI of the scheme file, with its %xx as bytes */
static int path_of(const char *uri, char *path) {
    size_t n = 0;
    if (!uri || strncmp(uri, "file:", 5) != 0) return 0;
    uri += 5;
    if (strncmp(uri, "//", 2) == 0) uri += 2 + strcspn(uri + 2, "/");
    for (unsigned byte; *uri; uri++) {
        if (n == MOST_PATH - 1) return 0;
        if (*uri == '%' && sscanf(uri + 1, "%2x", &byte) == 1) {
            path[n++] = (char)byte;
            uri += 2;
        } else path[n++] = *uri;
    }
    path[n] = 0;
    return 1;
}

FMI fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                  const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    char path[MOST_PATH];
    component *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    c->callbacks = callbacks;
    snprintf(c->name, sizeof c->name, "%s", name ? name : "");
    if (type != fmi2CoSimulation) snprintf(c->of.error, ERROR_TEXT, "fmuType: this FMU is for co-simulation");
    else if (!path_of(resources, path))
        snprintf(c->of.error, ERROR_TEXT, "fmuResourceLocation: %s is no URI of a file", resources ? resources : "NULL");
    else if (instance_open(&c->of, token, path)) return c;
    told(c, 0);
    instance_close(&c->of);
    free(c);
    return NULL;
}

FMI void fmi2FreeInstance(fmi2Component instance) {
    component *c = instance;
    if (c) instance_close(&c->of);
    free(c);
}

FMI fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                   fmi2Boolean has_stop, fmi2Real stop) {
    component *c = instance;
    c->of.now->begin_s = c->of.now->v[V_TIME].d = start;
    return fmi2OK;
}

FMI fmi2Status fmi2EnterInitializationMode(fmi2Component instance) { return fmi2OK; }

FMI fmi2Status fmi2ExitInitializationMode(fmi2Component instance) {
    ((component *)instance)->of.running = 1;
    return fmi2OK;
}

FMI fmi2Status fmi2Terminate(fmi2Component instance) {
    ((component *)instance)->of.running = 0;
    return fmi2OK;
}

FMI fmi2Status fmi2Reset(fmi2Component instance) {
    instance_reset(&((component *)instance)->of);
    return fmi2OK;
}

FMI fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
    component *c = instance;
    return told(c, instance_step(&c->of, time, step));
}

/* ---- values; a word of 64 bits is a Real ---- */

#define ACCESS(NAME, VALUES, KINDS, WRITING, COPY)                                                             \
    FMI fmi2Status NAME(REFERENCES, VALUES values[]) {                                                         \
        component *c = instance;                                                                               \
        for (size_t k = 0; k < count; k++) {                                                                   \
            slot *v = instance_slot(&c->of, references[k], KINDS, WRITING);                                    \
            if (!v) {                                                                                          \
                snprintf(c->of.error, ERROR_TEXT, #NAME ": value reference %u: no such variable", references[k]); \
                return told(c, 0);                                                                             \
            }                                                                                                  \
            COPY;                                                                                              \
        }                                                                                                      \
        return fmi2OK;                                                                                         \
    }
#define IS_WORD (V_KINDS[references[k]] == 'l')

ACCESS(fmi2GetReal, fmi2Real, "dl", 0, values[k] = IS_WORD ? (fmi2Real)v->i : v->d)
ACCESS(fmi2SetReal, const fmi2Real, "dl", 1, if (IS_WORD) v->i = (int64_t)values[k]; else v->d = values[k])
ACCESS(fmi2GetInteger, fmi2Integer, "i", 0, values[k] = (fmi2Integer)v->i)
ACCESS(fmi2SetInteger, const fmi2Integer, "i", 1, v->i = values[k])
ACCESS(fmi2GetBoolean, fmi2Boolean, "b", 0, values[k] = (fmi2Boolean)v->i)
ACCESS(fmi2SetBoolean, const fmi2Boolean, "b", 1, v->i = values[k] != 0)

/* ---- states ---- */

FMI fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate *state) {
    free(*state);
    *state = instance_copy(((component *)instance)->of.now);
    return *state ? fmi2OK : fmi2Error;
}

FMI fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state) {
    memcpy(((component *)instance)->of.now, state, instance_bytes());
    return fmi2OK;
}

FMI fmi2Status fmi2FreeFMUstate(fmi2Component instance, fmi2FMUstate *state) {
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FMI fmi2Status fmi2SerializedFMUstateSize(fmi2Component instance, fmi2FMUstate state, size_t *size) {
    *size = instance_bytes();
    return fmi2OK;
}

FMI fmi2Status fmi2SerializeFMUstate(fmi2Component instance, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size != instance_bytes()) return fmi2Error;
    memcpy(bytes, state, size);
    return fmi2OK;
}

FMI fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const fmi2Byte bytes[], size_t size,
                                       fmi2FMUstate *state) {
    if (size != instance_bytes()) return fmi2Error;
    if (!*state) *state = malloc(size);
    if (!*state) return fmi2Error;
    memcpy(*state, bytes, size);
    return fmi2OK;
}

/* ---- what this FMU does not have ---- */

#define NONE(NAME, ...) \
    FMI fmi2Status NAME(__VA_ARGS__) { return fmi2Error; }

NONE(fmi2GetString, REFERENCES, fmi2String values[])
NONE(fmi2SetString, REFERENCES, const fmi2String values[])
NONE(fmi2GetDirectionalDerivative, fmi2Component instance, const fmi2ValueReference unknowns[], size_t unknown_count,
     const fmi2ValueReference knowns[], size_t known_count, const fmi2Real seed[], fmi2Real sensitivity[])
NONE(fmi2SetRealInputDerivatives, REFERENCES, const fmi2Integer orders[], const fmi2Real values[])
NONE(fmi2GetRealOutputDerivatives, REFERENCES, const fmi2Integer orders[], fmi2Real values[])
NONE(fmi2CancelStep, fmi2Component instance)

/* A step ends before fmi2DoStep returns: nothing is pending, and there is no status to ask for */
FMI fmi2Status fmi2GetRealStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((component *)instance)->of.now->v[V_TIME].d;
    return fmi2OK;
}

#define NO_STATUS(NAME, TYPE) \
    FMI fmi2Status NAME(fmi2Component instance, const fmi2StatusKind kind, TYPE *value) { return fmi2Discard; }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)
