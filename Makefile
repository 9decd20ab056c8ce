# make demo   the main job on a sample log: a figure of the stiffness, and a diagnosis of a rig that is wrong
# make test   everything that must hold: style, types, tests; of long ones every second to twentieth case, of long files every second to fourth test; all with ALL=1
# make docs   the documentation as a site, in site/; LINKS=1 tests links to other sites as well
# make dist   wheel and source in dist/, tested as a user has them: a plain installation runs every command of the documentation
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
DEMO = sample_logs/sea_exp1
BATTERY = --out battery$(addprefix /,$(firstword $(FAMILY))$(ENGINE:%=-%)) $(FAMILY:%=--kind %) $(ENGINE:%=--engine %) $(CASES:%=--cases %)
# Tests of the sdist that a plain installation passes: they need pytest and hypothesis alone.
PLAIN = tests/test_snippets.py tests/core tests/filters tests/mechanics
# Words that the project has better ones for (docs/vocabulary.txt), also of two parts, and the files that are checked for them.
WORDS = (?:left over|leaves over|borne out|how sure|stands? alone|[\w-]+)
PROSE = README.md CONTRIBUTING.md docs benchmarks/README.md sample_logs/README.md vsalog
TEXTS = *.json,__pycache__,./docs/vocabulary.txt,docs/vocabulary.txt
IMPORTED = numba llvmlite numpy scipy pyarrow pandas msgspec rosbags distributed dask
MAKEFLAGS += --no-print-directory
# Tests start many processes: what one has compiled the next ones load, also where the environment says otherwise.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test lint docs man dist bench battery fuzz limits samples clean

demo: $(VENV)/.demo
	@$(BIN)/vsalog warm estimate diagnose --preset sea
	@$(BIN)/vsalog inspect $(DEMO).csv
	@mkdir -p demo
	@$(BIN)/vsalog estimate $(DEMO).csv -o demo/
	@$(BIN)/vsalog plot demo/$(notdir $(DEMO)).stiffness.parquet -o demo/stiffness.pdf --force
	@# What a data sheet could say of this joint, whose spring hardens: the rig leaves that out, and the diagnosis finds it.
	@$(BIN)/vsalog diagnose $(DEMO).csv --set joint.sea.transmission='{ type = "linear", stiffness = "20 N*m/rad" }' -o demo/ --force
	@echo
	@echo "The figure of the stiffness is in demo/stiffness.pdf, the page of the diagnosis in demo/diagnosis.html."
	@echo "Next: $(BIN)/vsalog init YOUR_LOG -o rig.toml, look it over, $(BIN)/vsalog estimate YOUR_LOG --rig rig.toml"

test: lint
	$(BIN)/python -m pytest -n 2 --dist worksteal $(ALL:%=--all-cases)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell
	$(BIN)/codespell --dictionary docs/vocabulary.txt --regex '$(WORDS)' --skip '$(TEXTS)' $(PROSE) vsalog
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-actions action.yml

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going -q -b html -d site/.doctrees docs site
	$(BIN)/python -m sphinx --fail-on-warning --keep-going -q -b doctest -d site/.doctrees docs site/.doctest
	$(if $(LINKS),$(BIN)/python -m sphinx -q -b linkcheck docs site/.links)
	@echo "The site begins at site/index.html."

dist: $(VENV)/.dist
	rm -rf dist build
	$(BIN)/python -m build --outdir dist .
	$(BIN)/python -m twine check --strict dist/*
	$(PYTHON) -m venv build/venv
	build/venv/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl pytest hypothesis
	mkdir build/source && tar -xf dist/*.tar.gz -C build/source --strip-components 1
	cd build/source && ../venv/bin/pytest --all-cases $(PLAIN)

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
	rm -rf $(VENV) demo battery site .fuzz .limits build dist *.egg-info .pytest_cache .mypy_cache .import_linter_cache .ruff_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit("vsalog needs Python 3.11 or newer; name one: make PYTHON=python3.12" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: $(VENV)/bin/python pyproject.toml
	@# Python compiles what is imported; all that is installed takes a quarter of a minute longer.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e .
	@touch $@

$(VENV)/.test: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[test,dev]'
	@# Of all that is installed, what the processes of the tests import most; the rest is compiled as it is needed.
	@cd $(VENV)/lib/python3*/site-packages && ../../../bin/python -m compileall -q -j 2 $(IMPORTED)
	@touch $@ $(VENV)/.demo

$(VENV)/.docs: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	@touch $@

$(VENV)/.dist: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'build>=1.2' 'twine>=6.1'
	@touch $@

$(VENV)/.bench: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,benchmark]'
	@touch $@

$(VENV)/.fuzz: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,fuzz]'
	@touch $@
