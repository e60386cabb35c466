# make demo: the whole loop on a virtual sensor, from a fresh machine with Python >= 3.11 and make.
# make test: everything the tests need, then the tests.
# make smoke: a minute; make test-changed: the tests that the changes since main can reach.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo docs linkcheck test smoke test-changed test-slow test-browser test-torch test-raws real-frames test-faults test-kills test-power test-full-disk test-races fuzz audit install lint format clean

demo: $(VENV)/installed
	$(BIN)/photosite demo --output photosite-demo

# The documentation site, in docs/_build/html: about ten minutes at first, a minute when notebooks and gallery are cached.
# Warnings are errors, broken links inside the site among them. make linkcheck tries the links to other sites.
docs: $(VENV)/installed-docs
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

linkcheck: $(VENV)/installed-docs
	$(BIN)/python -m sphinx -W --keep-going -b linkcheck docs docs/_build/linkcheck

# One process for each core, with one BLAS thread. A file stays in one process, which computes its fixtures once.
# Compiled modules are kept even where the environment forbids it: commands in separate processes start faster, and
# the next run collects in a third of the time.
PYTEST := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test: $(VENV)/installed-dev
	$(PYTEST)

# One path through each command and each public name: the tests with the marker, and the examples of the public names.
smoke: $(VENV)/installed-dev
	$(PYTEST) -m smoke $$(grep -rl --include='test_*.py' 'mark.smoke("' tests) src

# The tests of the modules that import, directly or not, what changed since BASE.
BASE ?= main
test-changed: $(VENV)/installed-dev
	$(PYTEST) $$($(BIN)/python tests/changed.py $(BASE))

# The statistical studies that make test leaves out: minutes to an hour.
test-slow: $(VENV)/installed-dev
	$(PYTEST) -m slow

# The page of `photosite serve` in Chromium, with axe-core. PICTURES=folder keeps screenshots. Chromium is the system's
# (apt-get install chromium); without it, or without npm, tests are skipped with a message.
test-browser: $(VENV)/installed-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check playwright
	-npm install --silent --no-audit --no-fund --no-save --prefix $(VENV)/axe axe-core@4
	$(BIN)/python -m pytest -m browser tests/browser

# Damaged and hostile files and command lines: make fuzz INPUTS=1000000, make fuzz SECONDS_IN_ALL=60, or both, and the
# first limit that is reached counts. On one core.
INPUTS ?= 150000
fuzz: $(VENV)/installed-dev
	nice -n 10 $(BIN)/python tests/fuzz/run.py --inputs $(INPUTS) $(if $(SECONDS_IN_ALL),--seconds $(SECONDS_IN_ALL))

# Known advisories of the installed packages, from PyPI; fails with the reason where they cannot be asked for.
audit: $(VENV)/installed-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-audit
	$(BIN)/python tests/audit.py

# Tests with PyTorch: a build for the CPU is enough; TORCH names another requirement for pip. Without one, the tests that
# need it are skipped.
TORCH ?= torch==2.13.0
test-torch: $(VENV)/installed-dev
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check '$(TORCH)'
	$(PYTEST) -rs tests/training tests/camera/test_signal_model.py

# Read, develop and calibrate a user's own raw files, with a table to send: make test-raws FOLDER=~/pictures
test-raws: $(VENV)/installed
	@test -n "$(FOLDER)" || { echo "usage: make test-raws FOLDER=folder of raw files"; exit 2; }
	$(BIN)/python tests/raws/raw_folder.py "$(FOLDER)"

# Public sets of real frames: docs/validation/real-frames.md, made anew
real-frames: $(VENV)/installed-dev
	@test -n "$(DATA)" || { echo "usage: make real-frames DATA=folder of the public sets"; exit 2; }
	$(BIN)/python tests/raws/real_frames.py --data "$(DATA)"

# Commands that write, while the system fails them (docs/validation/durability.md): MOST tries of each kind for a command.
MOST ?= 40
test-faults test-kills test-power test-full-disk test-races: test-%: $(VENV)/installed-dev
	nice -n 10 $(BIN)/python tests/faults/run.py $* --most $(MOST)

install: $(VENV)/installed

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/installed-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) photosite-demo docs/_build docs/gallery docs/reference/api docs/reference/commands docs/reference/diagnostics docs/reference/examples .pytest_cache .mypy_cache .ruff_cache

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "photosite needs Python 3.11 or newer, this is %d.%d; say: make PYTHON=python3.11 ..." % sys.version_info[:2])'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

$(VENV)/installed-docs: pyproject.toml $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@
