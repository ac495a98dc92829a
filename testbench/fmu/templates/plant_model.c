/* The plant as a model of an FMU. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "instance.h"
#include "plant.h"

static const slot v_start[] = V_START;

const size_t model_state_bytes = sizeof(plant_state);

void *model_open(const char *resources, char *error) {
    char path[1024];
    const char *folder = resources ? resources : "", *slash = *folder && folder[strlen(folder) - 1] == '/' ? "" : "/";
    if (snprintf(path, sizeof path, "%s%splant.bin", folder, slash) >= (int)sizeof path) {
        snprintf(error, ERROR_TEXT, "the path of the resources has more than %d characters", (int)sizeof path - 12);
        return NULL;
    }
    return plant_read(path, error, ERROR_TEXT);
}

void model_close(void *constants) { plant_free(constants); }

static void show(const plant_state *s, int64_t drdy, slot *v) {
    for (int k = 0; k < CHANNELS; k++) v[V_ADC_CODE + k].i = s->codes[k];
    v[V_DRDY_CLOCK].i = drdy;
    v[V_X].d = s->z[6];
    v[V_Y].d = s->z[8];
}

void model_reset(const void *constants, void *state, slot *v) {
    const plant_constants *p = constants;
    plant_reset(p, state);
    memcpy(v, v_start, sizeof v_start);
    show(state, -1, v);
}

static int within(int64_t value, int64_t lo, int64_t hi, const char *name, char *error) {
    if (value >= lo && value <= hi) return 1;
    snprintf(error, ERROR_TEXT, "%s: %" PRId64 " is outside %" PRId64 " .. %" PRId64, name, value, lo, hi);
    return 0;
}

static int pins_of(const plant_constants *p, const slot *v, plant_pins *pins, char *error) {
    *pins = (plant_pins){{v[V_DRIVE_CODE].i, v[V_SENSE_CODE].i}, {v[V_DRIVE_CLOCK].i, v[V_SENSE_CLOCK].i},
                         v[V_EDGE_COUNT].i, {0}, {0}};
    if (!within(pins->clock[0], -1, p->clocks - 1, "drive_clock", error) ||
        !within(pins->clock[1], -1, p->clocks - 1, "sense_clock", error) ||
        !within(pins->edge_count, 0, EDGES, "edge_count", error))
        return 0;
    for (int64_t k = 0; k < pins->edge_count; k++) {
        pins->edge_clock[k] = v[V_EDGE_CLOCK + k].i;
        pins->edge_pin[k] = v[V_EDGE_PIN + k].i;
        if (!within(pins->edge_clock[k], k ? pins->edge_clock[k - 1] : 0, p->clocks - 1, "edge_clock", error) ||
            !within(pins->edge_pin[k], 0, 3, "edge_pin", error))
            return 0;
    }
    return 1;
}

int model_step(const void *constants, void *state, int64_t tick, slot *v, char *error) {
    const plant_constants *p = constants;
    plant_state *s = state;
    plant_pins pins;
    double rate = v[V_RATE].d, temp = v[V_TEMPERATURE].d;
    if (!pins_of(p, v, &pins, error)) return 0;
    if (tick % p->frame_ticks == 0) {
        if (!(rate - rate == 0.0)) {
            snprintf(error, ERROR_TEXT, "rate: %g rad/s is not finite", rate);
            return 0;
        }
        if (!(temp >= p->temp_from_degc && temp <= p->temp_to_degc)) {
            snprintf(error, ERROR_TEXT, "temperature: %.9g degC is outside %.9g .. %.9g degC, the range of the export", temp,
                     p->temp_from_degc, p->temp_to_degc);
            return 0;
        }
        if (!(v[V_ACCELERATION].d >= -1000.0 && v[V_ACCELERATION].d <= 1000.0)) {
            snprintf(error, ERROR_TEXT, "acceleration: %g g is outside -1000 .. 1000 g", v[V_ACCELERATION].d);
            return 0;
        }
        plant_accelerate(p, s, v[V_ACCELERATION].d);
        plant_retune(p, s, rate, temp);
    }
    int64_t drdy = plant_step(p, s, tick, &pins);
    s->quadrature_code = v[V_QUADRATURE_CODE].i; /* takes effect with the next frame */
    show(s, drdy, v);
    return 1;
}
