# Everything a reader, a student, an instructor or a contributor runs. `make help` lists it.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help env book instructor-book test labs grade release mutations replications bench bench-grading peers lint lock clean

PYTHON ?= python3
BIN := .venv/bin
ENV := .venv/.made
PEERS := .venv-peers
SITE := book/_build/html
EDITION := build/instructors
# What the tests look at: their own folder, every solution and every lab, each notebook in one worker.
CHECKS := tests $(wildcard solutions) $(wildcard labs)
WORKERS ?= 2

# The same sources give the same bytes: dates in the site and in figures come from here.
export SOURCE_DATE_EPOCH ?= 1767225600
export PYTHONHASHSEED ?= 0
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Pages and tests run as many at a time as there are cores: threads of BLAS would only be in their way.
book instructor-book test replications: export OPENBLAS_NUM_THREADS ?= 1
book instructor-book test replications: export OMP_NUM_THREADS ?= 1
export JUPYTER_PLATFORM_DIRS := 1
# The book chooses its own backend, and an environment elsewhere must not leak into this one.
unexport MPLBACKEND PYTHONPATH PYTHONHOME VIRTUAL_ENV

help: ## list the commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# Compiled at once, as pip does it: the grader's sandbox may not write, and would compile at every start.
$(ENV): requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit(1)' 2>/dev/null || { \
	  echo "Pendulab needs Python 3.11 or newer, and '$(PYTHON)' is $$($(PYTHON) --version 2>/dev/null || echo not there)." \
	       "Name a newer one: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "'$(PYTHON)' comes without the venv module. On Debian and Ubuntu: sudo apt install python3-venv" >&2; exit 1; }
	@echo "Making the environment .venv ($$($(PYTHON) --version)) ..."
	@[ -x $(BIN)/python ] && $(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	@$(BIN)/python -m pip install --quiet "$$(grep '^uv==' requirements.txt)"
	@$(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python -r requirements.txt
	@$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation -e .
	@touch $@

env: $(ENV) ## make or renew the environment in .venv

# --all reads every page again, because a second -W build would hide the warnings of the first.
# Chapters run only when they or the package changed, as many at a time as there are cores.
book: $(ENV) ## build the book and say where it lies
	@rm -f book/_build/finished && mkdir -p book/_build && touch book/_build/started
	@$(BIN)/python book/_ext/run_pages.py
	$(BIN)/jupyter-book build --all -W -n --keep-going book/
	@mv book/_build/started book/_build/finished
	@printf '\nThe book is built. Open it in a browser:\n  file://%s/$(SITE)/index.html\n\n' "$$PWD"

# The same sources and runs, and one part more: rubrics, known mistakes, solutions. Not for students.
instructor-book: $(ENV) ## build the instructors' edition, with rubrics and solutions
	@$(BIN)/python book/_ext/run_pages.py
	@$(BIN)/python book/_ext/pendulab_edition.py $(EDITION)
	$(BIN)/jupyter-book build --all -W -n --keep-going --toc $(CURDIR)/$(EDITION)/_toc.yml --config $(EDITION)/_config.yml \
	  --path-output $(EDITION) book/
	@printf '\nThe instructors'\'' edition is built. Open it in a browser:\n  file://%s/$(EDITION)/_build/html/index.html\n\n' "$$PWD"

lint: $(ENV) ## style of the code
	$(BIN)/ruff check .

# One run of pytest over everything, style included. A book that does not build fails it too: its tests say so.
test: $(ENV) ## run every check of the project
	@$(MAKE) --no-print-directory book || echo "The book does not build; the tests go on and will say so." >&2
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadscope \
	  --nbval --nbval-current-env --nbval-sanitize-with tests/sanitize.cfg $(CHECKS)

mutations: $(ENV) ## apply every seeded defect to a copy of the package and see that its test notices
	$(BIN)/python tests/mutations/run.py

# Every run time and all memory that the book shows, against whoever is installed. One thread for everybody.
bench: $(ENV) ## measure run times and memory on this machine: a table, and book/bench.json (some minutes)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NPROC=1 \
	  $$([ -x $(PEERS)/bin/python ] && echo $(PEERS)/bin/python || echo $(BIN)/python) tests/bench/measure.py

# Every table and claim of the documents again, with all runs: what the ledger in the book shows.
replications: $(ENV) ## do every replication in full and write book/replications.json (about half an hour)
	$(BIN)/python -m pendulab.replications --full --json book/replications.json

bench-grading: $(ENV) ## grade a class of 1,000, and some of it with nbgrader: notebooks a minute, memory (some minutes)
	$(BIN)/python tests/bench/grading.py

peers: $(PEERS)/.made ## make the environment .venv-peers, in which make bench also times dynamax

$(PEERS)/.made: requirements-peers.txt $(ENV)
	@echo "Making the environment $(PEERS), about 700 MB ..."
	@$(BIN)/uv venv --quiet --clear --python $(BIN)/python $(PEERS)
	@$(BIN)/uv pip install --quiet --compile-bytecode --python $(PEERS)/bin/python -r requirements-peers.txt
	@$(BIN)/uv pip install --quiet --python $(PEERS)/bin/python --no-deps --no-build-isolation -e .
	@touch $@

labs: $(ENV) ## open JupyterLab on the labs
	$(BIN)/jupyter lab $(if $(filter 0,$(shell id -u)),--allow-root) labs

grade: $(ENV) ## grade a folder of notebooks, or go on: make grade SUBMISSIONS=folder OUT=folder [ARGS=--lab=name]
	@[ -n "$(SUBMISSIONS)" ] && [ -n "$(OUT)" ] || { \
	  echo "Say what to grade and where the results go: make grade SUBMISSIONS=folder OUT=folder" >&2; exit 2; }
	$(BIN)/pendulab grade run "$(SUBMISSIONS)" "$(OUT)" $(ARGS)

release: $(ENV) ## generate labs/ from solutions/
	$(BIN)/pendulab release

# The peers of `make bench` stay out of the one environment; theirs takes the same versions of what both have.
lock: $(ENV) ## pin requirements.txt again from the ranges in pyproject.toml
	$(BIN)/uv pip compile --universal --python-version 3.11 --extra book --extra labs --extra grading --extra cluster --extra test --extra build --no-annotate pyproject.toml -o requirements.txt
	$(BIN)/uv pip compile --universal --python-version 3.11 --extra peers --extra cluster --extra test --extra build -c requirements.txt --no-annotate pyproject.toml -o requirements-peers.txt

clean: ## remove what was built; the environment stays
	rm -rf book/_build book/labs build .pytest_cache .ruff_cache
	find src tests book .ci -name __pycache__ -type d -prune -exec rm -rf {} +
