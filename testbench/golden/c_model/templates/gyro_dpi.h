/* The model behind the scoreboards of SystemVerilog: one call per clock with all ports of a design, packed. */
#ifndef GYRO_DPI_H
#define GYRO_DPI_H

#include <svdpi.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A block's model, or a null pointer */
void *gyro_dpi_open(const char *block);

/* Give a parameter; 1 if the block has it */
int gyro_dpi_set(void *model, const char *name, long long value);

/* One clock with the values before its edge; the number of ports that differ.
   given, shown, known: inputs; registers and pins; ones where a bit of them is 0 or 1. First port in the highest bits */
int gyro_dpi_clock(void *model, svBit rst, const svBitVecVal *given, const svBitVecVal *shown,
                   const svBitVecVal *known);

/* Clock of the last call, counted from the end of the first reset */
long long gyro_dpi_number(void *model);

/* The k-th port that differs: its name, and values as they are printed */
const char *gyro_dpi_name(void *model, int k);
const char *gyro_dpi_values(void *model, int k);

#ifdef __cplusplus
}
#endif

#endif
