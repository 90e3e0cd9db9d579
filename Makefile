# The two commands are `make demo` and `make test`. Each installs what it needs in .venv, once (tools/setup.sh).

VENV := .venv
BIN := $(VENV)/bin
# Three processes, which take tests from each other in the end: a third of the time is spent waiting for graphs. JOBS=0: one.
JOBS ?= 3
PYTEST := $(BIN)/python -m pytest -q -rs
PYTEST_ARGS ?=
# Whether `make test` ends with test-engines, whose install and searches take minutes: ENGINES=yes.
ENGINES ?=
ENGINE_TESTS := $(addprefix test/,cosim/test_engines.py examples/test_motion_planner.py extras/carla \
	extras/formats/test_carla_map.py extras/formats/test_mp4.py extras/paper extras/exam_extra extras/drive/test_person_exam.py extras/cluster \
	examples/test_trained_policy.py examples/test_cluster_files.py extending/test_network.py test_site.py test_without_extras.py)
# CommonRoad's packages need another protobuf than osi's, so their tests run apart (tools/commonroad.txt).
COMMONROAD := PYTHONPATH=$(VENV)/commonroad $(PYTEST) -k commonroad test/extras/formats/test_commonroad.py test/cosim/test_engines.py
# Recordings (vci_dut/, vci_citr/) for the demo to learn from besides the right turns that the package holds.
VPSCI_DATA ?= $(wildcard ../shared/data)

# Nodes talk to nodes on this machine only, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: help setup demo test test-engines check docs dist clean
.DEFAULT_GOAL := help

help:  ## show this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 20

setup:  ## make .venv with everything: for the demo, the tests and the engines
	@tools/setup.sh $(VENV) engines

demo:  ## run all three stages, small; leaves bags, tables and a page that plays them in out/demo
	@tools/setup.sh $(VENV) demo
	@$(BIN)/vpsci demo --force $(if $(VPSCI_DATA),--data $(VPSCI_DATA))

test:  ## run the tests without test-engines (ENGINES=yes: with them)
	@tools/setup.sh $(VENV) test
	@$(PYTEST) --durations 20 -n $(JOBS) --dist worksteal $(addprefix --ignore ,$(ENGINE_TESTS)) $(PYTEST_ARGS)
	@$(if $(ENGINES),$(MAKE) --no-print-directory test-engines)

test-engines:  ## run the slow tests: exam_extra, drive, paper, videos, the site, the trunk alone, and those with SUMO, highway-env, CARLA, CommonRoad, a planner
	@tools/setup.sh $(VENV) engines
	@$(PYTEST) -n $(JOBS) --dist worksteal $(ENGINE_TESTS)
	@$(COMMONROAD)

check: setup  ## what a change has to pass: ruff, mypy, tests, each once
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@$(PYTEST) -n $(JOBS) --dist worksteal --ignore test/test_code_style.py $(PYTEST_ARGS)
	@$(COMMONROAD)

docs: setup  ## build the documentation site into out/site; a warning fails it
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open out/site/index.html"

dist: setup  ## make the source distribution and from it the wheel, in out/dist, and check both (twine)
	@rm -rf out/dist
	@$(BIN)/python -W ignore setup.py -q sdist -d out/dist
	@$(BIN)/python -m pip -q wheel --no-deps --no-build-isolation -w out/dist out/dist/*.tar.gz
	@$(BIN)/twine check --strict out/dist/*

clean:  ## remove .venv and whatever was built, keep out/; says how much that frees
	@built="$(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache"; \
		echo "frees $$(du -shc $$built 2>/dev/null | tail -1 | cut -f 1)"; rm -rf $$built
	@find vpsci_ros benchmarks test -name __pycache__ -type d -prune -exec rm -rf {} +
