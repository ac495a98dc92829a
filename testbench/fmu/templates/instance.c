#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

size_t instance_bytes(void) { return sizeof(snapshot) + model_state_bytes; }

snapshot *instance_copy(const snapshot *from) {
    snapshot *to = malloc(instance_bytes());
    if (to) memcpy(to, from, instance_bytes());
    return to;
}

void instance_reset(instance *c) {
    memset(c->now, 0, instance_bytes());
    model_reset(c->constants, c->now->state, c->now->v);
    c->running = 0;
}

int instance_open(instance *c, const char *token, const char *resources) {
    if (!token || strcmp(token, TOKEN) != 0) {
        snprintf(c->error, ERROR_TEXT, "instantiation token: expected %s, that of the model description", TOKEN);
        return 0;
    }
    c->constants = model_open(resources, c->error);
    c->now = c->constants ? malloc(instance_bytes()) : NULL;
    if (!c->now) {
        if (c->constants) snprintf(c->error, ERROR_TEXT, "no memory");
        return 0;
    }
    instance_reset(c);
    return 1;
}

void instance_close(instance *c) {
    if (c->constants) model_close(c->constants);
    free(c->now);
}

int instance_step(instance *c, double time_s, double step_s) {
    snapshot *now = c->now;
    double due_s = now->begin_s + (double)now->tick / TICK_HZ;
    if (!c->running) {
        snprintf(c->error, ERROR_TEXT, "a step outside of step mode");
        return 0;
    }
    if (!(fabs(step_s * TICK_HZ - 1.0) < 1e-6)) {
        snprintf(c->error, ERROR_TEXT, "communicationStepSize: %.9g s, expected %.9g s, one tick", step_s, 1.0 / TICK_HZ);
        return 0;
    }
    if (!(fabs(time_s - due_s) * TICK_HZ < 0.5)) {
        snprintf(c->error, ERROR_TEXT, "currentCommunicationPoint: %.9g s, expected %.9g s", time_s, due_s);
        return 0;
    }
    if (!model_step(c->constants, now->state, now->tick, now->v, c->error)) return 0;
    now->tick++;
    now->v[V_TIME].d = now->begin_s + (double)now->tick / TICK_HZ;
    return 1;
}

slot *instance_slot(instance *c, uint32_t reference, const char *kinds, int writing) {
    if (reference >= V_COUNT || !strchr(kinds, V_KINDS[reference])) return NULL;
    return writing && !v_input[reference] ? NULL : &c->now->v[reference];
}
