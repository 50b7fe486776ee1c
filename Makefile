# Set up, run the main comparison, test. `make help` lists the targets.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
TOOLS  := $(VENV)/.tools-installed
BENCH  := $(VENV)/.bench-installed
DOCS   := $(VENV)/.docs-installed
INSTALL = $(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python -c constraints.txt -e
STUDY  ?=
ONLY   ?= studies,runs,figures,reports
MUTANTS ?= 240
SEED    ?= 11
MINUTES ?= 30
LEVELS  ?= x86-64-v3 x86-64-v4
RUNS    ?= --controllers none table cut-and-ramp pi-creep perturb-observe steepest-gradient fuzzy-creep fuzzy-tracking swarm-tracking swarm-slip cubature-seeking mpc mpc-train

# small matrices everywhere: threads of BLAS would wait for each other
export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help setup compare report figures docs results test test-newest test-lowest mutants mutants-again results-hash soak bench bench-keep wheel keys lint types clean

help:      ## list the targets
	@sed -n 's/^\([a-z-]*\): .*## /\1\t/p' $(MAKEFILE_LIST)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "readhesion needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt uv
	$(INSTALL) '.[report]'
	@touch $(STAMP)

$(TOOLS): $(STAMP)
	$(INSTALL) '.[test,lint]'
	@touch $(TOOLS)

setup: $(TOOLS)      ## create .venv and install (a second call does nothing)

compare: $(STAMP)    ## the main job: every rule with every controller over the shipped slip events
	$(BIN)/readhesion compare

report: $(STAMP)     ## the same as one page that opens offline: report.html
	$(BIN)/readhesion report

figures: $(STAMP)    ## draw the figures of the papers
	$(BIN)/readhesion figures

$(DOCS): $(STAMP)
	$(INSTALL) '.[docs]'
	@touch $(DOCS)

docs: $(DOCS)        ## build the documentation site into build/docs; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q -b html docs build/docs

results: setup       ## compute the numbers of README and docs again, or those of one STUDY, and write tables and sentences
	$(BIN)/python -m tests.numbers compute $(STUDY)

test: setup          ## run the tests
	$(BIN)/python -m pytest -n 2

test-newest: setup   ## run rules, plant and simulation with the newest versions that pyproject.toml allows
	.ci/versions highest

test-lowest: setup   ## the same with the lowest versions; before a release
	.ci/versions lowest-direct

mutants: setup       ## put MUTANTS faults (drawn by SEED) into the code, one at a time: do tests notice them?
	$(BIN)/python -m tests.mutants sample --number $(MUTANTS) --seed $(SEED)

mutants-again: setup ## put five of the stored faults into the code again
	$(BIN)/python -m tests.mutants again --number 5

results-hash: setup  ## compare hashes of all results with the stored ones, or of some: ONLY=runs
	$(BIN)/python -m tests.results_hash --only $(ONLY)

soak: setup          ## MINUTES of random commands (drawn by SEED) with kills, a full disk, lost workers: is anything lost?
	$(BIN)/python -m tests.soak --minutes $(MINUTES) --seed $(SEED)

$(BENCH): $(STAMP)
	$(INSTALL) '.[bench]'
	@touch $(BENCH)

bench: $(BENCH)      ## run the benchmarks; fails where a ratio grew by a fifth
	$(BIN)/python -m pytest tests/benchmarks --benchmark-enable --benchmark-only -p no:xdist

bench-keep: setup    ## measure the ratios of docs/results/benchmarks.md and add them there
	READHESION_KEEP_BENCHMARKS=1 $(BIN)/python -m pytest tests/benchmarks/test_history.py --benchmark-enable -p no:xdist

wheel: setup         ## build dist/*.whl with what RUNS compile for processors of LEVELS, so that nobody waits for it
	rm -rf build/kernels build/lib dist alloc/kernels && mkdir -p alloc/kernels
	for level in $(LEVELS); do \
	  READHESION_CACHE=build/kernels/$$level NUMBA_CPU_NAME=$$level NUMBA_CPU_FEATURES= $(BIN)/readhesion compare $(RUNS) \
	    --seeds 1 --out build/kernels/$$level > /dev/null && \
	  cp build/kernels/$$level/readhesion/code/kernel-* alloc/kernels || exit; \
	done
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist . && rm -rf build/kernels build/lib alloc/kernels

keys: setup          ## write docs/keys.md, the reference of all keys of files
	$(BIN)/readhesion schema --reference --out docs/keys.md

lint: setup          ## style
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

types: setup         ## static types
	$(BIN)/mypy

clean:               ## remove the environment and every result
	rm -rf $(VENV) build dist *.egg-info results figures report.html docs/_generated
