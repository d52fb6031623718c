# `make demo` and `make test` do everything on a fresh machine with Python 3.11 and make.
PYTHON ?= python3
BIN := .venv/bin
DEMO := demo
DENSITIES := 1 5 10 15 20 25 30

.PHONY: setup demo test lint prove docs rllib crime pretrained pretrained-paper level_1 level_2 results clean
.PHONY: pretrained-merge pretrained-exit pretrained-ramp_to_ramp
setup: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt tools/install_system_libraries.sh
	sh tools/install_system_libraries.sh
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev,ray]'
	touch $@

demo: setup
	test -d $(DEMO)/driver || \
	    $(BIN)/drl-av train --preset large --traffic calm -o ppo.decisions=2000000 --out $(DEMO)/driver
	$(BIN)/drl-av evaluate $(DEMO)/driver pretrained gap-mobil idm-mobil \
	    --vehicles $(DENSITIES) --episodes 20 --jobs 2 --out $(DEMO)/evaluation.csv
	$(BIN)/drl-av figures $(DEMO)/evaluation.csv --out $(DEMO)
	$(BIN)/drl-av replay $(DEMO)/driver --vehicles 15 --seed 10 --decisions 60 --video $(DEMO)/drive.mp4
	@echo "See $(DEMO)/mean_speed.png, $(DEMO)/gain.png and $(DEMO)/drive.mp4"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The documentation as a website in site/; the tests build it too.
docs: setup
	$(BIN)/zensical build --strict --clean

# Numba compiles the twin on one core while mypy works on the other; the tests then find it compiled.
SMALL := -o ppo.decisions=256 -o ppo.batch_size=256 -o ppo.minibatch_size=256 -o ppo.worlds=8
test: setup
	$(BIN)/drl-av train --preset large $(SMALL) --out $$(mktemp -d)/driver > /dev/null & $(MAKE) lint && wait
	$(BIN)/python -m pytest -n 2 --dist worksteal

# RLlib, which pins another gymnasium, in a virtual environment of its own (minutes).
RLLIB ?= $(HOME)/.cache/drl-av/rllib
rllib:
	$(PYTHON) -m venv $(RLLIB)
	grep -v '^gymnasium==' constraints.txt > $(RLLIB)/constraints.txt
	$(RLLIB)/bin/python -m pip install --quiet -c $(RLLIB)/constraints.txt 'ray[rllib]' -e '.[train]'
	$(RLLIB)/bin/python examples/rllib_ppo.py 2

# TTC and DRAC beside commonroad-crime, in a virtual environment of its own (1 GB, minutes).
CRIME ?= $(HOME)/.cache/drl-av/crime
crime: setup
	$(PYTHON) -m venv $(CRIME)
	$(CRIME)/bin/python -m pip install --quiet commonroad-crime==0.4.5
	CRIME_PYTHON=$(CRIME)/bin/python $(BIN)/python -m pytest tests/test_crime.py

# The argument of the check strict, lemma by lemma (seconds).
prove: setup
	$(BIN)/python -m verification.prove

# The shipped driver, trained again (half an hour).
pretrained: setup
	$(BIN)/drl-av train --preset large --out runs/pretrained
	cd runs/pretrained && cp config.toml policy.safetensors ../../drl_av/pretrained/

# The driver by the paper's whole schedule, trained again (half an hour).
pretrained-paper: setup
	$(BIN)/drl-av train --preset paper --traffic calm --out runs/pretrained-paper
	cd runs/pretrained-paper && cp config.toml evaluations.csv policy.safetensors \
	    ../../drl_av/pretrained/paper/

# The drivers of roads with ramps, trained again in the twin (half an hour each).
pretrained-merge pretrained-exit pretrained-ramp_to_ramp: pretrained-%: setup
	$(BIN)/drl-av train --preset large-$* --out runs/$@
	cd runs/$@ && cp config.toml policy.safetensors ../../drl_av/pretrained/$*/

# The level-k drivers of the traffic, trained again among drivers of one level less (minutes).
level_1 level_2: setup
	$(BIN)/drl-av train --config drl_av/pretrained/$@/config.toml --out runs/$@
	cd runs/$@ && cp config.toml evaluations.csv policy.safetensors ../../drl_av/pretrained/$@/

text = mkdir -p runs && $(BIN)/python $(2) > runs/$(1) && mv runs/$(1) docs/results/$(1)
# A training that has begun goes on, and one that has ended stays.
trained = $(BIN)/drl-av train --out runs/$(1) $$(test -d runs/$(1) && echo --resume || echo --preset $(1))

# Every number, table and figure of README.md and docs/results (hours). What a study has
# made already is not made again; a tool's text stands once the tool has ended well.
results: setup
	$(BIN)/python -m studies --jobs 2
	$(BIN)/python -m verification.step_lengths --out docs/results/step_length.csv
	$(BIN)/python -m verification.stories --out docs/results/stories.csv
	$(call text,falsified_strict.txt,-m verification.falsify --safety-check strict)
	$(call text,falsified_paper.txt,-m verification.falsify --safety-check paper)
	$(call text,proved_strict.txt,-m verification.prove)
	$(call text,completeness_strict.txt,-m verification.completeness)
	$(call text,speed_bound.txt,-m verification.speed_bound)
	$(call text,background_traffic.txt,-m verification.background_traffic --episodes 50 --mix calm paper overtaking naturalistic hazards --ego sumo idm-mobil pretrained random)
	$(call text,traffic_moments.txt,-m verification.traffic_moments --episodes 18)
	$(call text,rl_zoo3.txt,tools/tune_rl_zoo3.py --trials 15 --trainings 2)
	$(call text,memory.txt,tools/measure_memory.py)
	$(call text,memory_four.txt,tools/measure_memory.py --environments 4)
	$(call text,long_run.txt,-m verification.long_run --episodes 5000 --out runs/long_run.csv)
	$(call text,long_run_naturalistic.txt,-m verification.long_run --episodes 200 --traffic naturalistic --out runs/long_run_naturalistic.csv)
	$(call text,long_run_hazards.txt,-m verification.long_run --episodes 100 --traffic hazards --out runs/long_run_hazards.csv)
	$(call text,sumo_approaches.txt,-m verification.approaches)
	$(call text,merge.txt,-m verification.ramps --kind merge --driver gap-mobil sumo)
	$(call text,exit.txt,-m verification.ramps --kind exit --driver gap-mobil sumo --episodes 60)
	$(call text,ramp_to_ramp.txt,-m verification.ramps --kind ramp_to_ramp --driver gap-mobil sumo --episodes 30)
	$(call text,merge_learned.txt,-m verification.ramps --kind merge --driver pretrained-merge --episodes 200)
	$(call text,exit_learned.txt,-m verification.ramps --kind exit --driver pretrained-exit --episodes 600 --seed 770000)
	$(call text,ramp_to_ramp_learned.txt,-m verification.ramps --kind ramp_to_ramp --driver pretrained-ramp_to_ramp --episodes 200 --seed 770000)
	$(call trained,paper-merge)
	$(call trained,paper-exit)
	$(call trained,paper-ramp_to_ramp)
	$(call text,merge_paper.txt,-m verification.ramps --kind merge --driver runs/paper-merge --episodes 200)
	$(call text,exit_paper.txt,-m verification.ramps --kind exit --driver runs/paper-exit --episodes 200)
	$(call text,ramp_to_ramp_paper.txt,-m verification.ramps --kind ramp_to_ramp --driver runs/paper-ramp_to_ramp --episodes 200)
	$(BIN)/python -m verification.ramps_figure docs/results
	$(BIN)/drl-av figures --out docs/results
	$(call text,crash_rate.txt,-m verification.crash_rate --tests 40000 --jobs 2)
	$(call text,own_hits.txt,-m verification.own_hits --tests 120000 --jobs 2)
	for kind in calm paper overtaking naturalistic hazards; do \
	    $(BIN)/python -m verification.twin_equality --traffic $$kind --jobs 2 || exit 1; \
	done > runs/twin_equality.txt && mv runs/twin_equality.txt docs/results/
	$(call text,ablation.txt,-m studies.ablation)
	$(call text,scale.txt,-m studies.scale)
	$(call text,twin_open_roads.txt,-m verification.twin_roads)
	$(call text,sharper.txt,-m verification.sharper)
	$(call text,clairvoyant.txt,-m verification.clairvoyant --vehicles 10 15 20 25 --episodes 100 --jobs 2)
	$(BIN)/python -m verification.shielding --out docs/results/shielding.csv
	$(call text,twin_costs.txt,tools/measure_twin.py)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[benchmark]'
	$(call text,benchmark.txt,tools/benchmark.py)
	$(BIN)/python tools/execute_notebook.py examples/tour.ipynb
	$(BIN)/python tools/draw_drive.py docs/drive.gif
	$(BIN)/python tools/draw_stories.py docs/assets/stories
	$(BIN)/python tools/refresh_tables.py

clean:
	rm -rf .venv $(DEMO)
