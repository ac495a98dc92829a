/* Every block by its name, with flat ports: registers, parameters, inputs and pins as rows of int64_t.

   Row n of the registers is what they hold before edge n; the order is that of the golden vectors. For speed, use the
   structs of the block's own header: a row and its struct hold the same numbers in the same order. */
#ifndef GYRO_BLOCKS_H
#define GYRO_BLOCKS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* value: of a register at reset; of a parameter where it is not given, if it may be left out */
typedef struct {
    const char *name;
    int width, is_signed, may_be_left_out;
    int64_t value;
} gyro_port;

typedef struct {
    const gyro_port *port;
    size_t count;
} gyro_ports;

typedef struct {
    const char *name;
    gyro_ports params, inputs, registers, pins;
    const int64_t *nominal; /* parameters of the firmware, or of the block's first case */
    void (*step)(const int64_t *params, const int64_t *registers, const int64_t *inputs, int64_t *next);
    void (*show)(const int64_t *params, const int64_t *registers, const int64_t *inputs, int64_t *pins);
} gyro_block;

typedef struct {
    const char *name;
    int64_t value, usual;
} gyro_key;

extern const gyro_block gyro_blocks[];
extern const size_t gyro_block_count;
extern const gyro_key gyro_design[]; /* keys of the design record that this model is of */
extern const size_t gyro_design_count;

/* A block, or a null pointer */
const gyro_block *gyro_block_named(const char *name);

/* Registers of a block at reset */
void gyro_reset(const gyro_block *block, int64_t *registers);

/* Place of a port, or -1 */
int gyro_place(gyro_ports ports, const char *name);

#ifdef __cplusplus
}
#endif

#endif
