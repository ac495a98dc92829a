"""One resonance behind the plant port, compiled by Numba: gyro run --plant plant.py --no-noise."""

import math

import numba
import numpy as np

KEYS = "plant.fx_hz plant.qx"
CLOCKS, FRAME, LATE = 26, 125, 10
H, M_PER_S2_PER_CODE, CODES_PER_M = 1e-6, 2.72e-7 * 10 / 32768 / 2.325e-7, 1.8574e12
W2, C, S, A, X, VX, HELD, SUM, MEAN, LEVEL, CODE = 0, 1, 2, 3, 4, 5, 6, 7, 9, 11, 15  # places of the plant's memory
TICK, TICKS, EDGE_COUNT, DRIVE_CODE, EDGE, DRDY = 0, 1, 5, 6, 262, 5  # words of gyro_pins and gyro_adc
INTEGER, DOUBLE, STATUS = numba.int64, numba.float64, numba.int32
INTEGERS, DOUBLES = numba.types.CPointer(INTEGER), numba.types.CPointer(DOUBLE)


def create(configuration, own):
    """Memory of a plant."""
    key = dict(line.split(" = ", 1) for line in configuration.splitlines())
    w = 2 * math.pi * float(key["plant.fx_hz"])
    a = w / (2 * float(key["plant.qx"]))
    damped = math.sqrt(w * w - a * a)
    p = np.zeros(17)
    p[:4] = w * w, math.exp(-a * H) * math.cos(damped * H), math.exp(-a * H) * math.sin(damped * H) / damped, a
    return p


@numba.cfunc(STATUS(DOUBLES, INTEGER, INTEGER, INTEGER, DOUBLE, INTEGERS))
def reset(p, seed, drive_code, sense_code, temperature_degc, adc):
    for k in range(X, 17):
        p[k] = 0.0
    p[HELD] = drive_code
    p[X] = M_PER_S2_PER_CODE * drive_code / p[W2]
    for k in range(2):
        adc[DRDY + k] = (k + 1) * FRAME * CLOCKS + LATE
    return 0


@numba.cfunc(STATUS(DOUBLES, INTEGERS, DOUBLE, DOUBLE, INTEGERS, DOUBLES))
def step(p, pins, rate_rad_s, temperature_degc, adc, motion):
    edge, now = 0, pins[TICK] + pins[TICKS]
    into = now % FRAME * CLOCKS
    for t in range(pins[TICKS]):
        rest, x, v = M_PER_S2_PER_CODE * p[HELD] / p[W2], p[X], p[VX]
        p[X] = rest + (x - rest) * (p[C] + p[A] * p[S]) + v * p[S]
        p[VX] = v * (p[C] - p[A] * p[S]) - (x - rest) * p[W2] * p[S]
        begin = 0.0
        while begin < 1.0:
            inside = edge < pins[EDGE_COUNT] and pins[EDGE + 2 * edge] < (t + 1) * CLOCKS
            end = (pins[EDGE + 2 * edge] - t * CLOCKS) / CLOCKS if inside else 1.0
            for k in range(2):
                chord = (end - begin) * (x + (p[X] - x) * (begin + end) / 2)
                p[SUM + k] += chord if p[LEVEL + k] else -chord
            if inside:
                pin = pins[EDGE + 2 * edge + 1]
                p[LEVEL + pin] = 1.0 - p[LEVEL + pin]
                edge += 1
            begin = end
        p[HELD] = pins[DRIVE_CODE + t]
    for k in range(2):
        if into == 0:
            p[MEAN + k] += 0.04 * (p[SUM + k] / FRAME - p[MEAN + k])
            p[CODE + k] = math.floor(max(-8388608.0, min(8388607.0, p[MEAN + k] * CODES_PER_M)))
            p[SUM + k] = 0.0
        adc[k] = int(p[CODE + k])
        late = FRAME * CLOCKS if now < FRAME or into > LATE else 0
        adc[DRDY + k] = late + LATE - into + k * FRAME * CLOCKS
    motion[0], motion[1] = p[X], p[VX]
    return 0
