"""C of the firmware with the digital sides of its converters, and what all of it holds at power-on.

Source    docs/fmu.md, docs/c_model.md
"""

from analog_frontend.parts import adc_serial, dac_serial
from fpga_model import registers
from fpga_model import top as fpga
from testbench import flatten
from testbench.engines import chips, engine
from testbench.golden.c_model import export_c as c_model
from testbench.golden.c_model.c_kinds import NUMBER, infer_kind


def _array(name, values):
    text = ", ".join(f"INT64_C({v})" if v >= 0 else f"-INT64_C({-v})" for v in map(int, values))
    return f"static const int64_t {name}[] = {{{text}}};"


def _leaves(record):
    return [value for _, value in flatten.leaves(record)]


def source_texts(params, state, first_writes):
    """{name: text} of `engine.Params` and its `engine.State` at power-on; host writes [(name, raw)], one per tick."""
    parts, chip = params.chips, state.chips

    values = []

    def extend(program, model):
        values.extend(value for _, _, value, _ in model.params)
        kinds = model.kinds["s"], model.pins[0][1].result
        codes = infer_kind((0,) * adc_serial.CHANNELS)
        every = infer_kind(parts), NUMBER, infer_kind(chip), kinds[1], infer_kind((0, 0)), NUMBER, NUMBER, codes
        for kind in every:
            program.declare(kind)
        program.function(engine.chips_after, every)
        program.function(fpga.other_ldacs, (kinds[0],))

    files = c_model.model(params.fpga, extend)
    # a line at rest is high where its name says so
    idle = [1 if name.endswith("_n") else 0 for name in fpga.Inputs._fields]
    writes = []
    for name, raw in first_writes:
        entry = registers.BY_NAME[name]
        writes.append((entry.address, registers.to_bus(int(raw), entry.fmt)))
    start = [
        "/* The firmware of a configuration at power-on. */",
        "#include <stdint.h>",
        _array("start_params", values),
        _array("start_registers", _leaves(state.fpga)),
        _array("start_parts", _leaves(parts)),
        _array("start_chips", _leaves(chip)),
        _array("start_inputs", idle),
        f"enum {{ FIRST_WRITES = {len(writes)}, STATUS = {adc_serial.status_word()} }};",
        f"static const int64_t first_writes[][2] = {{{', '.join(f'{{{a}, INT64_C({d})}}' for a, d in writes)}}};",
        "",
    ]
    return files | {"start.h": "\n".join(start)}


def power_on_codes(config):
    """{name of an input of the plant: code of the DAC at power-on}."""
    roles = chips.parts(chips.dac_chips(config.design))._asdict()
    return {f"{role}_code": dac_serial.reset(part).code for role, part in roles.items()}
