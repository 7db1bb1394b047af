# make run, test, test-long, coverage, bench, bench-long, lint, docs, dist: each sets up first what it needs, once.
# Needs Python 3.11 or newer (make PYTHON=...), make and a C compiler.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
# Python compiles a module at its first import: most of what is installed never is.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt
TORCH := $(shell sed -n 's/^torch==/torch==/p' constraints.txt)

export OMP_NUM_THREADS ?= 1

.PHONY: run test test-long coverage docs dist bench bench-long lint setup graphics clean

run: setup
	$(BIN)/python -m sim2real +experiment=esmaml

# Two files of tests side by side.
test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-long: setup $(VENV)/.engines $(VENV)/.gpu $(VENV)/.spread $(VENV)/.mjlab
	SIM2REAL_GPU_EXTRA=1 $(BIN)/python -m pytest -m slow

# The default suite, each branch counted; pyproject.toml says of what.
coverage: setup
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n 2 --dist loadfile
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

bench: $(VENV)/.bench graphics
	$(BIN)/python -m benchmarks

bench-long: $(VENV)/.bench graphics
	$(BIN)/python -m benchmarks --long

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --threads

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build

# Wheel and source distribution, in dist/.
dist: setup
	$(PIP) hatchling
	$(BIN)/python -m hatchling build

setup: $(VENV)/.installed graphics

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# torch comes first and by its number: asked for by name alone, pip may pull gigabytes of CUDA libraries with it.
$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) $(TORCH)
	$(PIP) --editable '.[dev]'
	@touch $@

# Drake and DART have no wheels for every machine: without them their tests are skipped, and say so.
$(VENV)/.engines: $(VENV)/.installed
	$(PIP) --editable '.[dev,engines]' || echo "no Drake or DART for this machine: their tests are skipped"
	@touch $@

# MuJoCo Warp, whose CPU device the tests use; its kernels' cache is in $(VENV), too.
$(VENV)/.gpu: $(VENV)/.installed
	$(PIP) --editable '.[dev,gpu]'
	@touch $@

# Ray, Hydra's launcher for Slurm, and a library of other worlds.
$(VENV)/.spread: $(VENV)/.installed
	$(PIP) --editable '.[dev,ray,submitit,worlds]'
	@touch $@

# mjlab asks for another MuJoCo: an environment of its own, in which a test loads what is exported to it.
$(VENV)/.mjlab: $(VENV)/.installed
	$(PYTHON) -m venv $(VENV)/mjlab
	$(VENV)/mjlab/bin/python -m pip install --quiet --disable-pip-version-check $(TORCH) mjlab==1.6.0
	@touch $@

$(VENV)/.bench: $(VENV)/.installed
	$(PIP) --editable '.[dev,bench]'
	@touch $@

$(VENV)/.docs: $(VENV)/.installed
	$(PIP) --editable '.[dev,docs]'
	@touch $@

# Rendering off screen needs EGL or OSMesa from the system; everything else works without.
graphics:
	@if PATH="$$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -Eq 'libEGL\.so|libOSMesa\.so' || [ "$$(uname)" != Linux ]; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  echo "Installing libegl1 and libgl1-mesa-dri for off-screen rendering"; \
	  { apt-get -qq update && DEBIAN_FRONTEND=noninteractive \
	    apt-get -qq install -y --no-install-recommends libegl1 libgl1-mesa-dri >/dev/null; } \
	  || echo "That failed; videos and rendering tests are left out until libegl1 and libgl1-mesa-dri are there."; \
	else echo "For videos install EGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri); the rest works without."; fi

clean:
	rm -rf $(VENV) build dist .coverage .coverage.* .pytest_cache .ruff_cache
