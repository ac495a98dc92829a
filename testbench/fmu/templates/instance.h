/* An instance of an FMU: its model, the values of its variables and the tick. fmi2.c and fmi3.c are the interface.

   A variable of one number has one slot, an array as many; a value reference is the number of the first. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "variables.h"

typedef union {
    double d;
    int64_t i;
} slot;

enum { ERROR_TEXT = 240 };

/* ---- the model: its state is MODEL_STATE bytes without pointers, so that a copy of them is a state ---- */

extern const size_t model_state_bytes;
void *model_open(const char *resources, char *error); /* what never changes; NULL and a text, if it cannot be had */
void model_close(void *constants);
void model_reset(const void *constants, void *state, slot *v);
/* Ticks from tick on by one: reads inputs, writes outputs; 0 and a text, if an input is impossible */
int model_step(const void *constants, void *state, int64_t tick, slot *v, char *error);

/* ---- the instance ---- */

typedef struct {
    int64_t tick;
    double begin_s;
    slot v[V_COUNT];
    int64_t state[]; /* of the model */
} snapshot;

typedef struct {
    void *constants;
    snapshot *now;
    int running;
    char error[ERROR_TEXT];
} instance;

/* 0 and a text in `error`, where something fails */
int instance_open(instance *c, const char *token, const char *resources);
void instance_close(instance *c);
void instance_reset(instance *c);
int instance_step(instance *c, double time_s, double step_s);
/* First slot of a variable of a kind (d i l b), NULL if there is none or, for writing, if it is no input */
slot *instance_slot(instance *c, uint32_t reference, const char *kinds, int writing);

snapshot *instance_copy(const snapshot *from); /* NULL without memory */
size_t instance_bytes(void);

#endif
