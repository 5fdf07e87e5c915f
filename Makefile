# One word a task. Each sets up what it needs on a fresh Debian 12 machine and is quick afterwards.
VENV := .venv
BIN := $(VENV)/bin
SITE_PACKAGES = $(wildcard $(VENV)/lib/python3.*/site-packages)
PYTHON ?= /usr/bin/python3
PIP := $(BIN)/pip install -q --disable-pip-version-check
APT_PACKAGES := g++ cmake ninja-build python3-venv python3-dev \
	libembree-dev libnanoflann-dev libosd-dev libtbb-dev
SUDO := $(if $(filter 0,$(shell id -u)),,sudo)

COMPILED := CMakeLists.txt $(shell find plugin schema/generated -type f)
CPP := $(shell find plugin -name '*.cpp' -o -name '*.h')

DEMO_SECONDS := 20

# Tests that run the compiled code the most; those of the sanitized builds, which are slow.
CORE_TESTS := $(addprefix tests/test_,authored_mesh.py candela_distribution.py composite.py \
	diagram.py direct_lighting.py eulumdat.py fuzz_corpus.py ies.py illumination_filter.py \
	illumination_mesh.py infinite_lights.py light_linking.py mesh_lights.py mesh_refinement.py \
	photon_tracer.py poisson_interval.py progressive_radiosity.py ray_caster.py shared_trees.py \
	final_gather.py subdivision.py subdivision_reader.py tone_mapping.py triangulation.py) \
	$(addprefix tests/physics/test_,infinite_light.py light_links.py mesh_light.py opacity.py \
	reproducible_bits.py subdivided_room.py) \
	$(addprefix tests/properties/test_any_,count.py geometry.py photometry.py)
FUZZ_SECONDS := 60

VALIDATION := tests/validation

.PHONY: help setup build demo test validate sanitize sanitize-address sanitize-thread fuzz mutations \
	lint format bench bench-peers wheel clean

help:
	@echo "make demo    bake the office and show its progressive pictures"
	@echo "make test    all tests"
	@echo "make validate  $(VALIDATION)/README.md: every case, expected, got, error, tolerance, pass"
	@echo "make sanitize  the tests of the core under ASan + UBSan and under TSan"
	@echo "make fuzz    odd photometric files and stages, FUZZ_SECONDS=60 of each"
	@echo "make mutations  break the physics in one place after the other: a test has to notice"
	@echo "make lint    formatters, linters and types"
	@echo "make format  let the formatters rewrite the sources"
	@echo "make bench   speed against error, ratios to the bare ray tracer"
	@echo "make bench-peers  the same beside Mitsuba, Cycles, LuxCore and Radiance, two threads each"
	@echo "make wheel   a wheel in dist/"
	@echo "make clean   remove what these made"

setup: $(VENV)/.packages

$(VENV)/.packages: pyproject.toml
	@dpkg -s $(APT_PACKAGES) >/dev/null 2>&1 || { \
		$(SUDO) apt-get update -q && \
		$(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get install -y -q $(APT_PACKAGES); }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) "scikit-build-core>=0.10" "nanobind>=2.2"
	@touch $@

build: $(VENV)/.built

$(VENV)/.built: $(VENV)/.packages $(COMPILED)
	$(PIP) --no-build-isolation -e ".[test,lint]"
	@touch $@

demo: build
	@mkdir -p demo
	$(BIN)/python -m usd_scenes.office.generate demo/office.usdc
	$(BIN)/isolux solve demo/office.usdc -o demo/office.isolux.usda --output-mode refined \
		--time-budget $(DEMO_SECONDS)
	$(BIN)/python tools/contact_sheet.py demo/office.isolux.usda demo/contact_sheet.png
	$(BIN)/isolux render demo/office.isolux.usda -o demo/office.png --width 1280
	@echo
	@echo "demo/contact_sheet.png     the progressive stages side by side"
	@echo "demo/office.png            the last one"
	@echo "demo/office.isolux.usda    the results over the stage: open in usdview, scrub the timeline"
	@echo "                           or: $(BIN)/isolux info demo/office.isolux.usda"

test: build
	$(BIN)/pytest

# The report is written whatever fails; what fails stands in it.
validate: build
	$(PIP) --no-build-isolation -e ".[test,bench]"
	$(BIN)/pytest -m validation --validation-report=$(VALIDATION)

# The sanitized modules lie apart from the virtual environment, and come first on the path of the
# system's Python, which doesn't know of our editable install.
sanitize: sanitize-address sanitize-thread

sanitize-address sanitize-thread: sanitize-%: build/sanitize-%/.built
	tools/sanitize/run.sh $* $(SITE_PACKAGES) $(PYTHON) $(CORE_TESTS)

build/sanitize-%/.built: $(VENV)/.built $(COMPILED) $(wildcard python/isolux/*.py python/isolux/*/*.py)
	$(PIP) --no-build-isolation --no-deps --upgrade --target build/sanitize-$*/installed \
		--config-settings build-dir=build/sanitize-$*/compiled \
		--config-settings cmake.build-type=Debug \
		--config-settings cmake.define.ISOLUX_SANITIZE=$* \
		--config-settings install.strip=false .
	@touch $@

fuzz: build
	$(PIP) --no-build-isolation -e ".[test,fuzz]"
	$(BIN)/python -m tools.fuzz.fuzz photometry --seconds $(FUZZ_SECONDS)
	$(BIN)/python -m tools.fuzz.fuzz stage --seconds $(FUZZ_SECONDS)

mutations: build
	$(BIN)/python tools/mutations.py

lint: build
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run --Werror $(CPP)
	$(BIN)/python tools/generate_schema.py --check

format: build
	$(BIN)/ruff format
	$(BIN)/ruff check --fix
	$(BIN)/clang-format -i $(CPP)

bench: build
	CMAKE_ARGS=-DISOLUX_BENCHMARK=ON $(PIP) --no-build-isolation -e ".[bench]"
	$(BIN)/python tools/benchmark.py
	$(BIN)/python -m usd_scenes.cornell_box.generate build/bench/cornell_box.usdc
	$(BIN)/python -m usd_scenes.office.generate build/bench/office.usdc
	$(BIN)/python -m usd_scenes.hall.generate build/bench/hall.usdc --luminaires 600
	$(BIN)/python tools/method_curves.py build/bench/cornell_box.usdc build/bench/office.usdc \
		build/bench/hall.usdc --methods composite,dept,ddl+idept --seeds 2 --time-budget 20 \
		--cpu-time --figure tools/speed_against_error.png

# Mitsuba compiles its kernels with LLVM; bpy wants NumPy 1, so the peers have an environment of their
# own. Stages of yours come along as PEER_STAGES="shot.usd other.usd".
PEERS := build/peers_venv
PEER_PACKAGES = $(shell $(PYTHON) -c "import tomllib; \
	print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['peers'])")
PEER_SCENES := $(addprefix build/bench/,cornell_box.usdc office.usdc hall.usdc flat.usdc)
PEER_THREADS := 2

bench-peers: build
	@dpkg -s libllvm19 >/dev/null 2>&1 || $(SUDO) apt-get install -y -q libllvm19
	$(PIP) --no-build-isolation -e ".[bench]"
	test -x $(PEERS)/bin/python || $(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/pip install -q --disable-pip-version-check $(PEER_PACKAGES)
	@mkdir -p build/bench
	$(BIN)/python -m usd_scenes.cornell_box.generate build/bench/cornell_box.usdc
	$(BIN)/python -m usd_scenes.office.generate build/bench/office.usdc
	$(BIN)/python -m usd_scenes.hall.generate build/bench/hall.usdc --luminaires 600
	$(BIN)/python -m usd_scenes.flat.generate build/bench/flat.usdc
	$(BIN)/python tools/bench_peers.py $(PEER_SCENES) $(PEER_STAGES) --threads $(PEER_THREADS) \
		--peers-python $(PEERS)/bin/python \
		--figure tools/speed_against_peers.png

wheel: build
	$(PIP) build
	$(BIN)/python -m build --wheel --no-isolation

clean:
	rm -rf $(VENV) build dist demo
