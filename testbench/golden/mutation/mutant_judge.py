"""Is a fault that no vector saw a fault at all? Judged by the SAT solvers of yosys' own ABC.

    differs    an output or a next register of the faulted design is not that of the sound one, which stands in the
               same state and has the same inputs: the first difference of the two begins in a common state
    1. once    `differs` is impossible in every state, reachable or not: equivalent, without any bound
    2. ranges  or in every state with registers within ranges that the design, by induction, never leaves: equivalent
    3. search  else from reset, 1, 2, .. clocks: a trace that ends in `differs`: alive
    4. proof   else property-directed reachability finds an invariant without `differs`, equivalent, or a trace, alive
    5. search  else as 3., further
    otherwise  undecided, with the number of clocks that were searched

Steps are bounded by work, in conflicts of the solver, in clocks and in flip-flops, not by time: a verdict is the same
under any load. A step that takes CPU_S of a processor all the same is given up, and the verdict says so.
Ranges are guesses (those that the model is proven to keep): the solver shows on the design itself which of them hold.
Inputs that the contract of a block forbids, such as a start within the wait of the last one, are left out.
Source  docs/golden.md; Een, Mishchenko, Brayton, FMCAD 2011 (PDR)
"""

import re
import signal
import subprocess
from functools import cached_property
from typing import NamedTuple

from testbench.errors import FileError
from testbench.golden.mutation.miter import Net, encode_aiger

# Bounds of the steps, in conflicts of one call of the solver and in clocks (frames of the proof)
IPROVE_STEP = "iprove -N 4 -M 50000"
SHORT_BMC_STEP, PROOF, LONG_BMC_STEP = "bmc3 -F 16 -C 20000", "scorr; pdr -F 60 -C 20000", "bmc3 -F 600 -C 2000"
CPU_S = 10
TOOLS = ("yosys", "yosys-abc")
# Blocks that need not stand an input, but while a register is 0: {block: (input, register)}
CONTRACTS = {"rate_output": ("en", "r_stage")}


class Verdict(NamedTuple):
    """equivalent, alive or undecided; why; and for a living fault the inputs (hex) of each clock from reset.

    An output differs in the last clock of the trace, or a register after it.
    """

    verdict: str
    why: str
    trace: list


def _abc(commands, work, what):
    """What ABC said, or None when it was given up."""
    command = ["sh", "-c", f'ulimit -t {CPU_S}; exec yosys-abc -c "$0"', "; ".join(commands)]
    process = subprocess.run(command, cwd=work, capture_output=True, text=True)
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return None
    if process.returncode:
        error_text = "\n".join((process.stdout + process.stderr).strip().splitlines()[-6:])
        raise FileError(f"{what}: yosys-abc failed with {process.returncode}:\n{error_text}")
    return process.stdout


def _read_counterexample(path, inputs):
    """[{input: hex}] of each clock from a counterexample with names: `name[bit]@clock=value`."""
    clocks = {}
    for name, bit, clock, value in re.findall(r"(\w+)(?:\[(\d+)\])?@(\d+)=(\d)", path.read_text()):
        words = clocks.setdefault(int(clock), {})
        words[name] = words.get(name, 0) | int(value) << int(bit or 0)
    return [{name: f"{word:x}" for name, word in clocks[n].items() if name in inputs} for n in sorted(clocks)]


def copy_design(graph, select, number, net=None):
    """(outputs, next literals of the flip-flops) of the design with a number at the input `select`, in `net`."""
    leaves = [2 * (k + 1) for k in range(graph.in_count + len(graph.latches))]
    for k, leaf_index in enumerate(select):
        leaves[leaf_index] = number >> k & 1
    return (net or Net(len(leaves))).copy(graph, leaves)


class Judge:
    """Verdicts on the faults of one design.

    graph   `aig.Graph` with the faults, each switched on by its number at the input `select`
    reset   value of each flip-flop in the reset state
    ranges  function without arguments: {output: (signed, lo, hi)} of registers, to be tried; None: nothing is known
    block   whose contract holds
    work    folder for the solver's files
    """

    def __init__(self, graph, select, reset, block, work, ranges=None):
        self._graph, self._select, self._work, self.what = graph, graph.inputs[select], work, block
        leaves = graph.in_count + len(graph.latches)
        # one leaf more: the contract was broken before
        self.net = Net(leaves + 1)
        self._ranges = ranges
        self._leaves = [2 * (k + 1) for k in range(leaves)]
        self._broken = leaves + 1
        self._inputs = {name for name in graph.inputs if name != select}
        self._names = {}
        for name, positions in graph.inputs.items():
            one = len(positions) == 1
            self._names |= {1 + p: name if one else f"{name}[{k}]" for k, p in enumerate(positions)}
        self.sound = self._copy(0)
        self.shared = len(self.net.ands)  # ANDs of the sound copy come first
        outs, following = self.sound
        contract_literal = 1
        if block in CONTRACTS:
            strobe, register = CONTRACTS[block]
            busy = self.net.any(outs[position] for position in graph.outputs[register])
            contract_literal = self.net.both(self._leaves[graph.inputs[strobe][0]], busy) ^ 1
        self._kept = contract_literal
        broken_literal = 2 * self._broken
        first = 1 + graph.in_count
        self._following = {first + k: x for k, x in enumerate(following)}
        self._following[self._broken] = self.net.either(broken_literal, contract_literal ^ 1)
        self._initial = {first + k: int(x) for k, x in enumerate(reset)} | {self._broken: 0}

    def _copy(self, number):
        return copy_design(self._graph, self._select, number, self.net)

    def differs(self, number):
        """Literal: the faulted copy differs from the sound one, and the contract holds now."""
        outs, following = self._copy(number)
        pairs = [*zip(self.sound[0], outs, strict=True), *zip(self.sound[1], following, strict=True)]
        return self.net.both(self._kept, self.net.any(self.net.differ(a, b) for a, b in pairs if a != b))

    def _never(self, literal, name):
        """Whether a literal is 0 in every state, by one call of the solver."""
        if literal < 2:
            return literal == 0
        names = self._names | {node: f"q{node}" for node in self._following}
        (self._work / f"{name}.aig").write_bytes(encode_aiger(self.net, literal, names, {}, {}))
        abc_output = _abc([f"read_aiger {name}.aig", "strash", IPROVE_STEP], self._work, self.what) or ""
        return bool(re.search(r"\bUNSATISFIABLE", abc_output))

    def _guesses(self):
        """[(bound now, bound after the next edge)] of the ranges that hold in the reset state."""
        net, bounds = self.net, []
        for name, (signed, lo, hi) in (self._ranges() if self._ranges else {}).items():
            now = [self.sound[0][position] for position in self._graph.outputs[name]]
            if not all(x >> 1 in self._following for x in now):
                continue
            after = [self._following[x >> 1] ^ (x & 1) for x in now]
            word = sum((self._initial[x >> 1] ^ (x & 1)) << k for k, x in enumerate(now))
            word -= 1 << len(now) if signed and word >> (len(now) - 1) else 0
            if lo <= word <= hi:
                bounds += zip(
                    net.bound_literals(now, signed, lo, hi), net.bound_literals(after, signed, lo, hi), strict=True
                )
        return bounds

    @cached_property
    def _range_invariant(self):
        """Literal of bounds that, together, no edge of the sound design leaves; those that fail are left out."""
        net, bounds = self.net, self._guesses()
        while bounds:
            assumption = net.both(self._kept, net.any(now ^ 1 for now, _ in bounds) ^ 1)
            if self._never(net.both(assumption, net.any(after ^ 1 for _, after in bounds)), "bounds"):
                break
            inductive = [pair for pair in bounds if self._never(net.both(assumption, pair[1] ^ 1), "bound")]
            bounds = inductive if len(inductive) < len(bounds) else []
        return net.any(now ^ 1 for now, _ in bounds) ^ 1

    def _search(self, number, differs):
        """Verdict by traces from reset, and by an invariant."""
        net, names = self.net, self._names
        literal = net.both(differs, 2 * self._broken ^ 1)
        path, trace_path = self._work / f"ever_{number}.aig", self._work / f"trace_{number}.txt"
        path.write_bytes(encode_aiger(net, literal, names, self._following, self._initial))
        clocks, aborted_steps = 0, ""
        for way in (SHORT_BMC_STEP, PROOF, LONG_BMC_STEP):
            commands = [f"read_aiger {path.name}", "strash", way, f"write_cex -n {trace_path.name}"]
            abc_output = _abc(commands, self._work, self.what)
            if abc_output is None:
                aborted_steps += f"; `{way}` was given up after {CPU_S} s of a processor"
                continue
            if "was asserted in frame" in abc_output:
                trace = _read_counterexample(trace_path, self._inputs)
                return Verdict("alive", f"differs {len(trace)} clocks after reset", trace)
            if "Property proved" in abc_output or "all reachable states" in abc_output:
                return Verdict("equivalent", "in every state that can be reached", [])
            clocks = max([clocks, *map(int, re.findall(r"No output asserted in (\d+) frames", abc_output))])
        return Verdict("undecided", f"no difference within {clocks} clocks from reset, and no proof{aborted_steps}", [])

    def verdict(self, number):
        """Verdict on a fault."""
        differs = self.differs(number)
        if self._never(differs, "once"):
            return Verdict("equivalent", "in every state", [])
        restricted_difference = self.net.both(differs, self._range_invariant)
        if restricted_difference != differs and self._never(restricted_difference, "within"):
            return Verdict("equivalent", "in every state within ranges that are never left", [])
        return self._search(number, differs)
