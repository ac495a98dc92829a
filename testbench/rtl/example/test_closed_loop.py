"""The gyroscope around your gyro_top, from cocotb on Icarus: an example to copy.

    RTL=FOLDER TICKS=40 python3 test_closed_loop.py

FOLDER holds top.v and its parts; ticks are microseconds. The plant hears the design's pins alone; before every edge all
registers and pins of the design are compared with the model's, which gets the same inputs.
"""

import os
import sys
import tempfile
from pathlib import Path

try:
    import cocotb
    from cocotb.triggers import Timer
except ImportError:
    sys.exit("cocotb is not installed: pip install cocotb")

HALF_PS = 19231  # half a period of 26 MHz
TICKS = int(os.environ.get("TICKS") or 40)


@cocotb.test()
async def compare_closed_loop(dut):
    from fpga_model.top import Pins
    from testbench.config import Config
    from testbench.golden.loop.by_edge import Model, Plant

    plant = Plant(Config())
    model = Model(plant)
    design = dut.firmware  # gyro_top inside the board's pins

    async def clock():
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
        await Timer(HALF_PS, "ps")

    def drive(values):
        for name, value in values.items():
            getattr(dut, name).value = value

    dut.clk.value = 0
    dut.rst.value = 1
    drive(plant.inputs())
    await Timer(HALF_PS, "ps")
    for _ in range(2):
        await clock()
    dut.rst.value = 0
    expected = model.expected()
    handles = {port: getattr(design, port) for port in expected}
    for _ in range(TICKS * 26):
        expected = model.expected()
        wrong = [port for port, handle in handles.items() if handle.value.binstr != binary(expected[port], handle)]
        if wrong:
            port, handle = wrong[0], handles[wrong[0]]
            location = f"tick {plant.tick}, clock {plant.clock % 26}: {port}"
            mismatch = f"expected {binary(expected[port], handle)}, got {handle.value.binstr} (binary)"
            print(f"FAIL {location}: {mismatch}; {len(wrong) - 1} more differ", flush=True)
        assert not wrong
        inputs = plant.inputs()
        drive(inputs)
        await clock()
        model.edge(inputs)
        plant.edge({name: int(getattr(dut, f"o_{name}").value) for name in Pins._fields})
    print(f"PASS {plant.clock} edges, {len(handles)} registers and pins at each", flush=True)


def binary(value, handle):
    return f"{value:0{len(handle)}b}"


def main():
    try:
        from cocotb_tools.runner import get_runner
    except ImportError:  # cocotb 1
        from cocotb.runner import get_runner

    from testbench.config import Config
    from testbench.golden.loop.library import sources
    from testbench.golden.recording import board_recording
    from testbench.run import build

    with tempfile.TemporaryDirectory(prefix="gyro-example-") as folder:
        folder = Path(folder)
        top = board_recording.write(folder, build.firmware(Config()))
        runner = get_runner("icarus")
        runner.build(
            sources=[*sources(os.environ["RTL"]), top],
            hdl_toplevel=board_recording.MODULE,
            build_dir=folder,
            always=True,
        )
        os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), *sys.path])
        results_path = runner.test(
            hdl_toplevel=board_recording.MODULE, test_module=Path(__file__).stem, build_dir=folder, test_dir=folder,
            results_xml=str(folder / "results.xml"), extra_env={"COCOTB_REWRITE_ASSERTION_FILES": ""},
        )  # fmt: skip
        text = Path(results_path).read_text()
    sys.exit(1 if "<failure" in text or "<error" in text or "<testcase" not in text else 0)


if __name__ == "__main__":
    main()
