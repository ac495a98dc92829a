"""Names of the packages are nouns and verbs of the field: the rules of docs/conventions.md."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("fpga_model", "analog_frontend", "testbench")
# participles, pronouns, prepositions and adverbs: they do not say what a name stands for
VAGUE = frozenset(
    "told moved left held kept made found seen wanted given taken said shown judged played asked meant whole own "
    "near apart beside behind upon onward once even alone put done place places looks look like unlike others rest "
    "late lateness early along within without beyond above below under over there here then same such stands "
    "stood goes gone comes came carried noted listed named known unknown heard".split()
)
PREPOSITION = re.compile(r"_*(at|of|with|from|together|first|last|of_\w+|at_\w+|\w+_of)")
# reason: names that keep a vague part
REASONS = {
    "register or port, with its locals": "done taken left judged seen sck_seen held_number held_status "
    "held_temperature",
    "flag that events, ports and pages name": "over_range over_range_s OVER_RANGE",
    "rule of rounding": "half_even",
    "quoted by the page of proved ranges": "signs_of WITHIN_WORD",
    "state of the plant, by its name in checkpoints": "late_area late_count late_tau_s",
    "declared by every block": "place",
    "key of a configuration": "kxy_tc_above_per_k kxy_tc_below_per_k rest_s held_out",
    "key of a report or table": "bandwidth_moved_hz bandwidth_without_hz ring_without found_hz judged_rows kept "
    "left_db left_out made_from moved without looks",
    "member of a problem or law, in docs/tracing.md": "beyond library_late noise_along same same_rows",
}
ALLOWED = {name for names in REASONS.values() for name in names.split()}
SHARED = 150  # function names that three files or more define: protocols, and what every module of a kind has


def parts(name):
    """Words of snake_case and CamelCase."""
    return re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower().split("_")


@cache
def names(path):
    """{(kind, name)} of what a file defines: module, classes, functions, and their parameters and variables."""
    return frozenset(_names(path))


def _names(path):
    yield "module", path.stem
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ClassDef):
            yield "class", node.name
        elif isinstance(node, ast.FunctionDef):
            yield "function", node.name
            yield from (("parameter", a.arg) for a in node.args.args + node.args.kwonlyargs)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield "variable", node.id


def offences(path):
    """Names of a file that break a rule, each once."""
    return {
        f"{kind} {name}"
        for kind, name in names(path)
        if name not in ALLOWED
        and (VAGUE.intersection(parts(name)) or (kind == "function" and PREPOSITION.fullmatch(name)))
    }


SOURCES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def test_a_planted_offence_is_found(tmp_path):
    (tmp_path / "beside.py").write_text("class Kept:\n    def at(self, wanted):\n        made_up = of = 1\n")
    assert offences(tmp_path / "beside.py") == {
        "module beside",
        "class Kept",
        "function at",
        "parameter wanted",
        "variable made_up",
    }


def test_names_say_what_they_are_or_do():
    assert {str(path.relative_to(ROOT)): offences(path) for path in SOURCES if offences(path)} == {}


def test_the_allow_list_is_short_and_used():
    used = {name for path in SOURCES for _, name in names(path)}
    assert len(ALLOWED) <= 40
    assert ALLOWED - used == set()


def test_few_function_names_are_shared():
    """A function of one job is found by its name."""
    files = defaultdict(set)
    for path in SOURCES:
        for kind, name in names(path):
            if kind == "function" and not name.startswith("__"):
                files[name].add(path)
    shared = {name for name, where in files.items() if len(where) >= 3}
    assert len(shared) <= SHARED
