"""A locked gyroscope as files, from which RTL begins: registers of the firmware, plant and chips in C++.

    write_state(sim, rate, folder)   state.bin for `Board::load` of testbench/bench/board.h, state.hex for the registers
    from_state(text)                 Verilog of a board that begins with state.hex

Source  docs/speed.md, docs/host_port.md
"""

import numpy as np

from analog_frontend.parts import adc, noise, sid
from fpga_model import references
from fpga_model.rates import FRAME_TICKS
from testbench import flatten
from testbench.golden.loop import library


def _check_base_plant(sim):
    """The plant in C++ is the base plant, and LOCKED; ValueError for anything else."""
    p, a = sim.params.fpga, sim.params.plant
    wrong = {
        "board = digital_sid": p.digital,
        "quadrature_update_khz = 1000": p.quadrature_fast,
        "a notch": p.control.notch,
        "extra clocks of one path": p.paths,
        "effects": a.effects.any_force or a.effects.any_cv or a.laws.force or a.laws.cv or a.ring.on,
        "DAC bow or glitch": any(d.bow or d.glitch_v_s for d in (a.drive_dac, a.sense_dac)),
        "INL": any(a.adc.inl),
        "a range of temperatures": a.temp_count != 1,
        "a gyroscope that is not locked": not sim.locked,
        "a tick that does not begin a frame": sim.tick % FRAME_TICKS,
    }
    for what, is_present in wrong.items():
        if is_present:
            raise ValueError(f"the plant in C++ does not support: {what}")


def _state_words(sim, rate_rad_s):
    """The words of state.bin, in the order of Board::load."""
    f, s, p, chips = sim.state.fpga, sim.state.plant, sim.params.plant, sim.state.chips
    t = p.tables
    yield from (sim.tick, sim.state.drdy_cycle, references.pins(sim.params.fpga.references, f.references))
    yield from (value for _, value in flatten.leaves(chips))
    for array in (
        s.z,
        s.jet,
        s.column_jet,
        s.pickoff,
        s.volts,
        s.coming_v,
        s.late_area,
        s.caps,
        s.late_tau_s,
        s.adc.sums,
    ):
        yield from np.asarray(array, float).ravel().tolist()
    for array in (s.cycles, s.switch, s.late_count, s.adc.clock):
        yield from array.tolist()
    temp_degc = float(sim.now[1][-1])
    yield from (float(rate_rad_s), float(t.kq_n_per_m_per_v2[0]), float(t.kxy_n_per_m[0]), p.quad_lsb_v)
    yield from (p.drive_dac.lsb_v, p.sense_dac.lsb_v, p.drive_dac.offset_v, p.sense_dac.offset_v)
    yield from p.switch_tau_s.ravel().tolist()
    yield from (p.slope_gain, float(t.driver_s[0]), adc.SENSOR_V_AT_25_DEGC + adc.SENSOR_V_PER_K * (temp_degc - 25.0))
    yield from (p.adc.normal, p.adc.full_steps, *p.adc.offset_v, *p.adc.steps_per_v)
    yield from (*noise.DECAY.tolist(), *noise.GAIN.tolist())
    yield from (int(carry) for carry in p.switch_carry.ravel())
    yield from (int(t.drive_carry[0, s.cycles[0]]), int(t.sense_carry[0, s.cycles[1]]))
    yield from (p.adc.period, p.adc.delay, p.adc.decimation, p.adc.step_code)
    n = p.noise
    sources = (n.force_x, n.force_y, n.cv_x, n.cv_y, n.drive_dac, n.sense_dac, n.edge_jitter)
    for source in (*sources, *p.adc.white, *p.adc.flicker):
        yield from (source.key0, source.key1, source.on, getattr(source, "half", 0), source[2])
    d = p.sid
    taylor = np.moveaxis(d.taylor.reshape(4, sid.TERMS, 4), -1, 0)[: sid.STAGES]
    yield from (d.h_s, d.r, d.e1, d.e2, d.e3, d.s1, d.s2, d.s3, *d.inject.tolist(), *taylor.ravel().tolist())
    yield from (noise.IH4_SCALE, noise.IH12_SCALE)


def hierarchical_name(name):
    """Where a register of the model stands below `gyro_board`: blocks are instances, an index is part of the name."""
    *blocks, last = name.split(".")
    if last.isdigit():
        last = f"{blocks.pop()}_{last}"
    return ".".join(("firmware", *blocks, f"r_{last}"))


def from_state(text, more=()):
    """Verilog of a `gyro_board` that begins with the registers of state.hex; `more` are statements there."""
    loads = [f"    {hierarchical_name(name)} = loaded[{k}];" for k, name in enumerate(library.REGISTERS)]
    state = [f"reg [63:0] loaded [0:{len(loads) - 1}];", "initial begin", '    $readmemh("state.hex", loaded);', *loads]
    return text.replace("\nendmodule", "\n" + "\n".join([*state, *more, "end", "", "endmodule"]))


def write_state(sim, rate_rad_s, folder):
    """Write the present state of a locked `Simulation` to `folder`: state.bin, state.hex."""
    _check_base_plant(sim)
    words = list(_state_words(sim, rate_rad_s))
    raw = b"".join(np.array(w, "<f8" if isinstance(w, float) else "<i8").tobytes() for w in words)
    formats = library.port_formats(sim.design)[: len(library.REGISTERS)]  # without the pins
    registers = zip(flatten.leaves(sim.state.fpga), formats, strict=True)
    state = [f"{int(value) & ((1 << fmt.width) - 1):x}" for (_, value), fmt in registers]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "state.hex").write_text("\n".join(state) + "\n")
    (folder / "state.bin").write_bytes(raw)
