"""One compiled runner per block: stimulus rows in, all registers before each edge and the pins out.

    run_BLOCK(p, s, stim, regs, pins)  row n: regs[n], pins[n] before edge n; then the edge, or reset if stim[n, 0] = 1

Twenty-two small functions and not one made by a factory: Numba's disk cache keeps no function that closes over another
compiled one, so each export would compile all of them again.
Source  docs/golden.md
"""

from fpga_model import (
    agc,
    cordic,
    dds,
    delay,
    digital_sid,
    fault_monitor,
    frequency_tracker,
    isqrt,
    lock_monitor,
    modulator,
    pi,
    quadrature_loop,
    rate_loop,
    rate_output,
    rates,
    references,
    registers,
    sequencer,
    sine,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.flatten import store


@kernel
def run_dds(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else dds.step(p, s, r[1], r[2], r[3], r[4], r[5])


@kernel
def run_sine(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else sine.step(p, sine.ROM, s, r[1])


@kernel
def run_delay(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = delay.out(p, s, r[1])
        s = reset if r[0] == 1 else delay.step(p, s, r[1])


@kernel
def run_references(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = references.pins(p, s)
        s = reset if r[0] == 1 else references.step(DEFAULT, p, s, r[1], r[2], r[3])


@kernel
def run_modulator(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = modulator.out(p, s)
        s = reset if r[0] == 1 else modulator.step(p, s, r[1], r[2], r[3], r[4])


@kernel
def run_pi(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else pi.step(p, s, r[1], r[2], r[3], r[4])


@kernel
def run_spi_dac(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = spi_dac.sdin(p, s)
        s = reset if r[0] == 1 else spi_dac.step(p, s, r[1], r[2])


@kernel
def run_spi_adc(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else spi_adc.step(s, r[1], r[2])


@kernel
def run_digital_sid(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else digital_sid.step(p, s, r[1], r[2], r[3], r[4], r[5])


@kernel
def run_cordic(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else cordic.step(s, r[1], r[2], r[3])


@kernel
def run_isqrt(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else isqrt.step(s, r[1], r[2])


@kernel
def run_agc(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = agc.amplitude(p, s, r[3])
        pins[n, 1] = agc.saturated(p, s)
        s = reset if r[0] == 1 else agc.step(p, s, r[1], r[2], r[3], r[4], r[5], r[6])


@kernel
def run_frequency_tracker(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        if r[0] == 1:
            s = reset
        else:
            s = frequency_tracker.step(DEFAULT, p, s, r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8])


@kernel
def run_rate_loop(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = rate_loop.saturated(p, s)
        s = reset if r[0] == 1 else rate_loop.step(p, s, r[1], r[2], r[3], r[4], r[5])


@kernel
def run_quadrature_loop(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = quadrature_loop.railed(p, s)
        s = reset if r[0] == 1 else quadrature_loop.step(p, s, r[1], r[2], r[3], r[4], r[5], r[6])


@kernel
def run_lock_monitor(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        if r[0] == 1:
            s = reset
        else:
            s = lock_monitor.step(p, s, r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9])


@kernel
def run_fault_monitor(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        if r[0] == 1:
            s = reset
        else:
            codes = (r[4], r[5], r[6], r[7])
            s = fault_monitor.step(p, s, r[1], r[2], r[3], codes, r[8], r[9], r[10], r[11], r[12], r[13])


@kernel
def run_sequencer(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        store(pins[n], sequencer.outputs(s))
        if r[0] == 1:
            s = reset
        else:
            i = sequencer.Inputs(
                r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15]
            )
            s = sequencer.step(p, s, r[1], i)


@kernel
def run_rate_output(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        if r[0] == 1:
            s = reset
        else:
            held = rate_output.Params(r[1], r[2], r[3], r[4], r[5], r[6], r[7])
            s = rate_output.step(held, s, r[8], r[9], r[10])


@kernel
def run_registers(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else registers.step(p, s, r[1], r[2], r[3], r[4])


@kernel
def run_watchdog(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        s = reset if r[0] == 1 else watchdog.step(p, s, r[1], r[2])


@kernel
def run_rates(p, s, stim, regs, pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        store(regs[n], s)
        pins[n, 0] = rates.ce_1m(s)
        pins[n, 1] = rates.ce_8k(s)
        s = reset if r[0] == 1 else rates.step(p, s, r[1])
