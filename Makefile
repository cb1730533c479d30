# Two commands do everything on a fresh machine: `make run` and `make test`. `make exam` is what takes long of the tests.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: run test exam check lock docs licences release benchmark-diagnosis clean

# Exactly the packages of the lock files, by their hashes; nothing else is fetched, not even to build. pip tells what it
# fetches: a first start takes minutes.
PIP := $(BIN)/python -m pip install --disable-pip-version-check
# Modules are compiled by Python where they are first imported: all of them would take half of the time and 80 MB.
LOCKED := $(PIP) --require-hashes --no-compile --requirement

# The whole mission: console, worker, diagnosis, import, reports, maps of the common kinds, replay, simulation; `topdress
# extras` says the rest.
$(VENV)/.program: pyproject.toml requirements/build.txt requirements/run.txt
	@echo "Setting up $(VENV) for topdress, once: some 130 MB to fetch, 500 MB on the disk"
	$(PYTHON) -m venv $(VENV)
	$(LOCKED) requirements/build.txt
	$(LOCKED) requirements/run.txt
	$(PIP) --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q console control drivers
	@touch $@

# And every extra, and what its tests need.
$(VENV)/.installed: $(VENV)/.program requirements/dev.txt
	@echo "Setting up $(VENV) for the tests, once: 0.9 GB more on the disk"
	$(LOCKED) requirements/dev.txt
	@touch $@

# The machine model compiled for this computer, once for these sources: a first diagnosis then takes as long as any other.
# Nothing depends on it, so a computer without room for it goes on.
$(VENV)/.compiled: $(VENV)/.program $(wildcard control/machine/*.py control/field/*.py control/diagnosis/judgement/*.py)
	-$(BIN)/python -m topdress.console.warm_up
	@touch $@

# The console shows numbers at once; the machine model is compiled behind it, with what the processor has to spare.
run: $(VENV)/.program
	@nohup nice -n 19 $(MAKE) --silent $(VENV)/.compiled </dev/null >/dev/null 2>&1 &
	$(BIN)/topdress

# Compiled tests and sources are kept even where the shell says not to (some container images do): compiling them anew
# costs each process of the tests 9 s of processor, and each program that they start up to 1 s.
unexport PYTHONDONTWRITEBYTECODE

# The tests of a file share what they look at: one process has them all. Three processes for two cores: some wait for
# a started program or for a screen to come to rest while others compute. Their order is that of tests/conftest.py.
test: $(VENV)/.installed $(VENV)/.compiled
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Hidden examinations, long logs, many kills, minutes of odd files: tests marked `exam`.
exam: $(VENV)/.installed
	$(BIN)/python -m pytest -n 2 --dist worksteal -m exam

# The installed package as links, for tools that read folders and not `__path__`.
.packages/topdress:
	mkdir -p $@
	cd $@ && ln -sf ../../topdress/__init__.py ../../topdress/py.typed ../../console ../../control ../../drivers .

CHECKS := $(abspath $(BIN))
check: $(VENV)/.installed .packages/topdress
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	cd .packages && $(CHECKS)/mypy --config-file ../pyproject.toml
	cd .packages && PYTHONPATH=. $(CHECKS)/lint-imports --config ../pyproject.toml --cache-dir ../.import_linter_cache
	$(MAKE) test

# The tools of the three below have an environment of their own.
TOOLS := .venv-tools/bin
.venv-tools/.installed: requirements/tools.in
	$(PYTHON) -m venv .venv-tools
	$(TOOLS)/python -m pip install --quiet --requirement requirements/tools.in
	touch $@

EXTRAS := diagnosis parquet serve mqtt fleet gis raster
# Newest versions that the lower bounds allow, for every system and Python from 3.11 on.
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate \
	--index-strategy unsafe-best-match --custom-compile-command "make lock"
lock: .venv-tools/.installed
	$(TOOLS)/$(LOCK) --upgrade pyproject.toml requirements/build.in --extra dev --output-file requirements/dev.txt
	$(TOOLS)/$(LOCK) --upgrade requirements/build.in --output-file requirements/build.txt
	$(TOOLS)/$(LOCK) --upgrade -c requirements/dev.txt pyproject.toml --extra diagnosis --output-file requirements/run.txt
	$(TOOLS)/$(LOCK) --upgrade -c requirements/dev.txt pyproject.toml $(EXTRAS:%=--extra %) --output-file requirements/extras.txt
	$(TOOLS)/$(LOCK) --upgrade pyproject.toml --extra diagnosis requirements/build.in requirements/examination.in --output-file requirements/examination.txt

# Who wrote what the program needs, under which licence (docs/licences.md is made by this).
licences: .venv-tools/.installed
	.ci/licences

# The pages of docs/ and of every module's docstrings as a site in site/.
docs: .venv-tools/.installed
	$(TOOLS)/mkdocs build --strict

# `make release TAG=v0.1.0`: wheel, bill of materials and licences in dist/, tried in a fresh environment.
release: .venv-tools/.installed
	.ci/release $(TAG)

benchmark-diagnosis: $(VENV)/.installed
	$(BIN)/python benchmarks/diagnosis/run.py --cases 1200 --seed 1 --programmes all --jobs 2

clean:
	rm -rf $(VENV) .packages .venv-tools .venv-release dist site
