# Two commands do everything on a fresh machine: `make run` and `make test`. `make exam` is what takes long of the tests.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: run test exam check lock licences release benchmark-diagnosis benchmark-diagnosis-peers clean

# Exactly the packages of the lock file, by their hashes; nothing else is fetched, not even to build.
$(VENV)/.installed: pyproject.toml requirements/dev.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements/dev.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

run: $(VENV)/.installed
	$(BIN)/topdress

test: $(VENV)/.installed
	$(BIN)/python -m pytest -n 2

# Hidden examinations, long logs, many kills, minutes of odd files: tests marked `exam`.
exam: $(VENV)/.installed
	$(BIN)/python -m pytest -n 2 -m exam

check: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) test

# The tools of the three below have an environment of their own.
TOOLS := .venv-tools/bin
.venv-tools/.installed: requirements/tools.in
	$(PYTHON) -m venv .venv-tools
	$(TOOLS)/python -m pip install --quiet --requirement requirements/tools.in
	touch $@

# Newest versions that the lower bounds allow, for every system and Python from 3.11 on.
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --upgrade \
	--index-strategy unsafe-best-match --custom-compile-command "make lock"
lock: .venv-tools/.installed
	$(TOOLS)/$(LOCK) pyproject.toml requirements/build.in --extra dev --output-file requirements/dev.txt
	$(TOOLS)/$(LOCK) pyproject.toml --extra report --extra serve --extra fleet --output-file requirements/run.txt

# Who wrote what the program needs, under which licence (docs/licences.md is made by this).
licences: .venv-tools/.installed
	.ci/licences

# `make release TAG=v0.1.0`: wheel, bill of materials and licences in dist/, tried in a fresh environment.
release: .venv-tools/.installed
	.ci/release $(TAG)

benchmark-diagnosis: $(VENV)/.installed
	$(BIN)/python benchmarks/diagnosis/run.py --cases 1200 --seed 1 --programmes all --jobs 2 --out docs/benchmark-diagnosis.md $(PEERS)

# The same cases for other methods: `make benchmark-diagnosis-peers [SYSIDENT=PYTHON]`; SysIdentPy wants an environment
# of its own, whose python is given.
benchmark-diagnosis-peers: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[benchmark]'
	$(MAKE) benchmark-diagnosis PEERS="--peers $(if $(SYSIDENT),--sysident $(SYSIDENT))"

clean:
	rm -rf $(VENV) .venv-tools .venv-release dist
