"""Speed of plants behind the port beside the own one, in the frame engine: python -m tests.testbench.port.speed

Median of five alternating runs of a second of simulated time, in CPU time of this process.
"""

import statistics
import subprocess
import tempfile
from pathlib import Path

from analog_frontend import top as plant
from testbench.bench import kernels, peers
from tests.testbench.port import test_plant_port as port

RUNS, TICKS = 5, 1_000_000


def gyroscopes(folder):
    """{name: locked Simulation}."""
    own = kernels.gyroscope("frame")
    peers.export(own, kernels.RATE_RAD_S, folder)
    (folder / "own.txt").write_text(str(folder / "state.bin"))
    flags = [*peers.FLAGS, "-std=c++17", "-shared", "-fPIC", f"-I{port.HEADER}", f"-I{peers.SOURCES}"]
    subprocess.run(["g++", *flags, port.HERE / "board_plant.cpp", "-o", folder / "board.so"], check=True)
    (folder / "plant.py").write_text(port.example("python"))
    board = {"scenario.plant": str(folder / "board.so"), "scenario.plant_file": str(folder / "own.txt")}
    same = kernels.gyroscope("frame", locked=False, changes=board)
    clock = same.state.plant.adc.clock
    same.state = own.state._replace(plant=plant.copy(own.state.plant))
    same.state.plant.adc.clock[:] = clock
    c = port.compiled(folder, "resonator", options=["-O3", "-march=native"])
    examples = {
        "example in C": port.started(c, 1_000_000),
        "example in Python": port.started(folder / "plant.py", 1_000_000),
    }
    return {"own": own, "the same in C++": same, **examples}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        sims = gyroscopes(Path(folder))
        spent = {name: [] for name in sims}
        for _ in range(RUNS):
            for name, sim in sims.items():
                spent[name].append(kernels.cpu_s(kernels.advance, sim, TICKS))
        for name, values in spent.items():
            print(
                f"{name:20} {statistics.median(spent['own']) / statistics.median(values):5.2f}  {min(values):.3f} s/s"
            )
