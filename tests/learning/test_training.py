"""Algorithm 1, line by line on a world without SUMO, and from its seed on with SUMO."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from worlds import ALONE

from drl_av.config import REPLAYS, Config
from drl_av.driving.affordances import INDICATORS
from drl_av.env.episode import TRAINING_SEEDS
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import ConfigError
from drl_av.learning import training as module
from drl_av.learning.buffers import Batch, TwoBuffers, UniformBuffer
from drl_av.learning.run import Run, train
from drl_av.learning.training import EVALUATION_SEEDS, Training
from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import Collision, CollisionKind

KEEP, HARD_BRAKE, LEFT = 0, 3, 8
R_COL = Config().reward.collision_reward
GAMMA = Config().learning.discount
HIT = Collision(CollisionKind.HIT_AHEAD, "vehicle1")


def affordances(t: int) -> np.ndarray:
    return np.full(len(INDICATORS), t / 8, np.float32)


class ScriptedEnv:
    """Each decision goes as the script has it: (executed action, rule, reward, terminated)."""

    def __init__(
        self, script: list[tuple[int | None, str, float, bool]], config: Config, tape: list[str]
    ) -> None:
        self.script, self.config, self.tape = script, config, tape
        self.seeds: list[int] = []

    simulation = SimpleNamespace(placed_vehicles=None)
    road = Road(500.0, 3.8, (True, True, True))
    scene = None

    def require_room(self) -> None:
        """There is room for any number of vehicles on the script."""

    def reset(self, *, seed: int) -> tuple[np.ndarray, dict[str, Any]]:
        self.tape.append("reset")
        self.seeds.append(seed)
        self.t = 0
        return affordances(0), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.tape.append("act")
        executed, rule, reward, terminated = self.script[self.t]
        self.t += 1
        info = {
            "rule": rule,
            "proposed_action": action,
            "executed_action": action if executed is None else executed,
            "speed_m_s": 20.0,
            "collision": HIT if terminated else None,
            "vehicles": 3,
        }
        return affordances(self.t), reward, terminated, self.t == len(self.script), info


QUIET = (None, "none", -0.5, False)


def scripted(
    script: list[tuple[int | None, str, float, bool]], **learning: Any
) -> tuple[Training, list[str], ScriptedEnv]:
    """A training on the script, with a tape of what it does to its buffers and its learner."""
    tape: list[str] = []
    config = Config().updated("learning", **{"episodes": 10, "batch_size": 8} | learning)
    env = ScriptedEnv(script, config, tape)
    training = Training(env)  # type: ignore[arg-type]
    for owner, name in (
        (training._buffer, "add_collision"),
        (training._buffer, "add_safe"),
        (training._buffer, "sample"),
        (training._learners["learner"], "update"),
        (training._learners["learner"], "sync_target"),
    ):
        record(owner, name, tape)
    return training, tape, env


def record(owner: Any, name: str, tape: list[str]) -> None:
    method = getattr(owner, name)

    def taped(*arguments: Any) -> Any:
        tape.append(name)
        return method(*arguments)

    setattr(owner, name, taped)


def always(action: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "epsilon_greedy", lambda *_: action)


def test_episode_resets_then_acts_remembers_and_learns_at_each_decision() -> None:
    training, tape, _ = scripted([QUIET, (HARD_BRAKE, "gap", -0.5, False), QUIET])
    training.run_episode()
    learn = ["sample", "update"]
    assert tape == [
        "reset",
        *("act", "add_safe", *learn),
        *("act", "add_collision", "add_safe", *learn),
        *("act", "add_safe", *learn),
    ]


def test_it_learns_from_lane_changes_that_its_driver_does_not_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    training, _, _ = scripted([QUIET] * 3, lane_change_margin=2.0, epsilon_start=0, epsilon_end=0)
    training.networks[0].flat[:] = 0
    training.networks[0].flat[-12 + LEFT] = 1.0  # worth 1 more than any other in every state
    training.run_episode()
    rows = training._buffer.safe.rows  # type: ignore[attr-defined]
    assert rows[:3, -3].tolist() == [LEFT] * 3

    driven: list[int] = []
    result = EpisodeResult(*[0] * len(fields(EpisodeResult)))  # type: ignore[arg-type]

    def drive(env: Any, driver: Any, *_: Any) -> EpisodeResult:
        driven.append(driver.act(ALONE, affordances(0)).number)
        return result

    monkeypatch.setattr(module, "drive", drive)
    training.evaluate()
    assert driven == [KEEP] * 10


def test_unsafe_proposal_is_a_collision_and_the_executed_action_is_safe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always(LEFT, monkeypatch)
    training, _, _ = scripted([QUIET, (HARD_BRAKE, "gap", -0.25, False)])
    training.run_episode()
    safe, collision = training._buffer.safe, training._buffer.collision  # type: ignore[attr-defined]
    assert len(safe) == 2
    assert len(collision) == 1
    n = len(INDICATORS)
    np.testing.assert_array_equal(collision.rows[0, :n], affordances(1))
    assert collision.rows[0, -3:].tolist() == [LEFT, R_COL, 0.0]
    np.testing.assert_array_equal(safe.rows[1, :n], affordances(1))
    np.testing.assert_array_equal(safe.rows[1, n:-3], affordances(2))
    assert safe.rows[1, -3:].tolist() == [HARD_BRAKE, -0.25, np.float32(GAMMA)]


def test_collision_goes_to_the_collision_buffer_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    always(LEFT, monkeypatch)
    training, _, _ = scripted([QUIET, (None, "none", -7.0, True)])
    row = training.run_episode()
    safe, collision = training._buffer.safe, training._buffer.collision  # type: ignore[attr-defined]
    assert (len(safe), len(collision)) == (1, 1)
    assert collision.rows[0, -3:].tolist() == [LEFT, R_COL, 0.0]
    assert (row.collided, row.ego_hit, row.decisions) == (True, True, 2)


def test_collision_of_an_overruled_proposal_blames_the_executed_action_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always(LEFT, monkeypatch)
    training, _, _ = scripted([(HARD_BRAKE, "gap", R_COL, True)])
    training.run_episode()
    collision = training._buffer.collision  # type: ignore[attr-defined]
    assert collision.rows[:2, -3].tolist() == [LEFT, HARD_BRAKE]


def test_under_a_penalty_an_unsafe_proposal_goes_on_as_what_was_executed_in_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always(LEFT, monkeypatch)
    training, _, _ = scripted([QUIET, (HARD_BRAKE, "gap", -0.25, False)], unsafe_penalty=1.5)
    training.run_episode()
    collision = training._buffer.collision  # type: ignore[attr-defined]
    assert len(collision) == 1
    n = len(INDICATORS)
    np.testing.assert_array_equal(collision.rows[0, :n], affordances(1))
    np.testing.assert_array_equal(collision.rows[0, n:-3], affordances(2))
    assert collision.rows[0, -3:].tolist() == [LEFT, -1.75, np.float32(GAMMA)]


def test_under_a_penalty_a_collision_is_an_ending_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always(LEFT, monkeypatch)
    training, _, _ = scripted([(HARD_BRAKE, "gap", R_COL, True)], unsafe_penalty=1.5)
    training.run_episode()
    collision = training._buffer.collision  # type: ignore[attr-defined]
    assert collision.rows[:2, -3:].tolist() == [[LEFT, R_COL, 0.0], [HARD_BRAKE, R_COL, 0.0]]


def test_the_weight_of_speed_is_learnt_and_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    # at 20 of at most 30 m/s: 0.6 * 2 / 3
    always(LEFT, monkeypatch)
    script = [QUIET, (HARD_BRAKE, "gap", -0.25, False), (None, "none", R_COL, True)]
    training, _, _ = scripted(script, speed_weight=0.6, unsafe_penalty=1.0)
    row = training.run_episode()
    safe, collision = training._buffer.safe, training._buffer.collision  # type: ignore[attr-defined]
    assert safe.rows[:2, -2] == pytest.approx([-0.1, 0.15])
    assert collision.rows[:2, -2] == pytest.approx([-0.85, R_COL])
    assert row.mean_reward == pytest.approx((-0.5 - 0.25 + R_COL) / 3)


@pytest.mark.parametrize("replay", ["prioritized", "uniform"])
def test_in_one_ring_it_is_a_row_among_others(replay: str, monkeypatch: pytest.MonkeyPatch) -> None:
    always(LEFT, monkeypatch)
    script = [(HARD_BRAKE, "gap", -0.25, False)]
    training, _, _ = scripted(script, replay=replay, unsafe_penalty=1.5)
    training.run_episode()
    rows = training._buffer.ring.rows[:2, -3:]  # type: ignore[attr-defined]
    gamma = np.float32(GAMMA)
    assert rows.tolist() == [[LEFT, -1.75, gamma], [HARD_BRAKE, -0.25, gamma]]
    assert training._buffer.collisions == 0


@pytest.mark.parametrize("replay", ["prioritized", "uniform"])
def test_what_cannot_be_counted_is_not_waited_for(replay: str) -> None:
    waiting = Config().updated("learning", collisions_to_start=64, unsafe_penalty=1.0)
    with pytest.raises(ConfigError, match=f"cannot be counted in {replay} replay"):
        waiting.updated("learning", replay=replay)


def test_truncation_keeps_gamma() -> None:
    training, _, _ = scripted([QUIET] * 3)
    training.run_episode()
    safe = training._buffer.safe  # type: ignore[attr-defined]
    assert safe.rows[:3, -1].tolist() == [np.float32(GAMMA)] * 3


def test_without_unsafe_proposals_and_collisions_it_is_plain_double_dqn() -> None:
    twins = []
    for replay in ("two-buffer", "uniform"):
        training, _, _ = scripted([QUIET, (None, "none", -0.1, False)] * 5, replay=replay)
        for _ in range(4):
            training.run_episode()
        twins.append(training)
    assert isinstance(twins[0]._buffer, TwoBuffers)
    assert isinstance(twins[1]._buffer, UniformBuffer)
    ours, plain = (twin._learners["learner"].state() for twin in twins)
    for name in ours:
        np.testing.assert_array_equal(ours[name], plain[name])


@pytest.mark.parametrize("mirrored", [False, True])
def test_prioritized_rows_have_the_priority_of_their_last_error(mirrored: bool) -> None:
    script = [QUIET, (HARD_BRAKE, "gap", -0.25, False), QUIET]
    options = {"replay": "prioritized", "mirrored": mirrored, "priority_exponent": 1.0}
    training, _, _ = scripted(script, **options)
    sample, expected = training._buffer.sample, np.ones(4)

    def watched(*arguments: Any) -> Batch:
        errors = training._learners["learner"].td_errors.astype(float)
        for slot, error in zip(batches[-1].slots if batches else (), errors, strict=True):  # type: ignore[arg-type]
            expected[slot] = abs(error) + 1e-6
        batches.append(sample(*arguments))
        return batches[-1]

    batches: list[Batch] = []
    training._buffer.sample = watched  # type: ignore[method-assign]
    training.run_episode()
    watched(8, np.random.default_rng(0))
    assert len(batches) == 4
    assert expected.max() > 2.0 > expected.min()
    weights = training._buffer.tree.weights  # type: ignore[attr-defined]
    np.testing.assert_array_equal(weights[:4], expected)


def test_importance_exponent_rises_with_the_episodes() -> None:
    training, _, _ = scripted([QUIET], replay="prioritized", importance_exponent_start=0.5)
    found = []
    for _ in range(10):
        training.run_episode()
        found.append(training._buffer.importance_exponent)  # type: ignore[attr-defined]
    assert found == pytest.approx([0.5 + 0.05 * k for k in range(10)])


@pytest.mark.parametrize("penalty", [0.0, 1.5])
@pytest.mark.parametrize("replay", REPLAYS)
def test_state_of_every_replay_makes_the_round_trip(replay: str, penalty: float) -> None:
    script = [QUIET, (HARD_BRAKE, "gap", -0.25, False), (None, "none", -7.0, True)]
    options = {"replay": replay, "safe_capacity": 20, "collision_capacity": 5}
    options["unsafe_penalty"] = penalty
    alone, _, _ = scripted(script, **options)
    begun, _, _ = scripted(script, **options)
    for _ in range(10):
        alone.run_episode()
    for _ in range(6):
        begun.run_episode()
    resumed, _, _ = scripted(script, **options)
    resumed.restore(*begun.state())
    for _ in range(4):
        resumed.run_episode()
    (ours, numbers), (theirs, their_numbers) = alone.state(), resumed.state()
    assert numbers == their_numbers
    assert {k: v.tobytes() for k, v in ours.items()} == {k: v.tobytes() for k, v in theirs.items()}


def test_gradient_steps_follow_each_decision() -> None:
    training, tape, _ = scripted([QUIET], gradient_steps=3)
    training.run_episode()
    assert tape == ["reset", "act", "add_safe", *["sample", "update"] * 3]


@pytest.mark.parametrize("replay", REPLAYS)
def test_nothing_is_learnt_in_an_episode_that_begins_with_too_few_collisions(replay: str) -> None:
    script = [(HARD_BRAKE, "gap", -0.5, False), QUIET]
    training, tape, _ = scripted(script, replay=replay, collisions_to_start=2)
    for _ in range(3):
        training.run_episode()
    episodes = "".join({"reset": "r", "update": "u"}.get(entry, "") for entry in tape)
    assert episodes == "rrruu"


def test_at_no_learning_rate_nothing_is_learnt() -> None:
    training, tape, _ = scripted([QUIET], learning_rate=0)
    assert training.run_episode().mean_loss == 0.0
    assert tape == ["reset", "act", "add_safe"]


def test_traffic_by_episode_does_not_depend_on_what_is_learnt_or_drawn() -> None:
    learning, _, env = scripted([QUIET] * 3, traffic_by_episode=True)
    frozen, _, other = scripted([QUIET], traffic_by_episode=True, learning_rate=0)
    another, _, third = scripted([QUIET], traffic_by_episode=True, seed=1)
    for training in (learning, frozen, another):
        for _ in range(9):
            training.run_episode()
    assert env.seeds == other.seeds
    assert len(set(env.seeds) | set(third.seeds)) == 18
    assert min(env.seeds) >= TRAINING_SEEDS[0]


def test_epsilon_falls_from_1_to_two_tenths_over_70_percent_of_the_episodes() -> None:
    training, _, _ = scripted([QUIET])
    rows = [training.run_episode() for _ in range(10)]
    falling = [1 - 0.8 * k / 7 for k in range(8)]
    assert [row.epsilon for row in rows] == pytest.approx([*falling, 0.2, 0.2])


def test_target_network_follows_every_n_c_episodes() -> None:
    training, tape, _ = scripted([QUIET], target_update_episodes=3)
    for _ in range(7):
        training.run_episode()
    episodes = "".join({"reset": "r", "sync_target": "s"}.get(entry, "") for entry in tape)
    assert episodes == "rrrsrrrsr"


def test_training_never_meets_the_traffic_of_an_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    training, _, env = scripted([QUIET], episodes=50)
    for _ in range(50):
        training.run_episode()
    assert min(env.seeds) >= TRAINING_SEEDS[0] == 1_000_000
    assert len(set(env.seeds)) == 50
    driven: list[tuple[int, int]] = []

    def drive(env: Any, driver: Any, name: str, seed: int, vehicles: int) -> SimpleNamespace:
        driven.append((seed, vehicles))
        names = ("mean_reward", "mean_r_v", "mean_r_y", "mean_r_x", "mean_speed_m_s")
        counts = ("collided", "ego_hit", "safety_triggers")
        return SimpleNamespace(**dict.fromkeys((*names, *counts), 1))

    monkeypatch.setattr(module, "drive", drive)
    training.evaluate()
    again = driven.copy()
    training.evaluate()
    assert driven == again * 2
    assert [seed for seed, _ in again] == list(range(EVALUATION_SEEDS, EVALUATION_SEEDS + 10))
    assert max(seed for seed, _ in again) < TRAINING_SEEDS[0]
    assert (again[0][1], again[-1][1]) == (1, 30)


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    """One real SUMO for all, so that what ran before must not matter."""
    with closing(HighwayEnv(config=small(0))) as env:
        yield env


def small(seed: int) -> Config:
    config = Config().updated("simulation", decisions_per_episode=15)
    schedule = {"evaluate_every": 2, "checkpoint_every": 3, "evaluation_episodes": 1}
    return config.updated("learning", seed=seed, episodes=4, **schedule)


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def trained(folder: Path, env: HighwayEnv, seed: int) -> dict[str, bytes]:
    env.config = small(seed)
    run = Run(folder)
    run.create(env.config)
    list(train(run, Training(env)))
    return files_of(folder)


def test_two_trainings_of_one_seed_write_equal_files(env: HighwayEnv, tmp_path: Path) -> None:
    first = trained(tmp_path / "first", env, seed=7)
    other = trained(tmp_path / "other", env, seed=8)
    second = trained(tmp_path / "second", env, seed=7)
    assert first == second
    assert set(first) == {
        "config.toml",
        "episodes.csv",
        "evaluations.csv",
        "checkpoint.safetensors",
        "policy.safetensors",
    }
    assert [name for name in first if first[name] == other[name]] == []
