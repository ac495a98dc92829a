"""Where the frame engine's time goes: each stage of a block alone, on a locked gyroscope, in ns per tick.

A block of one frame, the stages as `plant.advance_ticks` and `frame.run_blocks` call them, each again and again on the
same data. They add up to less than the engine, which also hashes and records, and finds less of its data in the first
cache.
"""

import statistics

from analog_frontend import linear, sid_edges
from analog_frontend import top as plant
from analog_frontend.parts import adc, noise
from fpga_model.jit import hot
from fpga_model.rates import FRAME_TICKS
from testbench.bench import kernels
from testbench.engines import pins, window
from testbench.engines.turn import Turn

STAGES = (
    ("noise, eight sources", "noise"),
    ("output chains", "chains"),
    ("modes", "modes"),
    ("C/V and paths", "pickoffs"),
    ("demodulators, no edge", "demodulators"),
    ("demodulators and reference edges", "edges"),
    ("converter", "converter"),
    ("matrix, new rate and V_q", "matrix"),
    ("DAC codes", "codes"),
    ("clocks of the reference edges", "turns"),
    ("8 kHz window", "window"),
)
NOISE, CHAINS, MODES, PICKOFFS, NO_EDGE, EDGES, CONVERTER, MATRIX, CODES, TURNS, WINDOW = range(len(STAGES))
WINDOW_CLOCK = 400  # a valid ADC frame in the middle of a tick
WINDOW_TICKS = 20


@hot
def repeat(p, a, sid, control, bank, dog, turn, b, stage, frames, rate_rad_s, quad_code, temp_degc, edges, edge_count):
    """`frames` times one stage over a frame; returns something that depends on all of it."""
    w, n, total = a.work.w, FRAME_TICKS, 0.0
    for k in range(frames):
        tick = k * n
        if stage == NOISE:
            x, y = linear.FEED * linear.STRIDE, (linear.FEED + 1) * linear.STRIDE
            for _ in range(3):
                noise.fill_hold_rows(p.plant.noise.force_x, p.plant.noise.force_y, tick, w, x, y, n)
            noise.fill_rows(p.plant.noise.edge_jitter, p.plant.noise.edge_jitter, tick, 1, w, x, y, linear.BLOCK)
        elif stage == CHAINS:
            linear.chains(a.g, w, n)
        elif stage == MODES:
            linear.modes(a.g, w, n, p.plant.effects, p.plant.laws, a.work.gains)
        elif stage == PICKOFFS:
            linear.pickoffs(a.g, a.pickoff, w, n, 0)
        elif stage == NO_EDGE:
            sid_edges.demodulate(p.plant, a, tick, n, 0, edges, a.now[plant.NOW_DRIVER], temp_degc)
        elif stage == EDGES:
            sid_edges.demodulate(p.plant, a, tick, n, edge_count, edges, a.now[plant.NOW_DRIVER], temp_degc)
        elif stage == CONVERTER:
            total += adc.convert_block(p.plant.adc, a.adc.clock, a.adc.sums, a.work.demodulated, n, 0.1)
        elif stage == MATRIX:
            plant.retune(p.plant, a, rate_rad_s, quad_code + (k & 1), temp_degc)
        elif stage == CODES:
            pins.dac_codes(p.fpga, p.rom, bank, turn, 0, n, b)
        elif stage == TURNS:
            total += pins.reference_edges(p.fpga.design, p.fpga.references, turn, bank, 0, n, 0, b)[0]
        else:
            s = window.Window(control, bank, dog, turn, 0, quad_code)
            zeros = (0, 0, 0, 0, 0, 0, 0, 0)
            s, ticks = window.advance_window(
                p.fpga,
                s,
                sid,
                zeros,
                zeros,
                -window.valid_clocks(p.fpga.design),
                1,
                1,
                WINDOW_CLOCK,
                15,
                WINDOW_TICKS,
                b,
            )
            total += ticks + s.control.agc.loop.y
    return total


def measure(repeats=7, frames=400):
    """{stage: ns per tick}, median of rounds in which all take turns, and the engine itself."""
    sim = kernels.gyroscope("frame")
    kernels.advance(sim, kernels.BLOCK_TICKS)
    f = sim.state.fpga
    a = plant.copy(sim.state.plant)
    b = pins.buffers()
    b.amplitude[:], b.rate[:] = f.control.agc.loop.y, f.control.rate_loop.loop.y
    word = f.control.frequency_tracker.word
    turn = Turn(0, f.dds.phase, word, word, 0, word, sim.design.dds_bits)
    count, _ = _frame_reference_edges(sim.params, turn, f.registers, b)
    quad_code = f.control.quadrature_loop.root.y
    kernels.advance(sim, FRAME_TICKS)
    a.work.w[:] = sim.state.plant.work.w

    def one(stage):
        return repeat(
            sim.params,
            a,
            f.sid,
            f.control,
            f.registers,
            f.watchdog,
            turn,
            b,
            stage,
            frames,
            kernels.RATE_RAD_S,
            quad_code,
            kernels.TEMP_DEGC,
            b.edges,
            count,
        )

    works = {name: (one, k) for k, (_, name) in enumerate(STAGES)}
    for work, k in works.values():
        work(k)
    spent = {name: [] for name in (*works, "engine")}
    for _ in range(repeats):
        for name, (work, k) in works.items():
            work(k)  # not timed: the stage before has left other code and data in the caches
            spent[name].append(kernels.cpu_s(work, k) / (frames * FRAME_TICKS))
        spent["engine"].append(kernels.cpu_s(kernels.advance, sim, kernels.BLOCK_TICKS) / kernels.BLOCK_TICKS)
    return {name: statistics.median(times) * 1e9 for name, times in spent.items()}


@hot
def _frame_reference_edges(p, turn, bank, b):
    return pins.reference_edges(p.fpga.design, p.fpga.references, turn, bank, 0, FRAME_TICKS, 0, b)
