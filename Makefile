# make run · make test · make test-deep · make test-attack · make test-versions · make fuzz · make bench · make lint: each sets up what it needs, and again, fast, the second time.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CARGO ?= cargo
# make run: the whole suite and its report; make run MODEL=boat: one model and its page.
MODEL ?=
# The name of a variant, NAME:key=value,…, as one for folders.
comma := ,
FOLDER = $(subst $(comma),-,$(subst :,-,$(MODEL)))
RUST_SOURCES := $(wildcard rust/*/Cargo.toml rust/*/build.rs rust/*/src/*.rs rust/*/src/*/*.rs rust/*/src/*/*/*.rs rust/*/src/*.[ch] rust/*/layouts/*.h)
# For which interpreter the extension is built, and whose MuJoCo unit tests in Rust load.
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python

# A build in the checkout takes the crates that Cargo.lock has.
export MATURIN_PEP517_ARGS := --locked

# What a wheel says of when and where it was made: the date of the commit, and no path of this machine.
export SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || echo 315532800)
WHEEL_FLAGS := --remap-path-prefix=$(CURDIR)=/oarlock --remap-path-prefix=$(or $(CARGO_HOME),$(HOME)/.cargo)=/cargo

SECONDS ?= 60
HOST = $(shell rustc --print host-tuple)
# Coverage for libFuzzer, as cargo-fuzz asks for it; with an explicit --target, build scripts go without.
FUZZ_FLAGS := --cfg fuzzing -C passes=sancov-module $(addprefix -C llvm-args=-sanitizer-coverage-, \
	level=4 inline-8bit-counters pc-table trace-compares)

.PHONY: run test test-deep test-attack test-versions layouts fuzz bench lint format setup clean lock
.DELETE_ON_ERROR:

run: setup
ifeq ($(MODEL),)
	$(BIN)/oarlock suite --out build/results --report reports
else
	$(BIN)/oarlock run $(MODEL) --replace --out build/runs/$(FOLDER) --report reports/$(FOLDER)
endif

test: setup
	$(CARGO) test --locked --profile checked --quiet -p oarlock-core -p oarlock-fuzz -p oarlock-mujoco
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 8 --dist loadgroup

# Besides: the slow tests, and the native path under valgrind, which has to be there.
test-deep: test
	$(BIN)/python -m pytest -m slow
	@command -v valgrind >/dev/null || { echo "make test-deep needs valgrind"; exit 1; }
	PYTHONMALLOC=malloc valgrind --quiet --undef-value-errors=no --error-exitcode=9 \
		--suppressions=tests/memory/valgrind.supp $(BIN)/python tests/memory/boat.py

# Tries to break it: signals at random moments, two commands in one folder. Prints what was tried and what stood.
test-attack: setup
	cd tests && ../$(BIN)/python -m attack

# The core of what oarlock does with MuJoCo 3.3 to 4.0, each version in a folder of its own; a line a version.
test-versions: setup
	cd tests && ../$(BIN)/python -m versions

# Where versions of MuJoCo keep what the native path reads; VERSIONS: those of the table, or "3.10.0 … 4.0.0".
layouts:
	$(BIN)/python rust/mujoco/layouts/make.py $(VERSIONS)

# Looks for bytes that break a solver, for SECONDS; what it finds is left in build/fuzz, and goes on from there.
fuzz:
	mkdir -p build/fuzz/corpus
	RUSTFLAGS="$(FUZZ_FLAGS)" $(CARGO) run --locked --quiet --profile fuzz --target $(HOST) -p oarlock-fuzz -- \
		build/fuzz/corpus -artifact_prefix=build/fuzz/ -max_total_time=$(SECONDS) -timeout=10 -max_len=1000 \
		-print_final_stats=1 -verbosity=0

bench: setup
	$(CARGO) bench --locked --quiet -p oarlock-core

.PHONY: site rustdoc wheel sdist

# The documentation as pages, in build/site: offline, and strict about links.
site: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# That of the crates, private items too, beside it.
rustdoc:
	$(CARGO) doc --locked --no-deps --workspace --document-private-items
	mkdir -p build/site
	rm -rf build/site/rustdoc
	cp -r target/doc build/site/rustdoc

# For every Python from 3.11 on this system; maturin writes the oldest manylinux that the compiler's libraries allow.
wheel: setup
	rm -rf dist/*.whl
	RUSTFLAGS="$(WHEEL_FLAGS)" CARGO_TARGET_DIR=target/wheel $(BIN)/maturin build --release --locked --out dist

sdist: setup
	rm -rf dist/*.tar.gz
	$(BIN)/maturin sdist --out dist

lint: setup
	$(CARGO) fmt --check
	$(CARGO) clippy --locked --workspace --all-targets -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

format: setup
	$(CARGO) fmt
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

setup: $(VENV)/.built

$(VENV)/.dependencies: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "oarlock needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	@touch $@

$(VENV)/.built: $(VENV)/.dependencies Cargo.toml Cargo.lock pyproject.toml $(RUST_SOURCES)
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--no-build-isolation --no-deps --editable .
	@touch $@

# Pins every Python dependency, for every platform, with hashes. Needs uv (pip install uv).
lock:
	uv pip compile pyproject.toml --group dev --universal --generate-hashes --python-version 3.11 \
		--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --output-file requirements.lock

clean:
	rm -rf $(VENV) target build
