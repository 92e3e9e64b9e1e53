# `make run`: the main job on the bundled session. `make test`: everything that must hold.
# Both make the environment first; a machine needs Python >= 3.11 and make.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

.PHONY: run test lint study bench fuzz clean

run: $(VENV)/installed
	$(BIN)/wireloc run runs/samples/building_a

test: lint
	$(BIN)/python -m pytest -n auto --dist loadfile

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

study: $(VENV)/installed
	$(BIN)/python -m pytest -m slow

bench: $(VENV)/installed
	$(BIN)/python -m pytest tests/benchmarks --benchmark-only

fuzz: $(VENV)/installed
	$(BIN)/python tests/fuzz --seconds 60

$(VENV)/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("wireloc needs Python 3.11 or newer: make PYTHON=python3.12") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) results *.egg-info .pytest_cache .mypy_cache .ruff_cache
