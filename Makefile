# Everything happens in .venv with the pinned set of constraints.txt; public implementations have
# environments of their own.
# The package is installed editable and strict: type checkers see it and edits are live, but a new
# or removed file needs a re-install, hence the list of files that .venv/.linked is made from.

PYTHON ?= python3
BIN := .venv/bin
ROOMS := src envs agents callbacks experiments orchid_cli
PAGE := experiments/replay/page
JOBS ?= 2
# A file's tests go to one process: what they share, such as a run, is made once.
SHARED_OUT := -n $(JOBS) --dist loadfile
AUDIT ?= studies/results/audit.json
SCALE ?= 1
# Containers often set it: each of the suite's processes would then compile all of the code anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help install train test test-browser test-trackers test-ray test-lowest newest licences audit dist dist-check lint replay-page bench docs docs-data mutants reference studies ablation torture reproduce public validation fixed-batch clean FORCE

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

install: .venv/.linked  ## build .venv with the development extras

train: install  ## train the paper's run: 700 episodes, 2 to 5 minutes
	$(BIN)/orchid train

test: install  ## run the tests
	$(BIN)/python -m pytest $(SHARED_OUT)

test-browser: install  ## the page of replays in a real Chromium, which must be installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt playwright
	$(BIN)/python -m pytest -n $(JOBS) -m browser tests/browser

test-lowest: .venv-lowest/.installed  ## run the tests with the lowest versions that pyproject.toml admits
newest: .venv-newest/.installed  ## run the tests with the newest versions of all but torch, and write which

# Their servers are slow to start: not in the suite.
test-trackers: .venv-trackers/.installed  ## runs in a real MLflow, trackio and W&B; some minutes
	.venv-trackers/bin/python -m pytest -W ignore tests/experiments/test_real_trackers.py

# Old libraries beside new ones deprecate each other: no fault of ours, and none of theirs either.
TESTED = --json .venv-$(1)/tested.json -- $(SHARED_OUT) -W ignore::DeprecationWarning
test-lowest:
	.venv-lowest/bin/python -m studies.supply_chain.tested $(call TESTED,lowest)
newest:
	.venv-newest/bin/python -m studies.supply_chain.tested $(call TESTED,newest)

test-ray: install .venv-ray/.installed  ## run the tests of clusters, with real ones of Ray on this machine; some minutes
	CLUSTER_TESTS=1 .venv-ray/bin/python -m pytest tests/experiments/jobs/test_ray_cluster.py tests/experiments/jobs/test_slurm_scripts.py

licences: install .venv-supply/.installed  ## read the licences of all dependencies into studies/results; then make docs-data
	.venv-supply/bin/python -m studies.supply_chain.licences

audit: install .venv-supply/.installed  ## look for known vulnerabilities of the pinned versions
	.venv-supply/bin/python -m studies.supply_chain.audit --json $(AUDIT)

dist: install .venv-supply/.installed  ## build the sdist and the wheel of the last commit into dist/
	.venv-supply/bin/python -m studies.supply_chain.distributions

dist-check: install .venv-supply/.installed  ## build them twice, compare bytes and contents, install and run; some minutes
	.venv-supply/bin/python -m studies.supply_chain.distribution_check

lint: install  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -p orchid_uav

mutants: install  ## plant faults, each of which must turn a test red
	$(BIN)/python tests/mutants.py

bench: install  ## measure speed and memory, ratios within one run; then make docs-data
	$(BIN)/python -m pip install --quiet --constraint constraints.txt 'mobile-env'
	$(BIN)/python -m benchmarks.simulator --json studies/results/simulator.json
	$(BIN)/python -m benchmarks.training --repetitions 5 --json studies/results/training.json
	$(BIN)/python -m benchmarks.evaluation --json studies/results/evaluation.json
	$(BIN)/python -m benchmarks.run_index --json studies/results/run_index.json

reference: install  ## train the released policies anew, into runs/reference; about half an hour
	$(BIN)/python -m studies.reference_policies

studies: install  ## fly the evaluations that the documentation shows; about an hour
	$(BIN)/python -m studies.evaluations
	$(BIN)/python -m studies.deployment
	$(BIN)/python -m studies.pendulum

ablation: install  ## ten seeds with and without Reset-and-Finetune, compared; about 1.4 hours of one core
	$(BIN)/python -m studies.ablations

torture: install  ## kills, stops, faults, fuzz, large fleets, for hours; SCALE=0.05 takes minutes
	$(BIN)/python -m studies.torture --scale $(SCALE)

reproduce: install  ## every figure and claim of the paper; many hours, prints how many, goes on where it stopped
	$(BIN)/orchid reproduce --rows studies/results/reproduction

public: .venv-benchmarl/.installed .venv-agilerl/.installed  ## build the environments of public implementations

validation: install public  ## our learners beside public ones, ten seeds; about two hours, then their speed
	$(BIN)/python -m studies.simple_spread.study
	$(BIN)/python -m benchmarks.training_speed --json studies/results/training_speed.json

fixed-batch: install public  ## BenchMARL's numbers that tests compare with, into tests/data
	.venv-benchmarl/bin/python -m studies.simple_spread.fixed_batch tests/data/benchmarl_batch.json

docs-data: install  ## numbers and figures of the documentation, from studies/results
	$(BIN)/python -m studies.pages.generate

replay-page:  ## bundle the scripts of the page of replays anew; needs node
	cd $(PAGE)/build && npm install --silent --no-package-lock --no-audit --no-fund && node build.mjs

# Not --quiet, which also turns --strict off. The variable silences an advertisement of the theme.
docs: install  ## build the documentation into site/; a dead link fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

clean:  ## remove everything that was built; runs stay
	rm -rf .venv .venv-* build dist site *.egg-info src/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.installed: pyproject.toml constraints.txt
	$(call install_into,.venv,--constraint constraints.txt)

.venv-lowest/.installed: FORCE
	$(call install_into,.venv-lowest,--constraint constraints-lowest.txt)

.venv-newest/.installed: FORCE
	rm -rf .venv-newest
	mkdir .venv-newest
	grep '^torch==' constraints.txt > .venv-newest/torch.txt
	$(call install_into,.venv-newest,--constraint .venv-newest/torch.txt)

# install_into VENV,CONSTRAINTS: torch first, so that nothing asks for another build of it.
define install_into
@$(PYTHON) src/orchid_uav/python_version.py || { echo "Name another one: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
$(PYTHON) -m venv $(1)
$(1)/bin/python -m pip install --quiet $(2) torch
$(1)/bin/python -m pip install --quiet $(2) --config-settings editable_mode=strict --editable '.[dev]' || { echo "$$NO_COMPILER" >&2; exit 1; }
@touch $(1)/.installed
endef

define NO_COMPILER
If it was tinyscaler that could not be built: SuperSuit needs it, and it has no wheels for Python 3.13 and
newer, nor for Linux on Arm. Install a C compiler and the headers of that Python (Debian: apt install
build-essential python3-dev), or take a Python that has a wheel: make PYTHON=python3.12 $(MAKECMDGOALS)
endef
export NO_COMPILER

.venv/.linked: .venv/.installed .venv/.files
	$(BIN)/python -m pip install --quiet --no-deps --config-settings editable_mode=strict --editable .
	@touch $@

# On top of .venv, so that torch, MPE2 and this package are the same on both sides.
.venv-benchmarl/.installed: benchmarks/requirements/benchmarl.txt .venv/.installed
	$(call venv_on_top,.venv-benchmarl)
	.venv-benchmarl/bin/python -m pip install --quiet --no-deps --requirement $<
	@touch $@

.venv-trackers/.installed: pyproject.toml constraints.txt .venv/.installed
	$(call venv_on_top,.venv-trackers)
	.venv-trackers/bin/python -m pip install --quiet --constraint constraints.txt mlflow trackio wandb
	@touch $@

.venv-ray/.installed: pyproject.toml constraints.txt .venv/.installed
	$(call venv_on_top,.venv-ray)
	.venv-ray/bin/python -m pip install --quiet --constraint constraints.txt ray
	@touch $@

.venv-supply/.installed: studies/supply_chain/requirements.txt .venv/.installed
	$(call venv_on_top,.venv-supply)
	.venv-supply/bin/python -m pip install --quiet --requirement $<
	@touch $@

# venv_on_top VENV: one that also has all that .venv has.
define venv_on_top
$(BIN)/python -m venv $(1)
below=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && \
own=$$($(1)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && \
echo "import site; site.addsitedir('$$below')" > "$$own/orchid.pth"
endef

.venv-agilerl/.installed: benchmarks/requirements/agilerl.txt
	$(PYTHON) -m venv .venv-agilerl
	.venv-agilerl/bin/python -m pip install --quiet --no-deps --requirement $<
	@touch $@

# Rewritten only when the list of files has changed.
.venv/.files: FORCE | .venv/.installed
	@{ find $(ROOMS) -name '*.py'; find runs/reference $(PAGE)/bundle $(PAGE)/*.* -type f; } | LC_ALL=C sort > $@.new
	@cmp -s $@.new $@ || cp $@.new $@
	@rm $@.new

FORCE:
