"""`make check` of a bundle of the whole design.

Source  docs/golden.md (the whole design)
"""

from testbench.golden.top_benches.layout import DEFAULT_FRAMES, PARTS


def makefile(block, case):
    """`make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder [FRAMES=n]`; without RTL the bench elaborates."""
    stem = block.stem
    defaults = "\n".join(f"FRAMES_{sim} = {frames}" for sim, frames in DEFAULT_FRAMES.items())
    return f"""# {stem}/{case}: make check SIM=icarus|verilator|ghdl|cocotb|vunit RTL=folder (absolute, or from here)
# The folder holds {stem}.v or {stem}.vhd with {block.module}, and its parts; without RTL the bench is only elaborated.
# FRAMES: stop after so many, 0 runs all. Unless given, slow simulators stop early:
{defaults}
SIM ?= icarus
RTL ?=
PYTHON ?= python3
FRAMES ?= $(FRAMES_$(SIM))
PARTS = {" ".join(PARTS)}
SUFFIX = $(if $(filter ghdl vunit,$(SIM)),vhd,v)
WANTED = $(RTL)/{stem}.$(SUFFIX)
DESIGN = $(if $(RTL),$(foreach part,$(PARTS),$(wildcard $(RTL)/$(part).$(SUFFIX))) $(WANTED))
NONE = $(if $(RTL),,-DNO_DESIGN)
RESULT = build/$(SIM).txt
JUDGE = cat $(RESULT); grep -q $(if $(RTL),'^PASS ','^NO DESIGN ') $(RESULT)

check: given
	@$(MAKE) --no-print-directory run-$(SIM) RTL='$(RTL)' SIM=$(SIM) FRAMES=$(FRAMES)

given:
	@mkdir -p build
	@if [ -n '$(RTL)' ] && [ ! -f '$(WANTED)' ]; then echo 'FAIL {stem}/{case}: no design $(WANTED)'; exit 2; fi

run-icarus:
	@iverilog -g2005 -I. -s tb_{stem} $(NONE) -o build/tb.vvp tb_{stem}.v $(DESIGN)
	@vvp -n build/tb.vvp +FRAMES=$(FRAMES) > $(RESULT); $(JUDGE)

run-verilator:
	@verilator --binary --timing -O3 --x-assign fast --x-initial fast -Wno-fatal -Wno-lint -Wno-style -I. \\
	--top-module tb_{stem} $(NONE) --Mdir build/verilator -o sim tb_{stem}.v $(DESIGN) \\
	-CFLAGS -O2 > build/verilator.log 2>&1 || (cat build/verilator.log; exit 2)
	@build/verilator/sim +FRAMES=$(FRAMES) > $(RESULT); $(JUDGE)

run-ghdl:
	@mkdir -p build/ghdl
	@ghdl -a --std=08 --workdir=build/ghdl params_pkg.vhd $(DESIGN) tb_{stem}.vhd
	@ghdl -e --std=08 --workdir=build/ghdl -o build/ghdl/tb tb_{stem} $(if $(RTL),,2> build/ghdl/unbound.log)
	@ghdl -r --std=08 --workdir=build/ghdl tb_{stem} -gFRAMES=$(FRAMES) $(if $(RTL),,-gNO_DESIGN=true) \\
	--max-stack-alloc=0 > $(RESULT) 2>&1; $(JUDGE)

run-cocotb:
	@env -u MAKEFLAGS -u MAKELEVEL SIM=icarus RTL='$(RTL)' FRAMES=$(FRAMES) \\
	$(PYTHON) test_{stem}.py > $(RESULT) 2>&1; $(JUDGE)

run-vunit:
	@RTL='$(RTL)' FRAMES=$(FRAMES) $(PYTHON) run_vunit.py -o build/vunit > $(RESULT) 2>&1; \\
	status=$$?; tail -8 $(RESULT); exit $$status

clean:
	rm -rf build

.PHONY: check given clean run-icarus run-verilator run-ghdl run-cocotb run-vunit
"""
