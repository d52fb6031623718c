"""What the search for the hyperparameters of ``examples/rl_zoo3.yml`` found."""

import re

import yaml
from shown import ROOT

from tools.tune_rl_zoo3 import BY_HAND, RANGES, draw


def test_the_hyperparameters_that_ship_are_the_best_of_the_committed_search() -> None:
    printed = (ROOT / "docs" / "results" / "rl_zoo3.txt").read_text(encoding="utf-8")
    searched, again = printed.split("\n\n")
    found = re.findall(r"^(by hand|trial \d+) +mean +(-0\.\d+)", again, re.MULTILINE)
    best = max(found, key=lambda row: float(row[1]))[0]
    trials = draw(len(re.findall(r"^ +\d+  -", searched, re.MULTILINE)))
    for number, trial in enumerate(trials):  # the committed trials are those that it draws today
        shown = re.search(rf"^ +{number}  -\S+ \S+ +\d+  (.*)", searched, re.MULTILINE)
        assert shown
        assert [float(word) for word in shown[1].split()] == [*trial.values()]
    drawn = {} if best == "by hand" else trials[int(best.removeprefix("trial "))]
    text = (ROOT / "examples" / "rl_zoo3.yml").read_text(encoding="utf-8")
    shipped = yaml.safe_load(text)["drl_av/Highway-v0"]
    assert (shipped.pop("n_timesteps"), shipped.pop("policy")) == (20_000, "MlpPolicy")
    assert shipped.pop("policy_kwargs") == "dict(net_arch=[100, 100])"
    assert shipped == {name: (BY_HAND | drawn)[name] for name in BY_HAND if name in shipped}
    assert shipped.keys() | {"policy_kwargs"} == BY_HAND.keys() >= RANGES.keys()
