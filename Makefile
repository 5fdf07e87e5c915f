# One word a task. Each sets up what it needs on a fresh Debian 12 machine and is quick afterwards.
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= /usr/bin/python3
APT_PACKAGES := g++ cmake ninja-build python3-venv python3-dev \
	libembree-dev libnanoflann-dev libosd-dev libtbb-dev
SUDO := $(if $(filter 0,$(shell id -u)),,sudo)

COMPILED := CMakeLists.txt $(shell find plugin/core plugin/binding -name '*.cpp' -o -name '*.h') \
	$(shell find schema/generated -type f) plugin/plugInfo.json

.PHONY: setup build test lint format clean

setup: $(VENV)/.packages

$(VENV)/.packages: pyproject.toml
	@dpkg -s $(APT_PACKAGES) >/dev/null 2>&1 || \
		($(SUDO) apt-get update -q && \
		 DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -q $(APT_PACKAGES))
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q --disable-pip-version-check "scikit-build-core>=0.10" "nanobind>=2.2"
	@touch $@

build: $(VENV)/.built

$(VENV)/.built: $(VENV)/.packages $(COMPILED)
	$(BIN)/pip install -q --disable-pip-version-check --no-build-isolation -e ".[test,lint]"
	@touch $@
