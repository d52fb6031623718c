"""Training on roads with ramps, by a driver that also observes its way."""

from pathlib import Path

import numpy as np
import pytest
from runs import Capsys
from worlds import ALONE

from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import load_run
from drl_av.drivers.registry import load_driver, load_learned
from drl_av.driving.affordances import observed_indicators
from drl_av.driving.mirror import mirror_of, mirrored_observations
from drl_av.errors import DrlAvError

SHORT = """
[simulation]
decisions_per_episode = 12
[learning]
episodes = 3
evaluate_every = 2
evaluation_episodes = 1
checkpoint_every = 2
batch_size = 8
hidden_units = 10
collisions_to_start = 0
mirrored = true
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short training on the road to an exit."""
    home = tmp_path_factory.mktemp("way")
    (home / "short.toml").write_text(SHORT)
    words = ["--preset", "paper-ramp_to_ramp", "--config", str(home / "short.toml")]
    assert main(["train", "--out", str(home / "run"), *words]) == 0
    return home / "run"


def test_its_network_has_30_inputs_and_learns_of_the_way(run: Path) -> None:
    network, config = load_run(run)
    assert config.observation.way
    assert network.sizes == (30, 10, 10, 12)
    untrained = QNetwork(np.random.default_rng(0), 30, hidden=(10, 10))
    (weight, _), *_ = network.layers
    (initial, _), *_ = untrained.layers
    assert weight.shape == initial.shape == (10, 30)
    assert (weight[:, 28] != initial[:, 28]).any()  # way_changes


def test_it_decides_alike_on_both_sides(run: Path) -> None:
    driver, config = load_learned(run)
    mirror = mirror_of(observed_indicators(config.observation))
    assert mirror.observation_sign[-3:].tolist() == [1, -1, 1]
    for s in np.random.default_rng(1).standard_normal((50, 30)).astype(np.float32):
        reflected = driver.act(ALONE, mirrored_observations(s, mirror)).number
        assert reflected == mirror.action_permutation[driver.act(ALONE, s).number]


def test_it_drives_on_its_own_road_and_refuses_other_observations(
    run: Path, tmp_path: Path, capsys: Capsys
) -> None:
    table = tmp_path / "table.csv"
    words = ["--vehicles", "5", "--episodes", "1", "--out", str(table)]
    assert main(["evaluate", str(run), "gap-mobil", *words]) == 0
    assert len(table.read_text().splitlines()) == 3
    assert load_driver(run)
    for words in ([str(run), "pretrained-paper"], ["pretrained-paper", str(run)]):
        capsys.readouterr()
        assert main(["evaluate", *words, "--vehicles", "5", "--episodes", "1"]) == 1
        assert "was trained with other [observation] settings" in capsys.readouterr().err
    network = tmp_path / "network.onnx"
    assert main(["export", "pretrained-paper", str(network)]) == 0
    with pytest.raises(
        DrlAvError, match=r"network.onnx observes the 27 indicators alone: drive it"
    ):
        load_driver(network, Config().updated("observation", way=True))
