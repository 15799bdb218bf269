# Everything a fresh machine needs: Python 3.11, gcc and the package registries.
PYTHON ?= python3.11
BIN := .venv/bin

# Where the environment forbids bytecode, hundreds of processes would each compile the same modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup demo test test-long check check-python check-page bench openapi page docs ur-sim-wheel clean

# Kernels are compiled while pip unpacks the tools of tests and checks: it keeps one core busy for a minute.
MAKEFLAGS += --jobs=2

# All that tests and checks need.
setup: .venv/ready

.venv/ready: .venv/tools .venv/warm
	touch $@

# What sessions in the simulated cell need.
.venv/packages: pyproject.toml deploy/constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv || python3 -m venv .venv
	$(BIN)/pip install --quiet --no-compile --constraint deploy/constraints.txt --editable '.[sim]'
	touch $@

# Compiled on two cores: what imports less than the other is compiled beside it, and `runner.jobs` finds both in the
# cache.
.venv/kernels: .venv/packages
	$(BIN)/python -c 'import acquisition.photometry'
	$(BIN)/python -c 'import acquisition.normals' & \
	$(BIN)/python -c 'import acquisition.waypoints.routing, acquisition.plan' && wait $$!
	$(BIN)/python -c 'import acquisition.runner.jobs, hardware_sim.world'
	touch $@

# The kernels of folders' images, too.
.venv/warm: .venv/kernels
	$(BIN)/lightpose warm
	touch $@

# The extra `dev` by its requirements: to install the project itself anew would take it from under the compilation.
.venv/tools: .venv/packages
	$(BIN)/python -c 'import tomllib; \
	    print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["dev"], sep="\n")' > $@.txt
	$(BIN)/pip install --quiet --no-compile --constraint deploy/constraints.txt --requirement $@.txt
	touch $@

demo: .venv/kernels
	$(BIN)/lightpose demo $(if $(PAGE),--page)

# Two processes more than two cores: tests of a real cell wait for its arm half of their time. At the niceness of computing
# processes, which else get a tenth of a core beside the tests of the others, while the rest of their cell runs on.
test: setup
	nice -n 10 $(BIN)/pytest --numprocesses 4 --dist loadfile --no-loadscope-reorder

test-long: setup
	$(BIN)/pip install --quiet --no-compile --constraint deploy/constraints.txt --editable '.[sim,dev,long]'
	$(BIN)/pytest -m long --timeout 3600

bench: setup
	$(BIN)/pytest tests/benchmarks --benchmark-enable --benchmark-only --timeout 900

check: check-python check-page

# Node.js collects pyright's garbage young in 128 MB: with its own 16 MB, reading types takes a fifth longer.
check-python: .venv/tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	NODE_OPTIONS=--max-semi-space-size=128 $(BIN)/pyright
	$(BIN)/pip check

check-page:
	if command -v npm > /dev/null; then cd api/page && npm ci --silent --ignore-scripts && npm run --silent check; fi

openapi: setup
	$(BIN)/python -m api.rest.openapi > api/openapi.json

# The operator's page from its sources; needs Node. What it writes is committed, so that users need none.
page:
	cd api/page && npm ci --silent --ignore-scripts && npm run --silent types && npm run --silent build

docs: setup
	$(BIN)/python docs/generated_blocks.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --config-file .mkdocs.yml

# The simulated controller alone, for other projects' tests.
ur-sim-wheel: setup
	rm -rf build/ur-sim
	$(BIN)/python -m hardware_sim.ur_sim_project build/ur-sim
	$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist build/ur-sim

clean:
	rm -rf .venv build dist *.egg-info
