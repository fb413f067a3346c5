# psafit. `make` lists what can be made; options stand behind the target: make fit GROUP=1 OUT=fits/mine
#
# Every target sets up what it needs in .venv, from the lock files, and only when those changed.

PYTHON   ?=
EXP      ?= experiments/psa
GROUP    ?= 1
OUT      ?=
TERMS    ?=
SEED     ?=
RUN      ?= fits/psa-group1
JOBS     ?= 2
ARGS     ?=
LIMIT    ?=
DESIGNS  ?=
CASES    ?=
KILLS    ?=
UV       ?= uv
UPGRADE  ?=
QUICK    ?=

# make itself would take group=3 without a word, and fit GROUP's default.
$(foreach name,python exp group out terms seed run jobs args limit designs cases kills quick,$(if $(filter command line,$(origin $(name))),\
    $(error names are written in capitals: $(shell echo $(name) | tr a-z A-Z)=$($(name)))))

# Threads of the linear algebra library only wait for each other on our small matrices.
export OPENBLAS_NUM_THREADS ?= 1
# Each of our processes would compile all of psafit anew: a second, of tests some hundred times.
unexport PYTHONDONTWRITEBYTECODE

SHELL       := /bin/bash
MAKEFLAGS   += --no-print-directory
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check -qq --no-input
STAMP  := $(VENV)/.installed
# pip would compile every module there is, which is half of its time; Python compiles what is used, once.
INSTALL = $(PIP) install --no-compile --require-hashes -r
PSAFIT := $(BIN)/psafit
PYTEST = $(BIN)/python -m pytest -n $(JOBS) --dist worksteal
# A value as one shell word, whatever it holds: quoted, spaced, or empty.
quoted  = '$(subst ','\'',$(1))'
option  = $(if $(strip $(2)),$(1) $(call quoted,$(2)))

.PHONY: help setup fit validate diagnose sbc reproduce test test-slow test-all coverage fuzz kills lint types bench null-leads challenge docs docs-figures notebooks lock clean

help: ## List the targets
	@echo 'make TARGET [NAME=value ...]'
	@awk -F ' *## *' '/^[a-z-]+:.* ## / { sub(/:.*/, "", $$1); printf "  %-13s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
	@echo 'PYTHON=/path/to/python3 chooses the interpreter of a new .venv (3.11, 3.12 or 3.13).'

setup: $(STAMP)-run ## Make the environment .venv alone
	@echo 'ready: $(PSAFIT) --help'

fit: $(STAMP)-run ## Fit, sample, validate, report: GROUP=1 or 1,2 [OUT=dir] [EXP=folder] [TERMS=a,b] [SEED=n]
	@$(PSAFIT) fit $(call quoted,$(EXP)) --group $(call quoted,$(GROUP)) \
	    $(call option,--terms,$(TERMS)) $(call option,--out,$(OUT)) $(call option,--seed,$(SEED))

validate: $(STAMP)-run ## Score a fit on the groups it never saw: [RUN=fits/psa-group1]
	@$(PSAFIT) validate $(call quoted,$(RUN))

diagnose: $(STAMP)-run ## What is wrong, why, and what is gained: [GROUP=1] [QUICK=1] [JOBS=n] [OUT=dir] [EXP=folder] [SEED=n]
	@$(PSAFIT) diagnose $(call quoted,$(EXP)) $(if $(filter file,$(origin GROUP)),,$(call option,--group,$(GROUP))) \
	    $(if $(filter-out 0,$(QUICK)),--quick) $(call option,--out,$(OUT)) $(call option,--seed,$(SEED)) \
	    $(if $(filter file,$(origin JOBS)),,$(call option,--jobs,$(JOBS)))

sbc: $(STAMP)-run ## Simulation-based calibration of the posteriors, with rank plots in docs/figures: [SEED=n] [ARGS=...]
	@$(BIN)/python benchmarks/sbc.py $(call option,--seed,$(SEED)) $(ARGS)

reproduce: $(STAMP)-run ## Repeat the study's own tables and say where they come out otherwise
	@$(PSAFIT) reproduce

test: $(STAMP)-dev ## Run the tests but those marked slow, five to ten minutes on two cores: [JOBS=2] [ARGS='-k name']
	@$(PYTEST) $(ARGS)

test-slow: $(STAMP)-dev ## Run the tests marked slow, whole fits, diagnoses and campaigns: [JOBS=2] [ARGS='-k name']
	@$(PYTEST) -m slow $(ARGS)

test-all: $(STAMP)-dev ## Run all tests: [JOBS=2] [ARGS='-k name']
	@$(PYTEST) -m '' $(ARGS)

coverage: $(STAMP)-dev ## Which lines of psafit/ no test runs: [JOBS=2] (all tests; a quarter of an hour)
	@$(BIN)/python -m coverage erase
	@# A full disk and a Ctrl-C in mid-step meet the tracer, too: those two tests may fail, and leave a damaged file.
	-@$(BIN)/python -m coverage run -m pytest -m '' -n $(JOBS) --dist worksteal $(ARGS)
	-@$(BIN)/python -m coverage combine -q
	@$(BIN)/python -m coverage report

fuzz: $(STAMP)-dev ## Hostile files and options by the thousand: [CASES=10000] [SEED=n]
	@$(BIN)/python tests/fuzz.py $(call option,--cases,$(CASES)) $(call option,--seed,$(SEED))

kills: $(STAMP)-dev ## Kill -9 fits, diagnoses and campaigns at random moments: [KILLS=27 of each] [SEED=n]
	@$(BIN)/python tests/kills.py $(call option,--kills,$(KILLS)) $(call option,--seed,$(SEED))

lint: $(STAMP)-tools ## Check style and formatting
	@$(BIN)/python -m ruff check .
	@$(BIN)/python -m ruff format --check .

types: $(STAMP)-tools ## Check the types
	@$(BIN)/python -m mypy psafit

bench: $(STAMP)-bench ## Measure speed and accuracy; writes benchmarks/latest.json
	@$(BIN)/python benchmarks/run.py

null-leads: $(STAMP)-run ## Work out how far chance leads where nothing is hidden, half an hour of a core: [SEED=n] [ARGS=...]
	@$(BIN)/python benchmarks/null_leads.py $(call option,--seed,$(SEED)) $(ARGS)

challenge: $(STAMP)-run ## Hide effects, diagnose, score: [SEED=n] [JOBS=2] [LIMIT=n data sets] [DESIGNS=n] [OUT=fits/challenge] [EXP=folder]
	@$(BIN)/python benchmarks/challenge.py --experiment $(call quoted,$(EXP)) --jobs $(call quoted,$(JOBS)) \
	    $(call option,--seed,$(SEED)) $(call option,--limit,$(LIMIT)) $(call option,--designs,$(DESIGNS)) $(call option,--out,$(OUT))

docs: $(STAMP)-docs ## Build the pages of the docs into site/, to be read from there; a warning is an error
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo 'ready: site/index.html'

notebooks: $(STAMP)-dev ## Set up what the notebooks in docs/notebooks need
	@echo 'ready: open docs/notebooks in Jupyter or an editor, with the Python of $(BIN) as its kernel'

docs-figures: $(STAMP)-dev ## Draw the figures of the docs anew, run the tutorial: half an hour, after make fit and make diagnose
	@for script in docs/make_*.py; do \
	    [ -e "$$script" ] || { echo 'no figure scripts: docs/make_*.py'; break; }; \
	    echo "$$script"; $(BIN)/python "$$script" || exit; done

lock: ## Resolve the lock files anew with uv: [UPGRADE=1] takes newer releases
	@command -v $(call quoted,$(UV)) >/dev/null || { echo 'make lock needs uv: pip install uv, or UV=/path/to/uv' >&2; exit 2; }
	$(call resolve,requirements.lock)
	$(call resolve,requirements-dev.lock,--extra dev -c requirements.lock)
	$(call resolve,requirements-bench.lock,--extra bench -c requirements.lock)
	$(call resolve,requirements-docs.lock,--extra docs -c requirements.lock -c requirements-dev.lock)

clean: ## Remove .venv and the caches (never fits)
	@rm -rf $(VENV) build dist site *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find psafit tests docs benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# $(call resolve,lock,options): one lock for every platform and Python; no address and no path of this machine in it.
define resolve
@echo $(1)
@$(call quoted,$(UV)) pip compile --quiet --universal --python-version 3.11 --generate-hashes \
    --no-header --no-emit-index-url --no-emit-find-links $(if $(UPGRADE),--upgrade) $(2) pyproject.toml -o $(1)
@sed -i '1i # Made by `make lock` from pyproject.toml; not edited by hand.' $(1)
endef

# --- the environment -------------------------------------------------------------------------------------------------
# A stamp is written last, so an interrupted set-up leaves none; it holds the folder's path, so a moved or copied
# folder (whose scripts and links still point to the old place) is set up again.
ifneq ($(shell cat $(STAMP)-base 2>/dev/null),$(CURDIR))
.PHONY: $(STAMP)-base
endif

$(STAMP)-base: requirements.lock pyproject.toml
	@rm -f $(STAMP)-*
	@$(make_venv)
	@echo 'Installing what psafit runs on into $(VENV): one to six minutes, by the network, once; 650 MB of disk'
	@$(INSTALL) requirements.lock
	@$(PIP) install --no-deps -e .
	@printf '%s' "$$PWD" > $@

$(STAMP)-run: $(STAMP)-base
	@echo 'Compiling the simulator: half a minute to a minute, once'
	@$(BIN)/python -m psafit.simulate
	@touch $@

$(STAMP)-tools: requirements-dev.lock $(STAMP)-base
	@echo 'Installing what the tests need into $(VENV): half a minute to three, once; 300 MB of disk'
	@$(INSTALL) requirements-dev.lock
	@touch $@

# Compiled while tools are fetched, where make runs both at once.
$(STAMP)-dev: $(STAMP)-run $(STAMP)-tools
	@touch $@

$(STAMP)-bench: requirements-bench.lock $(STAMP)-run
	@echo 'Installing what the benchmarks compare with (jax, diffrax) into $(VENV): half a minute to three, once'
	@$(INSTALL) requirements-bench.lock
	@touch $@

$(STAMP)-docs: requirements-docs.lock $(STAMP)-run
	@echo 'Installing what the docs are made with into $(VENV): about 20 s, once; 150 MB of disk'
	@$(INSTALL) requirements-docs.lock
	@touch $@

# A pyenv shim may be there and yet not run, and Debian's python3 may lack venv: a candidate has to prove itself.
suits := import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
define make_venv
$(BIN)/python -c '$(suits)' 2>/dev/null && $(PIP) --version >/dev/null 2>&1 && exit; \
chosen=; \
for python in $(if $(PYTHON),$(call quoted,$(PYTHON)),python3.13 python3.12 python3.11 python3 python); do \
    if "$$python" -c '$(suits)' 2>/dev/null; then chosen=$$python; break; fi; \
done; \
if [ -z "$$chosen" ]; then \
    echo 'psafit needs a working Python 3.11, 3.12 or 3.13 with venv; $(if $(PYTHON),PYTHON is not one,none found). Install one or name it: make setup PYTHON=/path/to/python3' >&2; \
    exit 2; \
fi; \
rm -rf $(VENV) && "$$chosen" -m venv $(VENV)
endef
