/* Couples the FMUs of firmware and plant, without Python: couple FIRMWARE PLANT TICKS [STIMULUS]

   FIRMWARE and PLANT are folders with the contents of firmware.fmu and plant.fmu. Lines of STIMULUS are
   "tick rate_rad_per_s temperature_degc", in order of tick; each holds from the frame in which its tick lies.
   Prints the hash of all codes: DAC codes of every tick, ADC codes and words of the loops of every frame. */
#include <dlfcn.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3.h"
#include "of_export.h"
#include "sha256.h"

enum { MOST = 64, TEXT = 200, BLOCK_TICKS = 125000, WORDS = 9 };

static void fail(const char *format, ...) {
    va_list values;
    va_start(values, format);
    vfprintf(stderr, format, values);
    fputc('\n', stderr);
    exit(1);
}

static void log_message(fmi3InstanceEnvironment who, fmi3Status status, fmi3String category, fmi3String message) {
    fprintf(stderr, "%s: %s: status %d: %s\n", (const char *)who, category, (int)status, message);
}

/* ---- an FMU: its description as text, and the functions of its library ---- */

typedef fmi3Instance instantiate(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                 const fmi3ValueReference[], size_t, fmi3InstanceEnvironment, fmi3LogMessageCallback,
                                 fmi3IntermediateUpdateCallback);
typedef fmi3Status initialize(fmi3Instance, fmi3Boolean, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Float64);
typedef fmi3Status plain(fmi3Instance);
typedef void release(fmi3Instance);
typedef fmi3Status do_step(fmi3Instance, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Boolean *, fmi3Boolean *,
                           fmi3Boolean *, fmi3Float64 *);
typedef fmi3Status get_ints(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Int32[], size_t);
typedef fmi3Status set_ints(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Int32[], size_t);
typedef fmi3Status get_longs(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Int64[], size_t);
typedef fmi3Status set_reals(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Float64[], size_t);

typedef struct {
    const char *name;
    char *description;
    void *library;
    fmi3Instance instance;
    do_step *step;
    get_ints *get;
    set_ints *set;
} fmu;

static char *text_of(const char *path) {
    FILE *file = fopen(path, "rb");
    char *text = calloc(1, 1 << 20);
    if (!file || !text || !fread(text, 1, (1 << 20) - 1, file)) fail("%s: cannot be read", path);
    fclose(file);
    return text;
}

static void *function(const fmu *f, const char *name) {
    void *found = dlsym(f->library, name);
    if (!found) fail("%s: no function %s", f->name, name);
    return found;
}

/* Text of an attribute behind a place of the description */
static void attribute(const fmu *f, const char *behind, const char *name, char *value, size_t size) {
    const char *from = strstr(f->description, behind), *at = from ? strstr(from, name) : NULL;
    if (!at) fail("%s: the description has no %s behind %s", f->name, name, behind);
    snprintf(value, size, "%.*s", (int)strcspn(at + strlen(name), "\""), at + strlen(name));
}

static fmi3ValueReference reference(const fmu *f, const char *name) {
    char quoted[TEXT], number[TEXT];
    snprintf(quoted, sizeof quoted, " name=\"%s\"", name);
    attribute(f, quoted, "valueReference=\"", number, sizeof number);
    return (fmi3ValueReference)strtoul(number, NULL, 10);
}

/* dlsym gives a pointer to data: POSIX says that it can be used so */
#define FUNCTION(type, f, name) (*(type **)&(void *){function(f, name)})

static fmu loaded(const char *name, const char *folder) {
    char path[4096], identifier[TEXT], token[TEXT];
    fmu f = {.name = name};
    snprintf(path, sizeof path, "%s/modelDescription.xml", folder);
    f.description = text_of(path);
    attribute(&f, "<CoSimulation", "modelIdentifier=\"", identifier, sizeof identifier);
    attribute(&f, "<fmiModelDescription", "instantiationToken=\"", token, sizeof token);
    snprintf(path, sizeof path, "%s/binaries/%s/%s%s", folder, PLATFORM, identifier, LIBRARY);
    f.library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!f.library) fail("%s", dlerror());
    snprintf(path, sizeof path, "%s/resources/", folder);
    f.instance = FUNCTION(instantiate, &f, "fmi3InstantiateCoSimulation")(name, token, path, 0, 0, 0, 0, NULL, 0,
                                                                          (void *)name, log_message, NULL);
    if (!f.instance || FUNCTION(initialize, &f, "fmi3EnterInitializationMode")(f.instance, 0, 0, 0, 0, 0) ||
        FUNCTION(plain, &f, "fmi3ExitInitializationMode")(f.instance))
        fail("%s: cannot be initialized", name);
    f.step = FUNCTION(do_step, &f, "fmi3DoStep");
    f.get = FUNCTION(get_ints, &f, "fmi3GetInt32");
    f.set = FUNCTION(set_ints, &f, "fmi3SetInt32");
    return f;
}

static void stepped(fmu *f, int64_t tick) {
    fmi3Boolean event, terminate, early;
    fmi3Float64 last;
    if (f->step(f->instance, (double)tick * TICK_S, TICK_S, 1, &event, &terminate, &early, &last))
        fail("%s: tick %" PRId64 " failed", f->name, tick);
}

/* ---- a connection: variables of one name, in one order ---- */

typedef struct {
    fmi3ValueReference from[MOST], to[MOST];
    size_t names, values;
} wires;

static const char *const TO_PLANT[] = {"drive_code", "sense_code", "quadrature_code", "drive_clock", "sense_clock",
                                       "edge_count", "edge_clock", "edge_pin", NULL};
static const char *const TO_FIRMWARE[] = {"adc_code", "drdy_clock", NULL};

static wires wired(const fmu *from, const fmu *to, const char *const *names, size_t values) {
    wires w = {.values = values};
    for (; names[w.names]; w.names++) {
        w.from[w.names] = reference(from, names[w.names]);
        w.to[w.names] = reference(to, names[w.names]);
    }
    return w;
}

static void moved(const wires *w, fmu *from, fmu *to, fmi3Int32 *values) {
    if (from->get(from->instance, w->from, w->names, values, w->values) ||
        to->set(to->instance, w->to, w->names, values, w->values))
        fail("%s to %s: values", from->name, to->name);
}

/* ---- the hash: a chain over blocks of ticks, docs/record.md of FTR gyro ---- */

typedef struct {
    unsigned char chain[32];
    sha256 drive, sense, words;
} codes;

static void begin(codes *c) {
    sha256_begin(&c->drive);
    sha256_begin(&c->sense);
    sha256_begin(&c->words);
}

static void add(sha256 *s, int64_t value, int bytes) {
    unsigned char little[8];
    for (int k = 0; k < bytes; k++) little[k] = (unsigned char)((uint64_t)value >> 8 * k);
    sha256_add(s, little, (size_t)bytes);
}

static void end(codes *c) {
    unsigned char digest[3][32];
    sha256 all;
    sha256_end(&c->drive, digest[0]);
    sha256_end(&c->sense, digest[1]);
    sha256_end(&c->words, digest[2]);
    sha256_begin(&all);
    sha256_add(&all, c->chain, 32);
    sha256_add(&all, digest, sizeof digest);
    sha256_end(&all, c->chain);
    begin(c);
}

/* ---- the loop ---- */

int main(int count, char **argument) {
    if (count < 4 || count > 5) fail("usage: couple FIRMWARE PLANT TICKS [STIMULUS]");
    fmu firmware = loaded("firmware", argument[1]), plant = loaded("plant", argument[2]);
    int64_t ticks = strtoll(argument[3], NULL, 10);
    FILE *stimulus = count == 5 ? fopen(argument[4], "r") : NULL;
    if (count == 5 && !stimulus) fail("%s: cannot be read", argument[4]);
    wires down = wired(&firmware, &plant, TO_PLANT, 22), up = wired(&plant, &firmware, TO_FIRMWARE, 6);
    fmi3ValueReference inputs[2] = {reference(&plant, "rate"), reference(&plant, "temperature")};
    fmi3ValueReference read = reference(&firmware, "read_code"), state = reference(&firmware, "state"), words[WORDS];
    const char *const names[] = {"frequency_word", "amplitude_word", "rate_word", "quadrature_word"};
    for (int k = 0; k < 4; k++) words[k] = reference(&firmware, names[k]);
    get_longs *get_longs_of = FUNCTION(get_longs, &firmware, "fmi3GetInt64");
    set_reals *set_reals_of = FUNCTION(set_reals, &plant, "fmi3SetFloat64");
    double at[2];
    int64_t next = INT64_MAX, locked = -1;
    codes c;
    memset(&c, 0, sizeof c);
    begin(&c);
    if (stimulus && fscanf(stimulus, "%" SCNd64 " %lf %lf", &next, &at[0], &at[1]) != 3) fail("%s: no line", argument[4]);
    for (int64_t tick = 0; tick < ticks; tick++) {
        fmi3Int32 values[MOST];
        if (tick % FRAME_TICKS == 0) {
            fmi3Int64 now[4];
            fmi3Int32 received[5], is;
            while (next <= tick) {
                if (set_reals_of(plant.instance, inputs, 2, at, 2)) fail("plant: rate and temperature");
                if (fscanf(stimulus, "%" SCNd64 " %lf %lf", &next, &at[0], &at[1]) != 3) next = INT64_MAX;
            }
            if (firmware.get(firmware.instance, &read, 1, received, 5) ||
                firmware.get(firmware.instance, &state, 1, &is, 1) ||
                get_longs_of(firmware.instance, words, 4, now, 4))
                fail("firmware: words");
            for (int k = 0; k < 5; k++) add(&c.words, received[k], 8);
            for (int k = 0; k < 4; k++) add(&c.words, now[k], 8);
            if (locked < 0 && is == LOCKED) locked = tick;
        }
        stepped(&firmware, tick);
        moved(&down, &firmware, &plant, values);
        add(&c.drive, values[0], 2);
        add(&c.sense, values[1], 4);
        stepped(&plant, tick);
        moved(&up, &plant, &firmware, values);
        if ((tick + 1) % BLOCK_TICKS == 0) end(&c);
    }
    end(&c);
    if (locked >= 0) printf("locked at %.6f s\n", (double)locked * TICK_S);
    printf("codes_sha256 ");
    for (int k = 0; k < 32; k++) printf("%02x", c.chain[k]);
    printf("\n");
    fmu *both[] = {&firmware, &plant};
    for (int k = 0; k < 2; k++) {
        FUNCTION(plain, both[k], "fmi3Terminate")(both[k]->instance);
        FUNCTION(release, both[k], "fmi3FreeInstance")(both[k]->instance);
        dlclose(both[k]->library);
        free(both[k]->description);
    }
    if (stimulus) fclose(stimulus);
    return 0;
}
