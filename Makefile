# Two commands do everything on a fresh machine: `make run` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: run test check benchmark-diagnosis benchmark-diagnosis-peers clean

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

run: $(VENV)/.installed
	$(BIN)/topdress

test: $(VENV)/.installed
	$(BIN)/python -m pytest -n 2

check: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) test

benchmark-diagnosis: $(VENV)/.installed
	$(BIN)/python benchmarks/diagnosis/run.py --cases 1200 --seed 1 --programmes all --jobs 2 --out docs/benchmark-diagnosis.md $(PEERS)

# The same cases for other methods: `make benchmark-diagnosis-peers [SYSIDENT=PYTHON]`; SysIdentPy wants an environment
# of its own, whose python is given.
benchmark-diagnosis-peers: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[benchmark]'
	$(MAKE) benchmark-diagnosis PEERS="--peers $(if $(SYSIDENT),--sysident $(SYSIDENT))"

clean:
	rm -rf $(VENV)
