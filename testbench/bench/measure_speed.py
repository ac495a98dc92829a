"""Speed: simulated seconds per CPU second of both engines, of what they are made of, and of comparators.

All but the first call is process CPU time on one core, after warm-up: the median of rounds in which all take turns, so
that a slow moment of the machine meets all of them. The engines run in several processes, because the clocked
engine's speed differs from process to process. Before a comparator is timed, its codes, registers and plant must be
those of the clocked engine. A tool that is not there leaves its key null and its reason in the table.

    python -m testbench.bench       prints the tables, writes build/bench.json and the tables in docs/speed.md
"""

import contextlib
import itertools
import json
import statistics
import tempfile
from functools import partial

from analog_frontend.parts.noise import HOLD
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench.bench import engine_stages, kernels, machine, many, peers
from testbench.console.markdown import ROOT, need_repository
from testbench.console.results import write_results
from testbench.console.text_table import Table, to_decimals
from testbench.storage.files import write_text

COMMAND = "python -m testbench.bench"
REPEATS = 10
PROCESSES = 5
FRAME_TICKS_TIMED = 1_000_000
BASEBAND_TICKS_TIMED = 10_000_000
PEER_TICKS = {"verilator": 100_000, "icarus": 1_250}
PEER_KEYS = {"verilator": "verilator_closed_rt", "icarus": "icarus_rt"}
PYTHON_TICKS = 2 * FRAME_TICKS

SPEEDS = (
    ("frame_rt", "frame engine"),
    ("baseband_rt", "baseband engine, averaged plant"),
    ("baseband_codes_rt", "the same with the codes of every frame, hashed"),
    ("lanes_rt_per_core", "lanes engine, eight gyroscopes"),
    ("lanes_codes_rt", "the same with the codes of every tick, hashed"),
    ("clocked_rt", "clocked engine"),
    ("verilator_closed_rt", "Verilator"),
    ("icarus_rt", "Icarus Verilog"),
    ("python_rt", "plain Python"),
    ("roof_single_rt", "roof"),
    ("roof_lanes_rt", "roof, eight gyroscopes"),
    ("firmware_rt", "firmware alone"),
    ("plant_rt", "plant alone"),
)
PARTS = ("firmware_rt", "plant_rt")
FIRST_CALLS = (
    ("first_call_cold_s", "first call, nothing compiled"),
    ("first_call_warm_s", "first call, from the cache"),
)

GROWTH_REPEATS = 3
GROWTH_SECONDS = (1, 4, 16)
GROWTH_TICKS = 500_000
GROWTH_LANES = (1, 4, 8, 16)
LANES = 8
LANES_TICKS = 1_000_000
SOURCES = ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")
# one per kernel: the catalogue's others are laws as well
EFFECTS = {
    "duffing_k3_per_um2": 1e-7,
    "drive_cubic_per_v2": 1e-3,
    "feedthrough_y": 1e-5,
    "laws": ["force_x = -1e6 x^3"],
    "drive_dac_levels": ["bit 7 = 0.1"],
    "sense_dac_levels": ["bit 7 = 0.1"],
    "adc_curve": [1e-6],
    "adc_turnover": 1e-6,
    "adc_gain_tc_per_k": 1e-6,
    "adc_memory": 1e-6,
}


# ---- roof ------------------------------------------------------------------------------------------------------------


def pairs_per_tick():
    """Multiplications of one plant tick, each with an addition, as frozen in analog_frontend/linear.py.

    chains   2 of three states: 3 inputs each, and the triangle of 1 + 2 + 3              30
    forced   14 inputs onto 4 modes                                                       56
    modes    4 x 4                                                                        16
    C/V      2 channels: 4 numbers onto 3 states and 3 places of the path, a triangle, 9  78
    SID      4 demodulators: noise on 3 stages, a triangle                                36
    ADC      64 samples in 125 ticks, 5 channels: chord, three weights                    10.24
    noise    1 hash of 7 rounds, 3 for 5 ticks, two numbers of each scaled twice          17.6

    Left out: firmware and chips, reference edges, the shifts and masks of the hashes, 8 kHz work, all loads and stores,
    and that a tick must wait for the one before it. No engine can be faster than this roof on one core.
    """
    triangle = 1 + 2 + 3
    chains = 2 * (3 * 3 + triangle)
    forced = 14 * 4
    modes = 4 * 4
    pickoffs = 2 * (4 * 6 + triangle + 3 * 3)
    sid = 4 * (3 + triangle)
    adc = 64 / 125 * 5 * 4
    noise = (1 + 3 / HOLD) * (7 + 2 * 2)
    return chains + forced + modes + pickoffs + sid + adc + noise


def lane_pairs_per_tick():
    """The same of one of eight gyroscopes in lanes: the noise on 3 stages serves both demodulators of a channel.

    The peak is the same: one gyroscope fills the registers with eight ticks, or with eight states, as eight fill them.
    """
    return pairs_per_tick() - 2 * 3


# ---- measuring -------------------------------------------------------------------------------------------------------


def rounds(works, repeats):
    """CPU times (s) of each of `works` ({name: function that returns its own CPU time}), which take turns."""
    spent = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            spent[name].append(work())
    return spent


def _in_turn(processes, engine_name, ticks):
    """CPU time (s) of `ticks` on an engine, in the next process."""
    return next(processes).cpu_s(engine_name, ticks)


def comparators(sim, folder):
    """({key: function that returns the CPU time of a run}, {key: why there is none}); equality is checked here."""
    peers.export(sim, kernels.RATE_RAD_S, folder)
    engine = peers.reference(sim, kernels.RATE_RAD_S, max(PEER_TICKS.values()))
    works, missing = {}, {}
    for name, ticks in PEER_TICKS.items():
        try:
            command = peers.BUILDERS[name](folder)
            codes = peers.run(name, command, folder, ticks)
        except peers.Missing as reason:
            missing[PEER_KEYS[name]] = str(reason)
            continue
        for line in peers.differences(engine, codes):
            raise RuntimeError(f"{name} differs from the clocked engine: {line}")
        works[PEER_KEYS[name]] = partial(_peer_cpu_s, name, command, folder, ticks)
    return works, missing


ROOFS = {"roof_single_rt": pairs_per_tick, "roof_lanes_rt": lane_pairs_per_tick}


def _roof_s(pairs, command):
    return pairs / peers.peak_pairs_per_s(command)


def _peer_cpu_s(*arguments):
    return peers.run(*arguments).cpu_s


def speeds(folder, repeats=REPEATS, processes=PROCESSES):
    """Real-time factors of everything that simulates, their spread, the peak of the CPU, and what is missing."""
    bench, side, hashed = kernels.Bench(), kernels.SideBySide(LANES, codes=False), kernels.SideBySide(LANES)
    averaged, averaged_hashed = kernels.gyroscope("baseband", codes=False), kernels.gyroscope("baseband")
    works, missing = comparators(kernels.gyroscope("clocked"), folder)
    ticks = {key: PEER_TICKS[name] for name, key in PEER_KEYS.items()}
    ticks |= dict.fromkeys(("clocked_rt", *PARTS), bench.ticks)
    ticks |= {"frame_rt": FRAME_TICKS_TIMED, "python_rt": PYTHON_TICKS, "lanes_rt_per_core": LANES * LANES_TICKS}
    ticks |= dict.fromkeys(("baseband_rt", "baseband_codes_rt"), BASEBAND_TICKS_TIMED)
    ticks |= {"lanes_codes_rt": LANES * LANES_TICKS}
    try:
        command = peers.build_peak(folder)
        for key, pairs in ROOFS.items():  # as the time of what a tick has to multiply and add
            works[key] = partial(_roof_s, pairs(), command)
            ticks[key] = 1
    except peers.Missing as reason:
        missing |= dict.fromkeys(ROOFS, str(reason))
    with contextlib.ExitStack() as stack:

        def start_engine_process(**options):
            return stack.enter_context(contextlib.closing(kernels.Served(**options)))

        engines = [start_engine_process() for _ in range(processes)]
        interpreted = start_engine_process(locked=False, NUMBA_DISABLE_JIT="1")
        for name in ("frame", "clocked"):
            works[f"{name}_rt"] = partial(_in_turn, itertools.cycle(engines), name, ticks[f"{name}_rt"])
        works |= {
            "baseband_rt": partial(kernels.cpu_s, kernels.advance, averaged, BASEBAND_TICKS_TIMED),
            "baseband_codes_rt": partial(kernels.cpu_s, kernels.advance, averaged_hashed, BASEBAND_TICKS_TIMED),
            "lanes_rt_per_core": partial(kernels.cpu_s, side.advance, LANES_TICKS),
            "lanes_codes_rt": partial(kernels.cpu_s, hashed.advance, LANES_TICKS),
            "firmware_rt": partial(kernels.cpu_s, bench.firmware),
            "plant_rt": partial(kernels.cpu_s, bench.plant_only),
            "python_rt": partial(interpreted.cpu_s, "clocked", PYTHON_TICKS),
        }
        rounds(works, processes)
        spent = rounds(works, repeats)
    factors = {key: sorted(ticks[key] / TICK_HZ / time_s for time_s in spent[key]) for key in works}
    result = {key: statistics.median(factors[key]) if key in factors else None for key, _ in SPEEDS}
    roof = result["roof_single_rt"]
    return result | {
        "spread": {key: [values[0], values[-1]] for key, values in factors.items()},
        "peak_pairs_per_s": None if roof is None else roof * pairs_per_tick() * TICK_HZ,
        "pairs_per_tick": pairs_per_tick(),
        "missing": missing,
    }


def growth(repeats=GROWTH_REPEATS):
    """CPU seconds per simulated second of a gyroscope: over seconds, noise sources, effects, and lanes beside it."""
    quiet = {f"noise.{name}": False for name in SOURCES}
    cases = {("seconds", str(n)): ({}, n * TICK_HZ) for n in GROWTH_SECONDS}
    cases |= {("noise", "none"): (quiet, GROWTH_TICKS)}
    cases |= {("noise", name): (quiet | {f"noise.{name}": True}, GROWTH_TICKS) for name in SOURCES}
    cases |= {("noise", "all"): ({}, GROWTH_TICKS), ("effects", "none"): ({}, GROWTH_TICKS)}
    cases |= {("effects", name): ({f"effects.{name}": size}, GROWTH_TICKS) for name, size in EFFECTS.items()}
    cases |= {("effects", "all"): ({f"effects.{name}": size for name, size in EFFECTS.items()}, GROWTH_TICKS)}
    sim_by_changes, works = {}, {}
    for case, (changes, ticks) in cases.items():
        key = json.dumps(changes)
        if key not in sim_by_changes:
            sim_by_changes[key] = kernels.gyroscope("frame", changes=changes)
        works[case] = partial(kernels.cpu_s, kernels.advance, sim_by_changes[key], ticks)
    for count in GROWTH_LANES:
        cases["lanes", str(count)] = ({}, count * LANES_TICKS)
        works["lanes", str(count)] = partial(kernels.cpu_s, kernels.SideBySide(count, codes=False).advance, LANES_TICKS)
    result = {}
    for (kind, name), spent in rounds(works, repeats).items():
        result.setdefault(kind, {})[name] = statistics.median(spent) / (cases[kind, name][1] / TICK_HZ)
    return result


def measure():
    """The whole measurement."""
    with tempfile.TemporaryDirectory() as folder:
        first = {key: kernels.first_call_s(folder) for key, _ in FIRST_CALLS}
    result = speeds(ROOT / "build" / "bench")
    result |= first | {
        "growth": growth(),
        "stages_ns": engine_stages.measure(),
        "versions": machine.versions() | peers.versions(),
        "cpu": machine.cpu(),
    }
    return result | {"cores": many.cores(), "memory_bytes_per_lane": many.memory(), "run_cpu_s": many.run()}


# ---- showing ---------------------------------------------------------------------------------------------------------


def table(result):
    """Speeds as a table; how often the engines go into each of the others."""
    rows = []
    for key, text in SPEEDS:
        rt = result[key]
        if rt is None:
            rows.append((f"{text} ({result['missing'][key]})", key, *["-"] * 5))
            continue
        ratios = ["" if key in PARTS else f"{result[name] / rt:.3g}" for name in ("frame_rt", "clocked_rt")]
        spread = " .. ".join(f"{value:.3g}" for value in result["spread"][key])
        rows.append((text, key, f"{rt:.3g}", spread, f"{1 / rt:.3g} s", *ratios))
    rows += [(text, key, "", "", to_decimals(result[key], 1) + " s", "", "") for key, text in FIRST_CALLS]
    heads = (
        "what",
        "key",
        "simulated s / CPU s",
        "least .. most",
        "CPU s / simulated s",
        "frame / this",
        "clocked / this",
    )
    version_text = ", ".join(f"{name} {version}" for name, version in result["versions"].items() if version)
    return Table("Speed, one core", heads, rows, f"{result['cpu']}; {version_text}", (2, 3, 4, 5, 6))


def growth_table(result):
    """Cost of the frame engine over what is simulated, and of the lanes engine over its lanes."""
    rows = []
    for kind, cases in result["growth"].items():
        base = next(iter(cases.values()))
        rows += [(kind, name, f"{1e3 * value:.3g} ms", f"{value / base:.2f}") for name, value in cases.items()]
    heads = ("what varies", "case", "CPU time per simulated second", "relative to the first")
    return Table("Growth, frame engine", heads, rows, "", (2, 3))


def stage_table(result):
    """Where the frame engine's time goes."""
    spent = result["stages_ns"]
    texts = (*engine_stages.STAGES, ("the engine: all of it, records and hash", "engine"))
    rows = [(text, f"{spent[name]:.1f} ns", f"{100 * spent[name] / spent['engine']:.0f} %") for text, name in texts]
    return Table("Stages of the frame engine", ("stage", "CPU time per tick", "of the engine"), rows, "", (1, 2))


def result_tables(result):
    """What docs/results/speed.json holds."""
    speed_table = table(result)
    roof = "The roof was not measured."
    if result["peak_pairs_per_s"] is not None:
        roof = (
            f"Roof: {result['pairs_per_tick']:.0f} multiplications with an addition each per tick, and "
            f"{result['peak_pairs_per_s'] / 1e9:.1f}e9 such pairs per second measured."
        )
    growth = "How the cost of the frame engine grows, and that of one of several lanes"
    return [
        speed_table._replace(title="", note=f"Measured on {speed_table.note}.\n\n{roof}"),
        stage_table(result)._replace(title="Where the frame engine's time goes, each stage alone"),
        growth_table(result)._replace(title=growth),
        many.cores_table(result)._replace(title="What more cores bring", note=many.sentences(result)),
    ]


def main():
    """Measure, print, write."""
    from testbench.console.show import print_tables

    need_repository()
    result = measure()
    print_tables([table(result), stage_table(result), growth_table(result), many.cores_table(result)])
    (ROOT / "build").mkdir(exist_ok=True)
    write_text(ROOT / "build" / "bench.json", json.dumps(result, indent=1) + "\n")
    write_results("speed", COMMAND, result_tables(result))
    print("written: build/bench.json, docs/results/speed.json")
    return 0
