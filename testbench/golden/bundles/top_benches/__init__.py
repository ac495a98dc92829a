"""Benches of the whole firmware: they replay recorded inputs, and check listed rows and a signature of every frame.

    before edge n   clk is low: host events and samples of n; what the ADS1298 did after edge n - 1
    half a clock    registers and pins enter the signature; where at.hex lists n, inputs, registers, pins are compared
    edge n          clk rises

After 3250 clocks the signature is compared with its line of sig.hex. Everything is read from the files of the bundle.
The converter is modelled in the bench because it answers the design: it shifts when SCLK rises and DRDY_N follows CS_N.
Source  docs/golden.md (the whole design), analog_frontend/parts/adc_serial.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.top_benches.cocotb import cocotb_test
from testbench.golden.bundles.top_benches.layout import DEFAULT_FRAMES, parameters
from testbench.golden.bundles.top_benches.verilog import cocotb_top, verilog_bench
from testbench.golden.bundles.top_benches.vhdl import vhdl_bench


def top_bench_texts(block, case, rows, counts, clocks=None):
    """{path: text} of everything above; `clocks` {pin: clocks that it comes later}."""
    stem = block.stem
    return {
        **parameters(block, case, rows, counts),
        **benches.rom_files(block),
        f"tb_{stem}.v": verilog_bench(block, case, counts, clocks),
        f"cocotb_{stem}.v": cocotb_top(block, case, clocks),
        f"tb_{stem}.vhd": vhdl_bench(block, case, counts, clocks),
        f"tb_{stem}_vunit.vhd": benches.vunit_bench(block, case, frames=True),
        f"test_{stem}.py": cocotb_test(block, case),
        "run_vunit.py": benches.vunit_run(block, case, DEFAULT_FRAMES["vunit"]),
        f"{benches.core_name(block, case)}.core": benches.core(
            block, case, ("stim", "exp", "at", "sig", "adc", "host", "sar")
        ),
        "Makefile": benches.makefile(block, case),
        "check.sh": benches.check_script(block, case, DEFAULT_FRAMES),
    }
