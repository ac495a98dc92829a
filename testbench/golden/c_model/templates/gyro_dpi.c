#include "gyro_dpi.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blocks.h"

enum { MOST_PORTS = 1024, SHOWN = 10 };

typedef struct {
    const gyro_block *block;
    int64_t params[MOST_PORTS], state[MOST_PORTS], next[MOST_PORTS], inputs[MOST_PORTS], pins[MOST_PORTS];
    long long number;
    int started, running;
    char name[SHOWN][128], values[SHOWN][96];
} model;

void *gyro_dpi_open(const char *block) {
    const gyro_block *found = gyro_block_named(block);
    model *m = found ? calloc(1, sizeof *m) : NULL;
    if (m) {
        m->block = found;
        m->number = -1;
        if (found->nominal) memcpy(m->params, found->nominal, found->params.count * sizeof m->params[0]);
    }
    return m;
}

int gyro_dpi_set(void *opened, const char *name, long long value) {
    model *m = opened;
    int place = gyro_place(m->block->params, name);
    if (place >= 0) m->params[place] = value;
    return place >= 0;
}

/* Bits low .. low + width - 1 */
static uint64_t bits(const svBitVecVal *packed, int low, int width) {
    uint64_t value = packed[low / 32] >> low % 32;
    for (int have = 32 - low % 32, word = low / 32 + 1; have < width; have += 32, word++)
        value |= (uint64_t)packed[word] << have;
    return value & ((UINT64_C(1) << width) - 1);
}

static int width_of(gyro_ports ports) {
    int sum = 0;
    for (size_t k = 0; k < ports.count; k++) sum += ports.port[k].width;
    return sum;
}

static void take(const svBitVecVal *packed, gyro_ports ports, int64_t *row) {
    int low = width_of(ports);
    for (size_t k = 0; k < ports.count; k++) {
        int width = ports.port[k].width;
        low -= width;
        int64_t value = (int64_t)bits(packed, low, width), half = INT64_C(1) << (width - 1);
        row[k] = ports.port[k].is_signed && value >= half ? value - half - half : value;
    }
}

static void note(model *m, int found, char mark, const gyro_port *port, uint64_t want, uint64_t got, int is_known) {
    if (found >= SHOWN) return;
    snprintf(m->name[found], sizeof m->name[found], "%c_%s", mark, port->name);
    if (is_known)
        snprintf(m->values[found], sizeof m->values[found], "expected %" PRIx64 ", got %" PRIx64 " (hex)", want, got);
    else
        snprintf(m->values[found], sizeof m->values[found], "expected %" PRIx64 " (hex), got unknown bits", want);
}

/* Ports of a row that differ, from the highest bits below *low on */
static int differ(model *m, int found, char mark, gyro_ports ports, const int64_t *want, int *low,
                  const svBitVecVal *shown, const svBitVecVal *known) {
    for (size_t k = 0; k < ports.count; k++) {
        const gyro_port *port = &ports.port[k];
        *low -= port->width;
        uint64_t all = (UINT64_C(1) << port->width) - 1, wanted = (uint64_t)want[k] & all;
        uint64_t got = bits(shown, *low, port->width);
        int is_known = bits(known, *low, port->width) == all;
        if (got != wanted || !is_known) note(m, found++, mark, port, wanted, got, is_known);
    }
    return found;
}

int gyro_dpi_clock(void *opened, svBit rst, const svBitVecVal *given, const svBitVecVal *shown,
                   const svBitVecVal *known) {
    model *m = opened;
    const gyro_block *b = m->block;
    int found = 0, low = width_of(b->registers) + width_of(b->pins);
    m->running |= m->started && !rst;
    m->number += m->running;
    take(given, b->inputs, m->inputs);
    if (m->running) {
        b->show(m->params, m->state, m->inputs, m->pins);
        found = differ(m, found, 'r', b->registers, m->state, &low, shown, known);
        found = differ(m, found, 'o', b->pins, m->pins, &low, shown, known);
    }
    if (rst) {
        gyro_reset(b, m->state);
        m->started = 1;
    } else if (m->started) {
        b->step(m->params, m->state, m->inputs, m->next);
        memcpy(m->state, m->next, sizeof m->state);
    }
    return found;
}

long long gyro_dpi_number(void *opened) { return ((model *)opened)->number; }

const char *gyro_dpi_name(void *opened, int k) { return ((model *)opened)->name[k < SHOWN ? k : SHOWN - 1]; }

const char *gyro_dpi_values(void *opened, int k) { return ((model *)opened)->values[k < SHOWN ? k : SHOWN - 1]; }
