# make demo   the main job on a sample log
# make test   everything that must hold: style, types, tests; of long ones every second to fifth case, and of some long files every second or third test; all with ALL=1
# make man    manual pages of all commands, in build/man
# make bench  speed, beside a reference in the same run
# make fuzz SECONDS=3600   hostile logs, rigs and models without end: no crash, no hang, no memory beyond 1 GB
# make battery SEED=1   hidden effects, and how many of them the diagnosis finds
# make battery FAMILY=messy SEED=3 [ENGINE=mujoco] [CASES=60]   the table of one family
# make limits [ONLY=readers/] [WORKERS=2]   each number that a module names, doubled and halved: which changes a test notices

PYTHON ?= python3
VENV ?= .venv
SEED ?= 1
SECONDS ?= 3600
WORKERS ?= 1
BIN = $(VENV)/bin
BATTERY = --out battery$(addprefix /,$(firstword $(FAMILY))$(ENGINE:%=-%)) $(FAMILY:%=--kind %) $(ENGINE:%=--engine %) $(CASES:%=--cases %)
IMPORTED = numba llvmlite numpy scipy pyarrow pandas msgspec rosbags distributed dask
MAKEFLAGS += --no-print-directory
# Tests start many processes: what one has compiled the next ones load, also where the environment says otherwise.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test lint man bench battery fuzz limits samples clean

demo: $(VENV)/.demo
	@$(BIN)/vsalog warm estimate
	@$(BIN)/vsalog inspect sample_logs/vsa2_exp1.mcap
	@mkdir -p demo
	@$(BIN)/vsalog estimate sample_logs/vsa2_exp1.mcap -o demo/
	@echo
	@echo "The stiffness trace is in demo/vsa2_exp1.stiffness.parquet, the fitted model in demo/vsa2_exp1.model.toml."
	@echo "Next: $(BIN)/vsalog init YOUR_LOG > rig.toml, look it over, $(BIN)/vsalog estimate YOUR_LOG --rig rig.toml"

test: lint
	$(BIN)/python -m pytest -n 2 --dist worksteal $(ALL:%=--all-cases)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.bench
	$(BIN)/python -m benchmarks.recursions

battery: $(VENV)/.test
	$(BIN)/python -m tests.hidden_effects.battery --seed $(SEED) $(BATTERY)

fuzz: $(VENV)/.fuzz
	$(BIN)/python tests/fuzz/run_fuzz.py --seconds $(SECONDS)

limits: $(VENV)/.test
	$(BIN)/python -m tests.limits.run --only '$(ONLY)' --workers $(WORKERS)

man: $(VENV)/.demo
	$(BIN)/python -m docs.make_man build/man

samples: $(VENV)/.test
	$(BIN)/python -m vsalog.simulation.samples sample_logs

clean:
	rm -rf $(VENV) demo battery .fuzz .limits build dist *.egg-info .pytest_cache .mypy_cache .import_linter_cache .ruff_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit("vsalog needs Python 3.11 or newer; name one: make PYTHON=python3.12" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.test: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[test,dev]'
	@# Of all that is installed, what the processes of the tests import most; the rest is compiled as it is needed.
	@cd $(VENV)/lib/python3*/site-packages && ../../../bin/python -m compileall -q -j 2 $(IMPORTED)
	@touch $@ $(VENV)/.demo

$(VENV)/.bench: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,benchmark]'
	@touch $@

$(VENV)/.fuzz: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,fuzz]'
	@touch $@
