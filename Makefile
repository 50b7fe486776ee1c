# Set up, run the main comparison, test. `make help` lists the targets.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
TOOLS  := $(VENV)/.tools-installed
DOCS   := $(VENV)/.docs-installed
INSTALL = $(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python -c constraints.txt -e
STUDY  ?= claims braking learning readhesion_paper jp4209318 rtri jph07322414 \
  tuning assumptions mpc_parts mpc_settings conditioning optimum measured

# small matrices everywhere: threads of BLAS would wait for each other
export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help setup compare report figures results notebooks docs test bench scaling peers lint types clean

help:      ## list the targets
	@sed -n 's/^\([a-z-]*\): .*## /\1\t/p' $(MAKEFILE_LIST)

$(STAMP): pyproject.toml constraints.txt readhesion.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "readhesion needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt uv
	$(INSTALL) '.[report]'
	@touch $(STAMP)

$(TOOLS): $(STAMP)
	$(INSTALL) '.[test,lint]'
	@touch $(TOOLS)

$(DOCS): $(STAMP)
	$(INSTALL) '.[docs]'
	@touch $(DOCS)

setup: $(TOOLS)      ## create .venv and install (a second call does nothing)

compare: $(STAMP)    ## the main job: every rule with every controller over the shipped slip events
	$(BIN)/readhesion compare

report: compare      ## the same as one page that opens offline: report.html
	$(BIN)/readhesion report

figures: $(STAMP)    ## draw the figures of the papers
	$(BIN)/readhesion figures

results: compare     ## compute the tables of the pages again, or those of one STUDY
	cp results/compare/table.md docs/tables/compare-table.md
	$(BIN)/readhesion benchmark --store docs/tables/benchmark.parquet > /dev/null
	for table in table controllers parts front statements; do cp results/benchmark/$$table.md docs/tables/benchmark-$$table.md; done
	$(BIN)/readhesion benchmark --seed 66 --events 100 --out results/second > /dev/null
	cp results/second/benchmark/table.csv docs/tables/benchmark-second.csv
	for study in $(STUDY); do $(BIN)/readhesion sweep $$study > /dev/null && \
	  for table in table map statements; do test ! -f results/$$study/$$table.md || \
	    cp results/$$study/$$table.md docs/tables/$$study-$$table.md; done || exit; done

notebooks: setup     ## run the notebooks, and store what they print
	$(BIN)/python -m tests.docs.test_notebooks

docs: $(DOCS)        ## build the documentation site into build/docs; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q -b html docs build/docs

test: setup          ## run the tests
	$(BIN)/python -m pytest -n 2

bench: setup         ## what this checkout costs over another: BASE=../other
	$(BIN)/python tests/performance.py $(BASE)

scaling: setup       ## how cost grows: parts of the plant, axles, units, a cluster
	$(BIN)/python tests/scaling.py

peers: setup         ## what other integrators and solvers cost over this project
	$(BIN)/python tests/peers.py

lint: setup          ## style
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

types: setup         ## static types
	$(BIN)/mypy

clean:               ## remove the environment and every result
	rm -rf $(VENV) build dist results figures report.html
