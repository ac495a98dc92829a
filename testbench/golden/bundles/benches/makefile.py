"""`make check` of a bundle: every simulator that is installed and has a design, and a line for each that has not.

The work is in check.sh, plain POSIX shell, so that a flow without make can call it too; it writes into build/ only.
Source  docs/golden.md (exit codes)
"""

from testbench.golden.bundles.benches.layout import PARTS

SIMS = ("icarus", "verilator", "ghdl", "cocotb", "vunit")


def makefile(block, case):
    """`make check [SIM=...] RTL=folder`."""
    return f"""# {block.stem}/{case}: make check RTL=folder runs every simulator that is here and has a design
# SIM=icarus|verilator|ghdl|cocotb|cocotb-verilator|vunit runs that one. check.sh tells what a folder must hold.
SIM ?=
RTL ?=
PYTHON ?= python3
export RTL PYTHON

check:
	@sh ./check.sh $(SIM)

clean:
	rm -rf build

.PHONY: check clean
"""


def _frames(defaults):
    """Shell text of benches that may stop early; `defaults` are {simulator: frames, 0 for all}."""
    lines = "\n".join(f"    {sim}) echo ${{FRAMES:-{count}}} ;;" for sim, count in defaults.items())
    return f"""
# A bench stops after so many frames, 0 is all of them; FRAMES=n in the environment is for every simulator
frames() {{
    case $1 in
{lines}
    esac
}}
"""


def check_script(block, case, frames=None):
    """`RTL=folder sh check.sh [SIM ...]`; exit code 0: nothing failed, 1: a bench failed, 2: nothing could be run.

    frames  {simulator: frames} after which the benches of the whole design stop unless told otherwise; None for blocks
    """
    stem, title = block.stem, f"{block.stem}/{case}"
    level, why = (
        ("2", "optimised: running takes longer than compiling")
        if frames
        else (
            "0",
            "not optimised: compiling takes longer than running",
        )
    )
    plus, generic = (" +FRAMES=$(frames $1)", " -gFRAMES=$(frames $1)") if frames else ("", "")
    exported = 'FRAMES=$(frames "$1") ' if frames else ""
    return f"""#!/bin/sh
# {title}: RTL=folder sh check.sh [icarus|verilator|ghdl|cocotb|cocotb-verilator|vunit ...]
# The folder (absolute, or seen from where you are) holds {stem}.v or {stem}.vhd with gyro_{stem}. Without names every
# simulator runs that is installed and has a design; without RTL the benches are elaborated alone.
# Exit code 0: nothing failed, 1: a bench failed, 2: nothing could be run.
BLOCK={stem}
TITLE={title}
PARTS="{" ".join(PARTS.get(stem, ()))}"
PYTHON=${{PYTHON:-python3}}
export PYTHONDONTWRITEBYTECODE=1
# what a calling make or pytest leaves behind stops Verilator's make and cocotb's runner
unset MAKEFLAGS MFLAGS MAKELEVEL PYTEST_CURRENT_TEST

{_frames(frames) if frames else ""}die() {{
    echo "FAIL $TITLE: $*"
    exit 2
}}

# a link, so that no simulator meets a blank in the path of the design
if [ -n "$RTL" ]; then
    [ -d "$RTL" ] || die "no folder $RTL, seen from $PWD"
    RTL=$(cd "$RTL" && pwd) || exit 2
fi
cd "$(dirname "$0")" || exit 2
mkdir -p build && rm -f build/rtl || exit 2
NONE=-DNO_DESIGN
WANTED="NO DESIGN"
if [ -n "$RTL" ]; then
    ln -s "$RTL" build/rtl || exit 2
    [ -f build/rtl/$BLOCK.v ] || [ -f build/rtl/$BLOCK.vhd ] || die "no design $RTL/$BLOCK.v or $BLOCK.vhd"
    NONE=
    WANTED=PASS
fi
export RTL

suffix() {{
    case $1 in ghdl | vunit) echo vhd ;; *) echo v ;; esac
}}

# Files of the design that end in .$1, what is instantiated first
design() {{
    [ -n "$RTL" ] || return 0
    for part in $PARTS $BLOCK; do
        [ ! -f "build/rtl/$part.$1" ] || echo "${{2}}build/rtl/$part.$1"
    done
}}

# Why simulator $1 cannot run; nothing if it can
reason() {{
    module=
    case $1 in
    icarus) tools="iverilog vvp" ;;
    verilator) tools="verilator make g++" ;;
    ghdl) tools=ghdl ;;
    cocotb) tools=iverilog module=cocotb ;;
    cocotb-verilator) tools="verilator make g++" module=cocotb ;;
    vunit) tools=ghdl module=vunit ;;
    *) echo "there is no simulator of this name" && return ;;
    esac
    if [ -n "$RTL" ] && [ ! -f "build/rtl/$BLOCK.$(suffix "$1")" ]; then
        echo "no $BLOCK.$(suffix "$1") in $RTL" && return
    fi
    case $1$PWD in cocotb-verilator*" "*) echo "Verilator's make works in no path with a blank" && return ;; esac
    for tool in $tools; do
        command -v $tool >/dev/null || {{ echo "$tool is not installed" && return; }}
    done
    if [ -n "$module" ] && ! "$PYTHON" -c "import $module" 2>/dev/null; then
        echo "$PYTHON has no module $module"
    fi
}}

run() {{
    case $1 in
    icarus)
        iverilog -g2005 -I. -s tb_$BLOCK $NONE -o build/tb.vvp tb_$BLOCK.v $(design v) && vvp -n build/tb.vvp{plus}
        ;;
    verilator) # {why}; its make works in no path with a blank
        work=build/verilator
        case $PWD in *" "*) work=$(mktemp -d) && trap 'rm -rf "$work"' EXIT ;; esac
        # its library is compiled once per version, which is most of the time
        version=$(verilator --version)
        [ "$(cat $work/version 2>&1)" = "$version" ] || rm -rf $work
        mkdir -p $work || return
        kept=$(cd $work && for file in verilated*.o; do [ ! -f $file ] || printf ' -o %s' $file; done)
        verilator --binary --timing -j 0 -MAKEFLAGS "OPT_FAST=-O{level} OPT_GLOBAL=-O{level}$kept" \\
            -Wno-fatal -Wno-lint -Wno-style -I. --top-module tb_$BLOCK $NONE --Mdir $work -o sim \\
            tb_$BLOCK.v $(design v) >build/verilator.log 2>&1 || {{ cat build/verilator.log && return 1; }}
        echo "$version" >$work/version
        $work/sim{plus}
        ;;
    ghdl) # from a folder of its own, and new: some back ends leave an executable, and a library remembers old designs
        rm -rf build/ghdl && mkdir -p build/ghdl && cd build/ghdl || return
        ghdl -a --std=08 ../../params_pkg.vhd $(cd ../.. && design vhd ../../) ../../tb_$BLOCK.vhd &&
            ghdl -e --std=08 tb_$BLOCK &&
            ghdl -r --std=08 tb_$BLOCK -gDIR=../../{generic} ${{NONE:+-gNO_DESIGN=true}}
        ;;
    cocotb) {exported}SIM=icarus "$PYTHON" test_$BLOCK.py ;;
    cocotb-verilator) {exported}SIM=verilator "$PYTHON" test_$BLOCK.py ;;
    vunit) {exported}"$PYTHON" run_vunit.py -v --no-color -o build/vunit ;;
    esac
}}

# Run simulator $1 and say how it went
judge() {{
    result=build/$1.txt
    if (run "$1") >$result 2>&1 && grep -q "^$WANTED $TITLE: " $result && ! grep -q "^FAIL " $result; then
        grep "^$WANTED $TITLE: " $result | sed "s/\\$/ [$1]/"
        return 0
    fi
    if grep -q "^FAIL " $result; then
        grep -E "^(row|clock|frame|FAIL) " $result | sed "s/\\$/ [$1]/"
    else
        cat $result
        echo "FAIL $TITLE: the bench did not get to its end [$1]"
    fi
    return 1
}}

status=0
ran=0
for sim in ${{*:-{" ".join(SIMS)}}}; do
    why=$(reason $sim)
    if [ -z "$why" ]; then
        ran=$((ran + 1))
        judge $sim || status=1
    elif [ $# -gt 0 ]; then
        die "$sim: $why"
    else
        echo "SKIPPED $TITLE: $why [$sim]"
    fi
done
[ $ran -gt 0 ] || die "no simulator could be run"
exit $status
"""
