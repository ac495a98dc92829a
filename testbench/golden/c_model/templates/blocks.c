#include <string.h>

#include "blocks.h"

const gyro_block *gyro_block_named(const char *name) {
    for (size_t k = 0; k < gyro_block_count; k++)
        if (strcmp(gyro_blocks[k].name, name) == 0) return &gyro_blocks[k];
    return NULL;
}

void gyro_reset(const gyro_block *block, int64_t *registers) {
    for (size_t k = 0; k < block->registers.count; k++) registers[k] = block->registers.port[k].value;
}

int gyro_place(gyro_ports ports, const char *name) {
    for (size_t k = 0; k < ports.count; k++)
        if (strcmp(ports.port[k].name, name) == 0) return (int)k;
    return -1;
}
