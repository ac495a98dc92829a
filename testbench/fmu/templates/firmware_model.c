/* The firmware with the digital sides of the converters, as a model of an FMU: a tick is so many clocks. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "engine.h"
#include "instance.h"
#include "start.h"
#include "top.h"

enum { CODE_BITS = 24, CHANNELS = 5, EDGES = 8, PINS = 4 };

typedef struct {
    gyro_top_State f[2];
    gyro_engine_Chips chips[2];
    int64_t now, refs;
} state_of;

static const slot v_start[] = V_START;

const size_t model_state_bytes = sizeof(state_of);

typedef struct {
    gyro_top_Params p;
    gyro_chips_Chips parts;
} constants_of;

void *model_open(const char *resources, char *error) {
    constants_of *c = malloc(sizeof *c);
    (void)resources;
    if (c) {
        memcpy(&c->p, start_params, sizeof c->p);
        memcpy(&c->parts, start_parts, sizeof c->parts);
    } else snprintf(error, ERROR_TEXT, "no memory");
    return c;
}

void model_close(void *constants) { free(constants); }

static void show(const state_of *s, slot *v) {
    const gyro_top_State *f = &s->f[s->now];
    const gyro_engine_Chips *chips = &s->chips[s->now];
    v[V_DRIVE_CODE].i = chips->drive.code;
    v[V_SENSE_CODE].i = chips->sense.code;
    v[V_QUADRATURE_CODE].i = chips->quadrature.code;
    for (int k = 0; k < CHANNELS; k++) v[V_READ_CODE + k].i = f->adc.channels[k];
    v[V_FREQUENCY_WORD].i = f->control.frequency_tracker.word;
    v[V_AMPLITUDE_WORD].i = f->control.agc.loop.y;
    v[V_RATE_WORD].i = f->control.rate_loop.loop.y;
    v[V_QUADRATURE_WORD].i = f->control.quadrature_loop.root.y;
    v[V_STATE].i = f->control.sequencer.state;
    v[V_LOCK].i = f->control.sequencer.lock.locked;
    v[V_FLAGS].i = f->control.sequencer.faults.flags;
    v[V_RATE_OUTPUT].d = (double)f->control.rate_output.y / 1048576.0;
}

void model_reset(const void *constants, void *state, slot *v) {
    state_of *s = state;
    gyro_top_Pins pins;
    memset(s, 0, sizeof *s);
    memcpy(&s->f[0], start_registers, sizeof s->f[0]);
    memcpy(&s->chips[0], start_chips, sizeof s->chips[0]);
    gyro_top_pins(&((const constants_of *)constants)->p, &s->f[0], &pins);
    s->refs = pins.refs;
    memcpy(v, v_start, sizeof v_start);
    v[V_DRIVE_CLOCK].i = v[V_SENSE_CLOCK].i = -1;
    show(s, v);
}

static int within(int64_t value, int64_t lo, int64_t hi, const char *name, char *error) {
    if (value >= lo && value <= hi) return 1;
    snprintf(error, ERROR_TEXT, "%s: %" PRId64 " is outside %" PRId64 " .. %" PRId64, name, value, lo, hi);
    return 0;
}

/* What the host writes in this tick: first what the configuration sets, then the inputs */
static int write_of(int64_t tick, const slot *v, gyro_top_Inputs *in, char *error) {
    if (tick < FIRST_WRITES) {
        in->write = 1;
        in->address = first_writes[tick][0];
        in->data = first_writes[tick][1];
        return 1;
    }
    in->write = v[V_HOST_WRITE].i;
    in->address = in->write ? v[V_HOST_ADDRESS].i : 0;
    in->data = in->write ? v[V_HOST_DATA].i : 0;
    return within(in->address, 0, 255, "host_address", error) &&
           within(in->data, 0, (INT64_C(1) << 48) - 1, "host_data", error);
}

int model_step(const void *constants, void *state, int64_t tick, slot *v, char *error) {
    const constants_of *of = constants;
    const gyro_top_Params *p = &of->p;
    state_of *s = state;
    gyro_top_Inputs in;
    gyro_top_Pins pins;
    int64_t codes[8] = {0}, ldacs[2], edges = 0, drdy = v[V_DRDY_CLOCK].i, write;
    memcpy(&in, start_inputs, sizeof in);
    if (!within(drdy, -1, GYRO_DESIGN_TICK_CLOCKS - 1, "drdy_clock", error) || !write_of(tick, v, &in, error)) return 0;
    for (int k = 0; k < CHANNELS; k++) {
        int64_t half = INT64_C(1) << (CODE_BITS - 1), sent = v[V_ADC_CODE + k].i;
        if (!within(sent, -half, half - 1, "adc_code", error)) return 0;
        codes[k] = sent & -gyro_shl(1, CODE_BITS - GYRO_DESIGN_ADC_WORD_BITS);
    }
    write = in.write;
    v[V_DRIVE_CLOCK].i = v[V_SENSE_CLOCK].i = -1;
    for (int64_t c = 0; c < GYRO_DESIGN_TICK_CLOCKS; c++) {
        const gyro_engine_Chips *chips = &s->chips[s->now];
        gyro_engine_Chips *after = &s->chips[s->now ^ 1];
        in.drdy_n = chips->adc.drdy_n;
        in.dout = chips->adc.out;
        in.write = c == 0 ? write : 0;
        gyro_top_step(p, &s->f[s->now], &in, &s->f[s->now ^ 1]);
        gyro_top_pins(p, &s->f[s->now ^ 1], &pins);
        gyro_top_other_ldacs(&s->f[s->now ^ 1], ldacs);
        gyro_engine_chips_after(&of->parts, GYRO_DESIGN_ADC_WORD_BITS, chips, &pins, ldacs, c == drdy, STATUS, codes, after);
        s->now ^= 1;
        if (after->drive.updated) v[V_DRIVE_CLOCK].i = c;
        if (after->sense.updated) v[V_SENSE_CLOCK].i = c;
        for (int d = 0; d < PINS && pins.refs != s->refs; d++)
            if ((pins.refs ^ s->refs) >> d & 1 && edges < EDGES) {
                v[V_EDGE_CLOCK + edges].i = c;
                v[V_EDGE_PIN + edges++].i = d;
            }
        s->refs = pins.refs;
    }
    v[V_EDGE_COUNT].i = edges;
    for (int64_t k = edges; k < EDGES; k++) v[V_EDGE_CLOCK + k].i = v[V_EDGE_PIN + k].i = 0;
    show(s, v);
    return 1;
}
