# Every target does its own set-up. `make run` and `make test` work alone on a fresh machine with Python 3.11 or newer.
.DEFAULT_GOAL := help
SHELL := /bin/bash
VENV := .venv
PYTHON ?= python3
BIN := $(VENV)/bin
OUT ?= out
# without bytecode every process that the tests start compiles all sources again
unexport PYTHONDONTWRITEBYTECODE
# a worker that crashes ends the run and names its test; a new one in its place can wait for ever
PYTEST := $(BIN)/python -m pytest --max-worker-restart 0

.PHONY: help run paper inference measured sealed golden rtl budget test test-slow test-all test-nojit test-bounds kills fuzz designs boards bench portability packages lock lint docs clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

# The stamp depends on pyproject.toml alone: the package itself is installed editable.
$(VENV)/.run: pyproject.toml
	@.ci/venv "$(PYTHON)" "$(VENV)" .
	@touch $@

$(VENV)/.test: pyproject.toml
	@.ci/venv "$(PYTHON)" "$(VENV)" ".[test]"
	@.ci/tools
	@touch $@ $(VENV)/.run

$(VENV)/.docs: pyproject.toml
	@.ci/venv "$(PYTHON)" "$(VENV)" ".[docs]"
	@touch $@ $(VENV)/.run

run: $(VENV)/.run ## the main job: power-on to lock at 100 deg/s, phase errors beside the budget and the paper
	$(BIN)/gyro run --seconds 1 --rate-dps 100 --seed 1 --out $(OUT)

golden: $(VENV)/.run ## golden vectors and benches of every block, for the HDL engineer: one folder per block in out/golden
	$(BIN)/gyro golden export all --out $(OUT)/golden

rtl: $(VENV)/.test ## the RTL: bundles, plant around it for 3 s, proofs, synthesis, mutation scores; PARTS="loop proofs" for some
	$(BIN)/python -m testbench.golden.rtl_verification $(PARTS) --out $(OUT)/golden

measured: $(VENV)/.run ## real recordings of parts against the model: one page, build/measured.html and .json; SETS="..." for some
	$(BIN)/python -m testbench.measured.sets_report --out build $(if $(SETS),--only $(SETS))

sealed: $(VENV)/.test ## sealed records of a second plant, 300 traces, hours; goes on where it was; MINUTES=20 for a part
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.sealed run --out $(OUT)/sealed --threads 2 $(if $(MINUTES),--minutes $(MINUTES))

paper: $(VENV)/.run ## the paper's experiments: calibration, five cases at three temperatures, one page; continues when started again
	$(BIN)/gyro report paper --out $(OUT)/paper

inference: $(VENV)/.run ## which board gave the paper's numbers: page, and the most probable board into docs/boards
	$(BIN)/gyro report infer --out $(OUT)/inference
	cp $(OUT)/inference/paper_inferred.toml $(OUT)/inference/paper_inferred.json docs/boards/

budget: $(VENV)/.run ## where the four phase errors come from, in clocks, ns and degrees
	$(BIN)/gyro budget

test: $(VENV)/.test ## the suite in minutes: every claim of the README once; prints how long kernels and suite took
	@.ci/timed "kernels compiled" $(BIN)/python -m tests.warm
	@.ci/timed "suite" $(PYTEST) -n 2 --dist loadfile --no-loadscope-reorder --benchmark-disable

test-slow: $(VENV)/.test ## what `make test` leaves out: long studies, every simulator, every case; MINUTES=20 for a part
	@.ci/timed "slow tests" $(PYTEST) -n 2 --dist worksteal --benchmark-disable -m slow $(if $(MINUTES),--minutes $(MINUTES))

test-all: export HYPOTHESIS_PROFILE = thorough
test-all: test test-slow test-nojit ## everything: within an hour

kills: $(VENV)/.test ## concurrent starts and kills of every command that writes; MINUTES=2 for a part
	$(BIN)/python -m tests.kills $(if $(MINUTES),--minutes $(MINUTES))

test-nojit: $(VENV)/.test ## the firmware's tests with every kernel interpreted
	NUMBA_DISABLE_JIT=1 $(PYTEST) -n 2 --benchmark-disable tests/fpga_model

test-bounds: $(VENV)/.test ## the suite with Numba checking every index
	NUMBA_BOUNDSCHECK=1 $(PYTEST) -n 2 --benchmark-disable

fuzz: $(VENV)/.test ## hostile files of every kind and hostile options, counts by kind; MINUTES=20 for longer, SEED=7 for others
	@.ci/timed "kernels compiled" $(BIN)/python -m tests.warm
	$(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),5) --seed $(or $(SEED),1) $(if $(KIND),--kind $(KIND))

designs: $(VENV)/.test ## random designs over all keys of [design]: both engines have the same registers and codes; COUNT=40 SEED=1
	$(BIN)/python -m tests.testbench.engines.test_designs $(or $(COUNT),40) $(or $(SEED),1)

boards: $(VENV)/.test ## plants of each board, drawn within its tolerances: lock, rest, scale factor, bandwidth, phases; COUNT=20
	BOARD_DRAWS=$(or $(COUNT),20) $(PYTEST) -n 2 --dist worksteal --benchmark-disable -m "slow or not slow" -k a_plant tests/testbench/test_boards.py

bench: $(VENV)/.test ## speed, as tables in docs/results and build/bench.json
	$(BIN)/python -m testbench.bench
	$(BIN)/python -m testbench.bench.c_firmware

portability: $(VENV)/.test ## one hash of all codes, and the tests of the core: three kinds of processor, lowest versions
	$(BIN)/python -m tests.testbench.bench.portability --make-old build/oldest --tests --page

packages: $(VENV)/.run ## wheel and sdist in environments of their own, run by a user without name, home and permission to write
	$(BIN)/python -m tests.packages

lock: ## write .ci/constraints.txt again, with the newest versions that pyproject.toml allows
	@.ci/lock "$(PYTHON)"

lint: $(VENV)/.test ## ruff, codespell, and the language of pages, docstrings and messages
	$(BIN)/ruff check docs fpga_model analog_frontend testbench tests
	$(BIN)/ruff format --check docs fpga_model analog_frontend testbench tests
	$(BIN)/codespell README.md CHANGELOG.md Makefile docs fpga_model analog_frontend testbench tests
	$(BIN)/python docs/language.py

docs: $(VENV)/.docs ## the site, in build/site: all pages, generated tables, a page for each module; a warning is an error
	$(BIN)/python docs/pages.py --check
	rm -rf build/site
	$(BIN)/python -m sphinx --quiet --fail-on-warning --doctree-dir build/doctrees docs build/site

clean: ## remove what the targets made
	rm -rf $(VENV) build out .pytest_cache .hypothesis .ruff_cache .benchmarks *.egg-info
