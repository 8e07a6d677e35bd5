# Everything a person types. A virtual environment in .venv is made and kept up to date by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
STORE ?= store
PRESET ?= quick
# One compute thread per process: on a few cores more of them slow each other down.
export OMP_NUM_THREADS ?= 1
# Freed memory is kept for the next training step instead of given back to the system (glibc).
export MALLOC_MMAP_MAX_ ?= 0
export MALLOC_TRIM_THRESHOLD_ ?= 1073741824

.PHONY: reference install reproduce test test-all chaos bench lint format clean

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "dmfc needs Python 3.11 or newer; try: make PYTHON=python3.12 install"; exit 1; }
	$(BIN)/python -m pip install --quiet --upgrade "pip>=23.1"
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	@touch $@

# Tables I and II: trains and evaluates every cell; goes on where an earlier call stopped. Then says
# of each row whether it agrees with what we measured (of the quick preset).
reproduce: install
	$(BIN)/dmfc sweep table1 table2 --preset $(PRESET) --store $(STORE)
	@test "$(PRESET)" != quick || $(BIN)/dmfc agree results/quick table1 table2 --store $(STORE)

# Pages of docs/reference that are made from the code; a test says when they are old.
reference: install
	$(BIN)/python -m dmfc.cli.reference docs/reference

# Everything that needs Python packages alone.
test: install
	$(BIN)/python -m pytest -m "not full and not chaos"

# And what needs a browser, or minutes.
test-all: install
	$(BIN)/python -m pytest -m "not chaos"

# Kills workers, nodes, heads and drivers under sweeps on clusters on this machine, cuts links between
# nodes and the power of disks (as root, with iproute2).
chaos: install
	$(BIN)/python -m pytest tests/chaos

bench: install
	$(BIN)/python -m pytest tests/benchmarks/bench_*.py --benchmark-only

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: install
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
