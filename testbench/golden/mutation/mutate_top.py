"""Mutation score of the wiring: faults in `top.v` alone, its blocks left as they are, against the bundles of `top`.

    choose               `mutate -list` on the cells of gyro_top: multiplexers, gates, and the ports of the blocks
    run                  the clocks of each recording, 64 at a time, in the states and with the inputs that the model
                         had there: a clock kills a fault if a pin, or a register after it, is not the sound one's
    judge the survivors  `judge` on the whole design, blocks and all, with the parameters of each recording:
                         equivalent if proved so in every case

A bundle compares rows and a signature of all clocks, so a difference in any clock is one that it sees. The sound design
itself is compared with the model in every clock of every recording: if it differs, there is no score.
Source  docs/golden.md, docs/rtl.md; yosys manual, `mutate`
"""

import re
import shutil
import tempfile
from pathlib import Path

import numpy as np

from fpga_model import top
from fpga_model.jit import kernel
from fpga_model.rates import FRAME_CYCLES
from testbench.errors import ConfigError, FileError
from testbench.golden.coverage import unreachable
from testbench.golden.loop import library
from testbench.golden.mutation import mutant_judge
from testbench.golden.mutation.mutate import SEED, SELECT, TOOLS, Outcome, choose, insert_faults
from testbench.golden.recording import board_recording, recording, replay_recording
from testbench.golden.stimulus.blocks import RESET_INPUT
from testbench.tool import run_tool

COUNT = 150
CASES = ("reset", "registers", "story_digital", "story")
TOP = "mutable"
ROM = r'\b(SINE_ROM_FILE|CORDIC_ROM_FILE)(\s*)= ""'
FLAT = f"hierarchy -top {TOP}; flatten; opt_clean; memory -nomap -nordff; opt_clean; "
CHUNK = 40  # frames that are held at a time
WORD = 64
LOOPS = ("agc", "frequency_tracker", "rate_loop", "quadrature_loop")


def _prepare(params, rtl, work):
    """base.il: gyro_top as `mutable`, its blocks as modules of their own."""
    files = library.sources(rtl)
    roms = board_recording.write_roms(work)
    for path in files:
        # this front end takes no text as a parameter from outside
        source_text = re.sub(ROM, lambda found: f'{found[1]}{found[2]}= "{roms[found[1]]}"', path.read_text())
        (work / path.name).write_text(source_text)
    text = (work / "top.v").read_text()
    for name, width, raw in board_recording.top_parameters(params):
        # a text of its own: the design's own default takes the place of parameters from outside
        kind = "sh" if re.search(rf"parameter\s+signed\s[^=\n]*\b{name}\s*=", text) else "h"
        text, count = re.subn(rf"(parameter[^=\n]*\b{name}\s*= )[^,\s]+", rf"\g<1>{width}'{kind}{raw:x}", text)
        if count != 1:
            raise FileError(f"{rtl}: top.v: parameter {name} is missing")
    (work / "top.v").write_text(text)
    script = [f"read_verilog -defer {path.name}" for path in files]
    script += [
        "hierarchy -check -top gyro_top",
        f"rename -top {TOP}",
        "proc; opt_clean; check -assert",
        "write_ilang base.il",
    ]
    (work / "base.ys").write_text("\n".join(script) + "\n")
    run_tool(["yosys", "-q", "base.ys"], work, "top: the design")


# ---- clocks, 64 at a time ------------------------------------------------------------------------------------------


def _pack_column_bit(column, bit):
    """One bit of a column of integers as words, the first row in the lowest bit."""
    bits = np.packbits((column >> bit & 1).astype(np.uint8), bitorder="little")
    return np.frombuffer(bits.tobytes() + bytes(-len(bits) % 8), np.uint64)


@kernel
def _evaluate(ands, leaves, batch_index, values):
    """Values of all literals in one word; `values[2]` is that of the first leaf."""
    first = 2 * (1 + leaves.shape[0])
    for k in range(leaves.shape[0]):
        values[2 * k + 2] = leaves[k, batch_index]
        values[2 * k + 3] = ~leaves[k, batch_index]
    for k in range(ands.shape[0]):
        word = values[ands[k, 0]] & values[ands[k, 1]]
        values[first + 2 * k] = word
        values[first + 2 * k + 1] = ~word


@kernel
def _first_true_row(ands, leaves, literal, count):
    """First row in which a literal is 1, or -1."""
    values = np.zeros(2 * (1 + leaves.shape[0] + ands.shape[0]), np.uint64)
    values[1] = ~np.uint64(0)
    for batch_index in range(leaves.shape[1]):
        _evaluate(ands, leaves, batch_index, values)
        if values[literal] != 0:
            for k in range(WORD):
                if values[literal] >> np.uint64(k) & np.uint64(1) and WORD * batch_index + k < count:
                    return WORD * batch_index + k
    return -1


@kernel
def _first_mismatch(ands, leaves, literals, expected_words, count, values):
    """First row in which one of the literals is not as wanted, or -1."""
    for batch_index in range(leaves.shape[1]):
        _evaluate(ands, leaves, batch_index, values)
        bad = np.uint64(0)
        for k in range(literals.shape[0]):
            bad |= values[literals[k]] ^ expected_words[k, batch_index]
        if bad != 0:
            for k in range(WORD):
                if bad >> np.uint64(k) & np.uint64(1) and WORD * batch_index + k < count:
                    return WORD * batch_index + k
    return -1


def _ranges(params):
    """{port: (signed, lo, hi)} of the registers of the four loops, from their limits, for the judge to try."""
    register_ranges = {}
    for name in LOOPS:
        bounds, _ = unreachable.pi_registers(getattr(params.control, name).loop, f"r_control_{name}_loop_")
        register_ranges |= {port: (True, lo, hi) for port, (lo, hi, _) in bounds.items()}
    return register_ranges


class _Design:
    """The design with the parameters of a recording, flat, its faults, and which bit of a row stands at which leaf."""

    def __init__(self, r, rtl, work):
        self.r, self._work = r, work
        work.mkdir(parents=True, exist_ok=True)
        _prepare(r.params, rtl, work)

    def build(self, mutants):
        """Put faults in; they can then be judged."""
        graph = insert_faults(mutants, self._work, "top", FLAT)
        start = replay_recording.run(self.r.params, self.r.stimulus, 1, np.arange(1))
        where = self._map_leaves(graph, mutant_judge.copy_design(graph, graph.inputs[SELECT], 0)[0])
        reset = [0] * len(graph.latches)
        for (column, bit, flip), leaf in where:
            if leaf > graph.in_count:
                reset[leaf - graph.in_count - 1] = (
                    int(start.registers[0, column - replay_recording.INPUTS] >> bit & 1) ^ flip
                )
        self.judge = mutant_judge.Judge(graph, SELECT, reset, "top", self._work, lambda: _ranges(self.r.params))
        self._graph, self._where = graph, where

    def _map_leaves(self, graph, outs):
        """[((column of inputs and registers, bit, inverted), leaf)] with the sound design's outputs.

        Raises FileError if a flip-flop is in no port.
        """
        sources = []
        for column, name in enumerate((RESET_INPUT, *top.Inputs._fields)):
            sources += [((column, bit, 0), 1 + position) for bit, position in enumerate(graph.inputs.get(name, ()))]
        first, mapped_leaves = 1 + graph.in_count, set()
        for column, (port, fmt) in enumerate(
            zip(library.PORTS, library.port_formats(self.r.params.design), strict=True)
        ):
            positions = graph.outputs.get(port, ())
            if len(positions) != fmt.width:
                raise FileError(f"top.v: port {port} has {len(positions)} bits, not {fmt.width}")
            for bit, position in enumerate(positions if port.startswith("r_") else ()):
                leaf, flip = divmod(outs[position], 2)
                if first <= leaf < first + len(graph.latches):
                    mapped_leaves.add(leaf)
                    sources.append(((replay_recording.INPUTS + column, bit, flip), leaf))
        if len(mapped_leaves) < len(graph.latches):
            raise FileError(f"top.v: {len(graph.latches) - len(mapped_leaves)} flip-flops are at no port r_NAME")
        return sources

    def chunks(self):
        """(first clock, int64 rows of inputs and registers, pins): a row more than is new, but at the end."""
        size, end = CHUNK * FRAME_CYCLES, self.r.frames * FRAME_CYCLES
        for begin in range(0, end, size):
            stop = min(begin + size + 1, end)
            rows = replay_recording.run(
                self.r.params, self.r.stimulus, -(-stop // FRAME_CYCLES), np.arange(begin, stop)
            )
            yield begin, np.column_stack([rows.inputs, rows.registers]), rows.pins

    def check(self, rows, pins):
        """First row in which the sound design does not do what the model does, or -1."""
        net, graph = self.judge.net, self._graph
        leaves = np.zeros((net.first - 1, -(-len(rows) // WORD)), np.uint64)
        literals, expected_words = [], []
        outs, following = self.judge.sound
        for (column, bit, flip), leaf in self._where:
            word = _pack_column_bit(rows[:, column], bit)
            leaves[leaf - 1] = ~word if flip else word
            if leaf > graph.in_count:
                literals.append(following[leaf - graph.in_count - 1])
                after = _pack_column_bit(rows[1:, column], bit)
                expected_words.append(np.resize(~after if flip else after, leaves.shape[1]))
        for column, (name, fmt) in enumerate(zip(top.Pins._fields, top.PINS_FMT, strict=True)):
            for bit, position in enumerate(graph.outputs[f"o_{name}"]):
                literals.append(outs[position])
                expected_words.append(_pack_column_bit(pins[:, column], bit))
                assert bit < fmt.width
        ands = np.array(net.ands[: self.judge.shared], np.int64).reshape(-1, 2)
        values = np.zeros(2 * (1 + len(leaves) + len(ands)), np.uint64)
        values[1] = ~np.uint64(0)
        return int(
            _first_mismatch(ands, leaves, np.array(literals, np.int64), np.array(expected_words), len(rows) - 1, values)
        )

    def find_first_true_row(self, literal, rows):
        """First row in which a literal is 1, or -1."""
        if literal < 2:
            return literal - 1
        net = self.judge.net
        nodes = net.fanin_nodes([literal], {})
        count = sum(node < net.first for node in nodes)
        at = {0: 0} | {node: 2 * (k + 1) for k, node in enumerate(nodes)}
        ands = [[at[x >> 1] ^ (x & 1) for x in net.ands[node - net.first]] for node in nodes[count:]]
        leaves = np.zeros((count, -(-len(rows) // WORD)), np.uint64)
        for (column, bit, flip), leaf in self._where:
            if leaf in at:
                word = _pack_column_bit(rows[:, column], bit)
                leaves[at[leaf] // 2 - 1] = ~word if flip else word
        gates = np.array(ands, np.int64).reshape(-1, 2)
        return int(_first_true_row(gates, leaves, at[literal >> 1] ^ (literal & 1), len(rows)))


def _find_killed_faults(design, mutants):
    """Numbers of the faults that some clock of the recording shows; FileError if the sound design differs."""
    difference_literals = {m.number: design.judge.differs(m.number) for m in mutants}
    killed = set()
    for begin, rows, pins in design.chunks():
        bad = design.check(rows, pins)
        if bad >= 0:
            raise FileError(
                f"top/{design.r.name}: the design differs from the model at clock {begin + bad}: "
                "a failing design has no score"
            )
        for number, literal in list(difference_literals.items()):
            if design.find_first_true_row(literal, rows) >= 0:
                killed.add(number)
                del difference_literals[number]
    return killed


def score_wiring(rtl, cases=CASES, count=COUNT, seed=SEED, keep=None):
    """`mutate.Outcome` of the wiring of the design in folder `rtl`, over the recordings `cases` together.

    Raises ConfigError for a bad number or a missing tool, FileError for a failing or missing design.
    """
    if not 1 <= count <= 10_000 or not 0 <= seed < 1 << 31:
        raise ConfigError(f"count, seed: {count}, {seed} are outside 1 .. 10000, 0 .. 2**31 - 1")
    for name in TOOLS:
        if shutil.which(name) is None:
            raise ConfigError(f"{name}: not installed; a mutation score needs {', '.join(TOOLS)}")
    with tempfile.TemporaryDirectory(prefix="gyro-wiring-") as temporary:
        mutants, alive, designs = [], [], []
        for case in cases:
            work = Path(keep or temporary).resolve() / case
            designs.append(_Design(recording.load(case), rtl, work))
            if not mutants:
                alive = mutants = choose(work, count, seed, "top", TOP)
            designs[-1].build(alive)
            killed = _find_killed_faults(designs[-1], alive)
            alive = [m for m in alive if m.number not in killed]
        # a fault that any recording kills needs no verdict, which takes the longest
        verdicts = [_worst(design.judge.verdict(m.number) for design in designs) for m in alive]
    return Outcome.from_verdicts("top", "+".join(cases), seed, mutants, alive, verdicts)


def _worst(verdicts):
    """The first that is not equivalent, else the last: equivalent only if so in every case."""
    for verdict in verdicts:
        if verdict.verdict != "equivalent":
            break
    return verdict
