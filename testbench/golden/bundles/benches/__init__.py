"""Texts of a bundle that run in other people's tools: parameters, tables, benches, and the script that runs them.

Every bench does the same: reset with quiet inputs for `reset.cycles` edges, then drive row n while the clock is low,
compare just before the rising edge, report per port, and print one line that begins with PASS or FAIL. Module and
entity are `gyro_<block>`, registers ports `r_<name>`, output pins `o_<name>`; parameters are named as in `Params`.
Source  docs/golden.md, docs/conventions.md (rows)
"""

from testbench.golden.bundles.benches.cocotb import cocotb_test, cocotb_top
from testbench.golden.bundles.benches.layout import (  # noqa: F401
    PARTS,
    REPORTED_ROWS,
    RESET_CYCLES,
    half_ps,
    result_port_pairs,
    rom_name,
    slices,
)
from testbench.golden.bundles.benches.makefile import check_script, core, core_name, makefile
from testbench.golden.bundles.benches.params import params_pkg, params_svh, params_vh, rom_files, vhdl_type  # noqa: F401
from testbench.golden.bundles.benches.verilog import dut_instance, span, verilog_bench  # noqa: F401
from testbench.golden.bundles.benches.vhdl import component, vhdl_bench, vhdl_slice  # noqa: F401
from testbench.golden.bundles.benches.vunit import vunit_bench, vunit_run


def bench_texts(block, case, count):
    """{path: text} of everything that runs elsewhere, for a case of `count` rows."""
    stem = block.stem
    return {
        "params.vh": params_vh(block, case, count),
        "params.svh": params_svh(block, case, count),
        "params_pkg.vhd": params_pkg(block, case, count),
        **rom_files(block),
        f"tb_{stem}.v": verilog_bench(block, case),
        f"cocotb_{stem}.v": cocotb_top(block, case),
        f"tb_{stem}.vhd": vhdl_bench(block, case),
        f"tb_{stem}_vunit.vhd": vunit_bench(block, case),
        f"test_{stem}.py": cocotb_test(block, case),
        "run_vunit.py": vunit_run(block, case),
        "Makefile": makefile(block, case),
        "check.sh": check_script(block, case),
        f"{core_name(block, case)}.core": core(block, case),
    }
