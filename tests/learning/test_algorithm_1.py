"""Algorithm 1, line by line on a road without SUMO, and from its seed on with SUMO."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from decisions import decided
from runs import files_of
from worlds import ALONE, ROAD, ahead, scene

from drl_av.config import REPLAYS, Config
from drl_av.drivers.learned import LearnedDriver
from drl_av.drivers.network import QNetwork
from drl_av.driving.affordances import INDICATORS
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.transition import Transition
from drl_av.learning import algorithm_1 as module
from drl_av.learning.algorithm_1 import EVALUATION_SEEDS, Training, build_training, make_buffer
from drl_av.learning.learner import Learner, Update
from drl_av.learning.replay import Batch, Buffer
from drl_av.learning.run_folder import Run, train
from drl_av.road.snapshot import Collision, CollisionKind
from drl_av.safety.check import Rule

KEEP, HARD_BRAKE, LEFT = 0, 3, 8
HIT = Collision(CollisionKind.HIT_AHEAD, "vehicle1")
N = len(INDICATORS)
Step = tuple[int | None, Rule, float, bool]
"""The action executed (None: as proposed), the rule that fired, the reward, a collision."""


def observed(t: int) -> np.ndarray:
    return np.full(N, t / 8, np.float32)


class ScriptedEnv:
    """An environment in which each decision goes as the script has it."""

    road = ROAD
    scene = ALONE
    fleet_of: Any = staticmethod(lambda _: SimpleNamespace(most_in_training=None, placed=None))

    def __init__(self, script: list[Step], config: Config, tape: list[str]) -> None:
        self.script, self.config, self.tape = script, config, tape
        self.seeds: list[int] = []
        self.options: list[Any] = []

    def require_room(self) -> None:
        """There is room for any number of vehicles on the script."""

    def reset(self, *, seed: int, options: object) -> tuple[None, dict[str, bool]]:
        self.tape.append("reset")
        self.seeds.append(seed)
        self.options.append(options)
        self.t = 0
        self.observation = observed(0)
        return None, {"unsafe_start": False}

    def execute(self, action: int) -> Transition:
        self.tape.append("act")
        executed, rule, reward, terminated = self.script[self.t]
        before = self.observation
        self.t += 1
        self.observation = observed(self.t)
        return decided(
            self.scene,
            executed=action if executed is None else executed,
            proposed=action,
            rule=rule,
            observation=before,
            next_observation=self.observation,
            terms=(reward, 0.0, 0.0),
            reward=reward,
            collision=HIT if terminated else None,
            truncated=self.t == len(self.script),
        )


QUIET: Step = (None, Rule.NONE, -0.5, False)
OVERRULED: Step = (HARD_BRAKE, Rule.IN_LANE, -0.5, False)


class TapedLearner(Learner):
    """Keeps what it found in each update."""

    def __init__(self, tape: list[str]) -> None:
        super().__init__(QNetwork(np.random.default_rng(0)))
        self.tape = tape
        self.updates: list[Update] = []

    def update(self, batch: Batch) -> Update:
        self.tape.append("update")
        self.updates.append(super().update(batch))
        return self.updates[-1]

    def sync_target(self) -> None:
        self.tape.append("sync_target")
        super().sync_target()


class Story(NamedTuple):
    """A training of Algorithm 1 on a script, and the parts it was handed."""

    training: Training
    env: ScriptedEnv
    buffer: Any
    learner: TapedLearner
    tape: list[str]


def always(action: int) -> LearnedDriver:
    """A driver to which one action is worth 1 more than any other."""
    values = np.zeros(12, np.float32)
    values[action] = 1.0
    return LearnedDriver(lambda s: values.copy())


def story(script: list[Step], **learning: Any) -> Story:
    tape: list[str] = []
    config = Config().updated("learning", **{"episodes": 10, "batch_size": 8} | learning)
    env, learner, rng = ScriptedEnv(script, config, tape), TapedLearner(tape), np.random
    generator = rng.default_rng(config.learning.seed)
    buffer = make_buffer(config.learning, N)
    for name in ("add_collision", "add_safe", "sample"):
        record(buffer, name, tape)
    scripted_env: Any = env
    training = Training(scripted_env, always(LEFT), learner, buffer, generator)
    return Story(training, env, buffer, learner, tape)


def record(buffer: Buffer, name: str, tape: list[str]) -> None:
    method = getattr(buffer, name)

    def taped(*arguments: Any) -> Any:
        tape.append(name)
        return method(*arguments)

    setattr(buffer, name, taped)


def test_episode_resets_then_acts_stores_and_learns_at_each_decision() -> None:
    training, _, _, _, tape = story([QUIET, OVERRULED, QUIET])
    training.run_episode()
    learn = ["sample", "update"]
    assert tape == [
        "reset",
        *("act", "add_safe", *learn),
        *("act", "add_collision", "add_safe", *learn),
        *("act", "add_safe", *learn),
    ]


def test_the_row_of_an_episode_counts_what_happened_in_it() -> None:
    script = [QUIET, OVERRULED, (None, Rule.NONE, -3.5, True)]
    training, env, _, learner, _ = story(script)
    env.scene = scene(ahead(30.0), ahead(90.0))
    row = training.run_episode()
    assert (row.episode, row.seed, row.vehicles, row.decisions) == (1, env.seeds[0], 2, 3)
    assert row.mean_reward == pytest.approx((-0.5 - 0.5 - 3.5) / 3)
    assert row.mean_speed_m_s == 20.0
    assert (row.safety_triggers, row.collided, row.ego_hit) == (1, True, True)
    assert (row.epsilon, row.mean_loss) == (1.0, np.mean([u.loss for u in learner.updates]))


def test_the_evaluations_of_a_training_do_not_explore(monkeypatch: pytest.MonkeyPatch) -> None:
    training, *_ = story([QUIET] * 3, epsilon_start=1, epsilon_end=1)
    training.run_episode()
    driven: list[int] = []
    result = EpisodeResult(*[0] * (len(fields(EpisodeResult)) - 3))  # type: ignore[arg-type]

    def drive(env: Any, driver: Any, *_: Any) -> EpisodeResult:
        driven.append(driver.act(ALONE, observed(0)).number)
        return result

    monkeypatch.setattr(module, "drive", drive)
    training.evaluate()
    assert driven == [LEFT] * 10


def test_epsilon_1_takes_every_action_and_epsilon_0_the_greedy_one() -> None:
    training, _, buffer, _, _ = story([QUIET] * 200, epsilon_start=1, epsilon_end=0)
    training.run_episode()
    assert set(buffer.safe.rows["a_t"][:200]) == set(range(12))
    for _ in range(9):
        training.run_episode()
    assert set(buffer.safe.rows["a_t"][-200 + len(buffer.safe) : len(buffer.safe)]) == {LEFT}


def test_truncation_keeps_gamma() -> None:
    training, _, buffer, _, _ = story([QUIET] * 3)
    training.run_episode()
    assert buffer.safe.rows["discount"][:3].tolist() == [np.float32(0.9)] * 3


def test_without_unsafe_proposals_and_collisions_it_is_plain_double_dqn() -> None:
    twins = []
    for replay in ("two-buffer", "uniform"):
        training, _, _, learner, _ = story(
            [QUIET, (None, Rule.NONE, -0.1, False)] * 5, replay=replay
        )
        for _ in range(4):
            training.run_episode()
        twins.append(learner.state())
    for name in twins[0]:
        np.testing.assert_array_equal(twins[0][name], twins[1][name])


@pytest.mark.parametrize("mirrored", [False, True])
def test_prioritized_rows_have_the_priority_of_their_last_error(mirrored: bool) -> None:
    # four rows are stored: quiet, the proposal, what was executed, quiet
    options: dict[str, Any] = {"replay": "prioritized", "priority_exponent": 1.0}
    options["mirrored"] = mirrored
    training, _, buffer, learner, _ = story([QUIET, OVERRULED, QUIET], **options)
    batches: list[Batch] = []
    sample = buffer.sample

    def watched(*arguments: Any) -> Batch:
        batches.append(sample(*arguments))
        return batches[-1]

    buffer.sample = watched
    training.run_episode()
    expected = np.ones(4)
    for batch, update in zip(batches, learner.updates, strict=True):
        for slot, error in zip(batch.slots, update.td_errors.astype(float), strict=True):  # type: ignore[arg-type]
            expected[slot] = abs(error) + 1e-6
    assert len(batches) == 3
    assert expected.max() > 2.0 > expected.min()
    np.testing.assert_array_equal(buffer.tree.weights[:4], expected)


def test_importance_exponent_rises_with_the_episodes() -> None:
    training, _, buffer, _, _ = story([QUIET], replay="prioritized", importance_exponent_start=0.5)
    found = []
    for _ in range(10):
        training.run_episode()
        found.append(buffer.importance_exponent)
    assert found == pytest.approx([0.5 + 0.05 * k for k in range(10)])


@pytest.mark.parametrize("replay", REPLAYS)
def test_state_of_every_replay_makes_the_round_trip(replay: str) -> None:
    script = [QUIET, OVERRULED, (None, Rule.NONE, -7.0, True)]
    options: dict[str, Any] = {"replay": replay, "safe_capacity": 20, "collision_capacity": 5}
    alone, begun, resumed = (story(script, **options).training for _ in range(3))
    for _ in range(10):
        alone.run_episode()
    for _ in range(6):
        begun.run_episode()
    resumed.restore(*begun.state())
    for _ in range(4):
        resumed.run_episode()
    (ours, numbers), (theirs, their_numbers) = alone.state(), resumed.state()
    assert numbers == their_numbers
    assert {k: v.tobytes() for k, v in ours.items()} == {k: v.tobytes() for k, v in theirs.items()}


def test_gradient_steps_follow_each_decision() -> None:
    training, _, _, _, tape = story([QUIET], gradient_steps=3)
    training.run_episode()
    assert tape == ["reset", "act", "add_safe", *["sample", "update"] * 3]


@pytest.mark.parametrize("replay", REPLAYS)
def test_nothing_is_learnt_in_an_episode_that_begins_with_too_few_collisions(replay: str) -> None:
    training, _, _, _, tape = story([OVERRULED, QUIET], replay=replay, collisions_to_start=2)
    for _ in range(3):
        training.run_episode()
    episodes = "".join({"reset": "r", "update": "u"}.get(entry, "") for entry in tape)
    assert episodes == "rrruu"


def test_at_no_learning_rate_nothing_is_learnt() -> None:
    training, _, _, _, tape = story([QUIET], learning_rate=0)
    assert training.run_episode().mean_loss == 0.0
    assert tape == ["reset", "act", "add_safe"]


def test_the_learning_rate_falls_linearly_to_a_share_that_it_does_not_reach() -> None:
    options = {"learning_rate": 1e-2, "learning_rate_end_fraction": 0.2}
    training, _, _, learner, _ = story([QUIET], **options)
    found = []
    for _ in range(10):
        training.run_episode()
        found.append(learner.learning_rate)
    assert found == pytest.approx([1e-2 * (1 - 0.08 * k) for k in range(10)])


def test_epsilon_falls_from_1_to_two_tenths_over_70_percent_of_the_episodes() -> None:
    """Sec. IV-C."""
    training, *_ = story([QUIET])
    rows = [training.run_episode() for _ in range(10)]
    falling = [1 - 0.8 * k / 7 for k in range(8)]
    assert [row.epsilon for row in rows] == pytest.approx([*falling, 0.2, 0.2])


def test_target_network_follows_every_n_c_episodes() -> None:
    training, _, _, _, tape = story([QUIET], target_update_episodes=3)
    for _ in range(7):
        training.run_episode()
    episodes = "".join({"reset": "r", "sync_target": "s"}.get(entry, "") for entry in tape)
    assert episodes == "rrrsrrrsr"


Driven = list[tuple[int, int]]


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> Driven:
    """Seed and number of vehicles of each evaluation episode, none of which is driven."""
    found: Driven = []

    def drive(env: Any, driver: Any, name: str, seed: int, vehicles: int) -> SimpleNamespace:
        found.append((seed, vehicles))
        names = ("mean_reward", "mean_r_v", "mean_r_y", "mean_r_x", "mean_speed_m_s")
        counts = ("collided", "ego_hit", "safety_triggers")
        return SimpleNamespace(**dict.fromkeys((*names, *counts), 1))

    monkeypatch.setattr(module, "drive", drive)
    return found


def test_training_never_meets_the_traffic_of_an_evaluation(driven: Driven) -> None:
    training, env, *_ = story([QUIET], episodes=50)
    for _ in range(50):
        training.run_episode()
    assert min(env.seeds) >= TRAINING_SEED_RANGE[0] == 1_000_000
    assert len(set(env.seeds)) == 50
    assert env.options == [None] * 50  # on a loop the seed determines the number of vehicles
    training.evaluate()
    again = driven.copy()
    training.evaluate()
    assert driven == again * 2
    assert [seed for seed, _ in again] == list(range(EVALUATION_SEEDS, EVALUATION_SEEDS + 10))
    assert max(seed for seed, _ in again) < TRAINING_SEED_RANGE[0]
    # evenly from 1 to 30, at whole numbers: 1 + 29 n / 9
    assert [vehicles for _, vehicles in again] == [1, 4, 7, 11, 14, 17, 20, 24, 27, 30]


def test_on_an_open_road_episodes_begin_with_every_number_of_vehicles_up_to_the_most_of_their_kind(
    driven: Driven,
) -> None:
    training, env, *_ = story([QUIET], episodes=200)
    env.fleet_of = lambda seed: SimpleNamespace(most_in_training=8 - 6 * (seed % 2), placed=None)
    for _ in range(200):
        training.run_episode()
    for odd, most in ((0, 8), (1, 2)):
        drawn = zip(env.seeds, env.options, strict=True)
        found = {options["vehicles"] for seed, options in drawn if seed % 2 == odd}
        assert found == set(range(most + 1))
    training.evaluate()  # 8 n / 9 of 8 vehicles for an even n, 2 n / 9 for an odd one
    assert [vehicles for _, vehicles in driven] == [0, 0, 2, 1, 4, 1, 5, 2, 7, 2]


def test_where_the_scenario_places_the_vehicles_each_episode_has_these(driven: Driven) -> None:
    training, env, *_ = story([QUIET], episodes=3)
    env.fleet_of = lambda seed: SimpleNamespace(most_in_training=None, placed=4)
    training.run_episode()
    training.evaluate()
    assert env.options == [None]
    assert {vehicles for _, vehicles in driven} == {4}


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    """One real SUMO for all, so that what ran before must not matter."""
    with closing(HighwayEnv(config=small(0))) as env:
        yield env


def small(seed: int) -> Config:
    config = Config().updated("simulation", decisions_per_episode=15)
    schedule = {"evaluate_every": 2, "checkpoint_every": 3, "evaluation_episodes": 1}
    return config.updated("learning", seed=seed, episodes=4, **schedule)


def trained(folder: Path, env: HighwayEnv, seed: int) -> dict[str, bytes]:
    env.config = small(seed)
    run = Run(folder)
    training = build_training(env)
    run.create(training)
    list(train(run, training))
    return files_of(folder)


def test_two_trainings_of_one_seed_write_equal_files(env: HighwayEnv, tmp_path: Path) -> None:
    first = trained(tmp_path / "first", env, seed=7)
    other = trained(tmp_path / "other", env, seed=8)
    second = trained(tmp_path / "second", env, seed=7)
    assert first == second
    assert set(first) == {
        *("config.toml", "episodes.csv", "evaluations.csv"),
        *("checkpoint.safetensors", "policy.safetensors"),
    }
    assert [name for name in first if first[name] == other[name]] == []
