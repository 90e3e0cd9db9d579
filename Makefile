# The two commands are `make demo` and `make test`. Both do all of their own set-up in .venv, once (tools/setup.sh).

VENV := .venv
BIN := $(VENV)/bin
# Three processes, which take tests from each other in the end: a third of the time is spent waiting for graphs. JOBS=0: one.
JOBS ?= 3
PYTEST_ARGS ?=
# CommonRoad's packages need another protobuf than osi's, so their tests run apart (tools/commonroad.txt).
COMMONROAD := PYTHONPATH=$(VENV)/commonroad $(BIN)/python -m pytest -q -rs -k commonroad test/extras/formats/test_commonroad.py test/cosim
# Recordings (vci_dut/, vci_citr/) for the demo to learn from besides the right turns that the package holds.
VPSCI_DATA ?= $(wildcard ../shared/data)

# Nodes talk to nodes on this machine only, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: help setup demo test check docs dist chaos clean
.DEFAULT_GOAL := help

help:  ## show this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 16

setup:  ## make .venv: ROS 2 and Python packages, vpsci_msgs, this package for development
	@tools/setup.sh $(VENV)

demo: setup  ## run all three stages, small; leaves bags, tables and a page that plays them in out/demo
	@$(BIN)/vpsci demo --force $(if $(VPSCI_DATA),--data $(VPSCI_DATA))

test: setup  ## run the tests
	@$(BIN)/python -m pytest -q -rs --durations 20 -n $(JOBS) --dist worksteal $(PYTEST_ARGS)
	@$(COMMONROAD)

check: setup  ## what a change has to pass: ruff, mypy, tests, each once
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@$(BIN)/python -m pytest -q -rs -n $(JOBS) --dist worksteal --ignore test/test_code_style.py $(PYTEST_ARGS)
	@$(COMMONROAD)

docs: setup  ## build the documentation site into out/site; a warning fails it
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open out/site/index.html"

dist: setup  ## make the source distribution and from it the wheel, in out/dist, and check both (twine)
	@rm -rf out/dist
	@$(BIN)/python -W ignore setup.py -q sdist -d out/dist
	@$(BIN)/python -m pip -q wheel --no-deps --no-build-isolation -w out/dist out/dist/*.tar.gz
	@$(BIN)/twine check --strict out/dist/*

chaos: setup  ## damage thousands of files, hundreds of commands and graphs, and count what does not hold (hours)
	@for name in files bags folders again processes; do \
		$(BIN)/python test/chaos/campaign.py $$name -o out/chaos/$$name || exit 1; done

clean:  ## remove .venv and whatever was built, keep out/
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find vpsci_ros benchmarks test -name __pycache__ -type d -prune -exec rm -rf {} +
