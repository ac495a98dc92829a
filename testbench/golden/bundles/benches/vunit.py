"""The VHDL bench as a test of VUnit, and its run script.

Source  docs/golden.md (using a bench in your own flow)
"""

from testbench.golden.bundles.benches.layout import PARTS


def vunit_bench(block, case, frames=False):
    """The VHDL bench as a test of VUnit; `frames`: it has a generic that stops it early."""
    name = f"tb_{block.stem}"
    generic, mapped = (";\n        frames : natural := 0", "FRAMES => frames, ") if frames else ("", "")
    return f"""-- {block.stem}/{case} as a test of VUnit
library vunit_lib;
context vunit_lib.vunit_context;

entity {name}_vunit is
    generic (
        runner_cfg : string;
        tb_path : string;
        no_design : boolean := false{generic}
    );
end entity;

architecture bench of {name}_vunit is
    signal finished : boolean;
    signal errors : natural;
begin
    inner: entity work.{name}
        generic map (NO_DESIGN => no_design, {mapped}DIR => tb_path)
        port map (finished => finished, errors => errors);

    main: process
    begin
        test_runner_setup(runner, runner_cfg);
        if not finished then
            wait until finished;
        end if;
        check_equal(errors, 0, "rows that differ");
        test_runner_cleanup(runner);
    end process;
end architecture;
"""


def vunit_run(block, case, frames=None):
    """Run script of VUnit: RTL=folder python3 run_vunit.py; `frames`: after how many the bench stops, if it can."""
    stop = "" if frames is None else f'bench.set_generic("frames", int(os.environ.get("FRAMES") or {frames}))\n'
    return f'''"""{block.stem}/{case} under VUnit: RTL=folder python3 run_vunit.py; without RTL it only elaborates."""

import os
from pathlib import Path

from vunit import VUnit

HERE = Path(__file__).resolve().parent
SOURCES = {(*PARTS.get(block.stem, ()), block.stem)!r}

vu = VUnit.from_argv()
vu.add_vhdl_builtins()
lib = vu.add_library("golden")
# check.sh leaves in WORK the files of the design, and the bench of the level
WORK = HERE / (os.environ.get("WORK") or "none")
wrapper = HERE / "golden_{block.stem}.vhd"
for name in ("params_pkg.vhd", "tb_{block.stem}.vhd", "tb_{block.stem}_vunit.vhd"):
    lib.add_source_files(WORK / name if (WORK / name).is_file() else HERE / name)
rtl = os.environ.get("RTL", "")
if rtl and (WORK / "sources").is_file():
    for line in (WORK / "sources").read_text().splitlines():
        kind, _, rest = line.partition(" ")
        name, _, path = rest.partition(" ")
        if kind == "file" and path.endswith((".vhd", ".vhdl")):
            name = ("design" if wrapper.is_file() else "golden") if name == "-" else name
            vu.add_library(name, allow_duplicate=True).add_source_files(HERE / path)
elif rtl:
    for stem in SOURCES:
        path = Path(rtl).resolve() / f"{{stem}}.vhd"
        if path.is_file() or stem == SOURCES[-1]:
            lib.add_source_files(path)
if rtl and wrapper.is_file():
    lib.add_source_files(wrapper)
bench = lib.test_bench("tb_{block.stem}_vunit")
bench.set_generic("no_design", not rtl)
{stop}vu.main()
'''
