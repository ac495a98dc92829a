"""Mutation scores: the judge against exhaustive vectors, refusals, and what weak vectors look like."""

import json
import random
import re
import shutil
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from testbench.commands.main import app, main
from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle
from testbench.golden.mutation import aig, mutant_judge, mutate
from testbench.golden.stimulus import blocks
from tests.testbench.rtl.test_rtl import RTL

pytestmark = pytest.mark.skipif(
    any(shutil.which(name) is None for name in mutate.TOOLS), reason="no yosys: no mutation score"
)

# Counts enabled clocks modulo 10: six of sixteen states are out of reach, and the carry never matters
TINY = """module gyro_tiny #(parameter [3:0] last = 4'd0) (
    input wire clk, input wire rst, input wire en,
    output reg [3:0] r_count, output wire o_full
);
    wire [4:0] following = {1'b0, r_count} + 5'd1;
    assign o_full = (r_count == last) | (r_count > 4'd12);
    always @(posedge clk)
        if (rst)
            r_count <= 4'd3;
        else if (en)
            r_count <= (r_count == last) ? 4'd0 : following[3:0];
endmodule
"""
BIT = {"width": 1, "signed": False}


def tiny_bundle(folder, stimulus):
    """A bundle of the counter: rows of (rst, en)."""
    inputs = [{"name": "rst", **BIT}, {"name": "en", **BIT}]
    registers = [{"name": "count", "width": 4, "signed": False, "reset": 3}]
    outputs = [{"name": "full", **BIT}]
    count, stim, exp = 3, [], []
    for rst, en in stimulus:
        stim.append(rst << 1 | en)
        exp.append(count << 1 | (count == 9))
        if rst:
            count = 3
        elif en:
            count = 0 if count == 9 else count + 1
    manifest = {
        "schema": bundle.SCHEMA, "block": "tiny", "case": "ten", "n": len(stim), "clock": {"name": "clk"},
        "reset": {"name": "rst", "cycles": 2}, "inputs": inputs, "registers": registers, "outputs": outputs,
        "params": [{"name": "last", "raw": 9, "fmt": [0, 4, 0]}], "provenance": {},
    }  # fmt: skip
    words = {"stim": (stim, 2), "exp": (exp, 5), "mask": ([31] * len(exp), 5)}
    bundle.write(folder, manifest, {f"{k}.hex": bundle.hex_text(*found) for k, found in words.items()})
    return folder


def long_walk():
    """Every transition of the counter with every input, many times over."""
    rng = random.Random(7)
    return [(int(rng.random() < 0.05), rng.randrange(2)) for _ in range(4000)]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Folders of the design, of a bundle that sees everything and of one that sees three rows."""
    root = tmp_path_factory.mktemp("tiny")
    (root / "rtl").mkdir()
    (root / "rtl" / "tiny.v").write_text(TINY)
    strong, weak = tiny_bundle(root / "strong", long_walk()), tiny_bundle(root / "weak", [(0, 0)] * 3)
    return SimpleNamespace(rtl=root / "rtl", strong=strong, weak=weak)


@pytest.fixture(scope="module", params=[20, pytest.param(1000, marks=pytest.mark.slow)], ids=["some", "every"])
def verdicts(tiny, request):
    """Outcomes of both bundles, each with some or every fault that the counter has."""
    return [mutate.score_bundle(folder, tiny.rtl, count=request.param) for folder in (tiny.strong, tiny.weak)]


def test_the_judge_agrees_with_vectors_that_see_everything(verdicts):
    """4000 random rows visit every reachable state with every input: what they leave cannot be told apart at all."""
    strong, weak = verdicts
    assert strong.mutants == weak.mutants
    assert strong.mutants == 20 or strong.mutants > 100
    assert strong.undecided == weak.undecided == 0
    assert {s["verdict"] for s in strong.survivors} == {"equivalent"}
    assert strong.score == 1
    # with weak vectors the judge alone has to find the same faults harmless, and every other alive
    assert weak.equivalent == strong.equivalent
    named = [{s["fault"] for s in o.survivors if s["verdict"] == "equivalent"} for o in verdicts]
    assert named[0] == named[1]
    assert weak.score == weak.killed / (weak.mutants - weak.equivalent) < 1


def test_both_proofs_were_needed(verdicts):
    assert {s["why"] for s in verdicts[0].survivors} == {"in every state", "in every state that can be reached"}


def test_a_trace_is_a_test_that_kills(verdicts, tiny, tmp_path):
    """The inputs that the solver found, as vectors, see the fault that the weak bundle missed."""
    traced = [s for s in verdicts[1].survivors if s["trace"]]
    for survivor in (traced[0], traced[-1]):
        rows = [[int(row.get(name, "0"), 16) for name in ("rst", "en")] for row in survivor["trace"]]
        rows.append([0, 0])  # a register that goes wrong at the last clock is seen in the next row
        folder = tiny_bundle(tmp_path / "traced", rows)
        manifest, work = bundle.verify(folder), tmp_path / f"work{survivor['mutant']}"
        work.mkdir()
        mutate.prepare(folder, manifest, mutate.sources(manifest, tiny.rtl), work)
        graph = mutate.insert_faults([mutate.Mutant(1, survivor["fault"], "")], work, "tiny")
        assert mutate.simulate(folder, manifest, graph, [1])[0][1] >= 0


def test_a_failing_design_is_refused(tiny, tmp_path):
    (tmp_path / "tiny.v").write_text(TINY.replace("4'd0 : following", "4'd1 : following"))
    with pytest.raises(FileError, match=r"tiny/ten: the design differs from the bundle at row \d+: a failing design"):
        mutate.score_bundle(tiny.strong, tmp_path, count=10)


def test_the_command_refuses_a_failing_design(tiny, tmp_path, capsys):
    (tmp_path / "tiny.v").write_text(TINY.replace("4'd0 : following", "4'd1 : following"))
    with pytest.raises(SystemExit) as ended:
        main(["golden", "mutate", str(tiny.strong), "--rtl", str(tmp_path), "--count", "10", "--json", "--write"])
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (2, "")
    assert re.fullmatch(r"gyro: tiny/ten: the design differs from the bundle at row \d+: a failing .*\n", said.err)
    assert "mutation" not in bundle.verify(tiny.strong)["provenance"]


def test_a_design_that_does_not_compile_is_refused(tiny, tmp_path):
    (tmp_path / "tiny.v").write_text(TINY.replace("endmodule", ""))
    with pytest.raises(FileError, match="yosys failed"):
        mutate.score_bundle(tiny.strong, tmp_path, count=10)


def test_a_latch_is_refused(tiny, tmp_path):
    latch = "    reg odd; always @(*) if (en) odd = rst;\n    assign o_full = odd | "
    (tmp_path / "tiny.v").write_text(TINY.replace("    assign o_full = ", latch))
    with pytest.raises(FileError, match="yosys failed"):
        mutate.score_bundle(tiny.strong, tmp_path, count=10)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"count": 0}, "count: 0 is outside 1 .. 10000 mutants"),
        ({"seed": -1}, "seed: -1 is outside"),
    ],
)
def test_bad_numbers_are_named(tiny, given, said):
    with pytest.raises(ConfigError, match=re.escape(said)):
        mutate.score_bundle(tiny.strong, tiny.rtl, **given)


def test_missing_things_are_named(tiny, tmp_path, monkeypatch):
    with pytest.raises(FileError, match=r"tiny\.v: no such file; the design of tiny needs it"):
        mutate.score_bundle(tiny.strong, tmp_path)
    monkeypatch.setattr(mutate.shutil, "which", lambda name: None if name == "yosys-abc" else name)
    with pytest.raises(ConfigError, match="yosys-abc: not installed"):
        mutate.score_bundle(tiny.strong, tiny.rtl)


def test_the_command_prints_json_and_notes_it_in_the_manifest(tiny):
    before = bundle.verify(tiny.weak)["manifest_sha256"]
    command = ["golden", "mutate", str(tiny.weak), "--rtl", str(tiny.rtl), "--count", "20", "--json", "--write"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1, done.output
    found = json.loads(done.output)
    assert {"mutants", "equivalent", "undecided", "killed", "score"} <= set(found)
    assert found["mutants"] == 20
    assert found["killed"] + found["equivalent"] + found["undecided"] <= 20
    assert found["score"] == found["killed"] / (20 - found["equivalent"])
    assert len(found["survivors"]) == 20 - found["killed"]
    manifest = bundle.verify(tiny.weak)
    assert manifest["manifest_sha256"] == before
    assert manifest["provenance"]["mutation"]["score"] == found["score"]


def test_the_same_seed_gives_the_same_faults(tiny, tmp_path):
    manifest = bundle.verify(tiny.strong)
    mutate.prepare(tiny.strong, manifest, mutate.sources(manifest, tiny.rtl), tmp_path)
    first, again, other = (mutate.choose(tmp_path, 30, seed, "tiny") for seed in (1, 1, 2))
    assert first == again != other
    assert not [m for m in first if "CLK" in m.options]


@pytest.mark.parametrize("stem", mutant_judge.CONTRACTS)
def test_contracts_speak_of_ports_that_exist(stem):
    block, (strobe, register) = blocks.BLOCKS[stem], mutant_judge.CONTRACTS[stem]
    assert {p.name: p.width for p in block.columns}[strobe] == 1
    assert register in {f"r_{p.name}" for p in block.registers}


def judged(tiny, work, **more):
    """`Judge` of every fault of the counter, and the numbers of those that the strong bundle leaves."""
    work.mkdir()
    manifest = bundle.verify(tiny.strong)
    mutate.prepare(tiny.strong, manifest, mutate.sources(manifest, tiny.rtl), work)
    mutants = mutate.choose(work, 1000, 1, "tiny")
    graph = mutate.insert_faults(mutants, work, "tiny")
    first, held = mutate.simulate(tiny.strong, manifest, graph, [m.number for m in mutants])
    found = mutant_judge.Judge(graph, mutate.SELECT, held, "tiny", work, **more)
    return found, [m.number for m in mutants if first[m.number] < 0]


@pytest.mark.slow
def test_true_ranges_prove_and_false_ones_are_found_out(tiny, tmp_path):
    """The counter never exceeds 9: shown on the netlist itself. That it never exceeds 8 is wrong, and not believed."""
    plain, left = judged(tiny, tmp_path / "plain")
    true, _ = judged(tiny, tmp_path / "true", ranges=lambda: {"r_count": (False, 0, 9)})
    false, _ = judged(tiny, tmp_path / "false", ranges=lambda: {"r_count": (False, 0, 8)})
    why = [[judge_.verdict(number) for number in left] for judge_ in (plain, true, false)]
    for verdicts in why:
        assert {v.verdict for v in verdicts} == {"equivalent"}
    known = "in every state within ranges that are never left"
    assert known in {v.why for v in why[1]}
    assert known not in {v.why for v in why[0] + why[2]}


@pytest.mark.slow
def test_a_contract_leaves_inputs_out(tiny, tmp_path, monkeypatch):
    """Told that the counter is enabled at 0 only, a fault of its carries cannot show."""
    free, _ = judged(tiny, tmp_path / "free")
    seen = {n: free.verdict(n) for n in range(1, 40)}
    carries = [n for n, verdict in seen.items() if verdict.verdict == "alive" and len(verdict.trace) > 2]
    monkeypatch.setitem(mutant_judge.CONTRACTS, "tiny", ("en", "r_count"))
    bound, _ = judged(tiny, tmp_path / "bound")
    verdicts = {n: bound.verdict(n) for n in carries}
    assert "equivalent" in {v.verdict for v in verdicts.values()}


def test_a_step_that_takes_too_long_is_given_up_and_says_so(tiny, tmp_path, monkeypatch):
    found, left = judged(tiny, tmp_path / "slow")
    reached = next(n for n in left if found.verdict(n).why == "in every state that can be reached")
    monkeypatch.setattr(mutant_judge, "_abc", lambda commands, work, what: None)
    verdict = found.verdict(reached)
    assert verdict.verdict == "undecided"
    assert verdict.why.count("was given up after") == 3


def test_the_solvers_are_bounded_by_work():
    """No option of a step is a time: -T of ABC would make a verdict depend on the load of the machine."""
    for step in (mutant_judge.IPROVE_STEP, mutant_judge.SHORT_BMC_STEP, mutant_judge.PROOF, mutant_judge.LONG_BMC_STEP):
        assert "-T" not in step
        assert re.search(r"-[CM] \d+", step)


def test_a_block_of_the_reference_design_has_every_fault_judged(tmp_path):
    from testbench.golden.bundles.export import export

    export("isqrt", tmp_path)
    outcome = mutate.score_bundle(tmp_path / "isqrt" / "default", RTL, count=60, seed=2)
    assert outcome.mutants == 60
    assert outcome.undecided == 0
    assert outcome.score == 1, outcome.text()


def test_files_that_are_no_netlist_are_refused(tmp_path):
    path = tmp_path / "x.aag"
    for text, said in (("aig 1 1 0 0 0\n", "not an AIGER text"), ("aag 3 1 0 1 1\n2\n6\n6 2 2\n", "not in order")):
        path.write_text(text)
        with pytest.raises(FileError, match=said):
            aig.read(path)


def test_a_port_that_is_missing_or_has_another_width_is_named(tiny, tmp_path):
    (tmp_path / "tiny.v").write_text(TINY.replace("o_full", "o_rest"))
    with pytest.raises(FileError, match="port o_full is missing"):
        mutate.score_bundle(tiny.strong, tmp_path, count=10)
    (tmp_path / "tiny.v").write_text(TINY.replace("output reg [3:0]", "output reg [4:0]"))
    with pytest.raises(FileError, match="port r_count has 5 bits, not 4"):
        mutate.score_bundle(tiny.strong, tmp_path, count=10)
