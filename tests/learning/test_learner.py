import copy

import numpy as np
import pytest
import torch

from drl_av.drivers.network import QNetwork, forward
from drl_av.learning.learner import Learner, backward, double_q_target, q_gradient, td_error
from drl_av.learning.replay import Batch


def random_batch(rng: np.random.Generator, rows: int = 64, ended: float = 0.5) -> Batch:
    return Batch(
        s_t=rng.standard_normal((rows, 27)).astype(np.float32),
        a_t=rng.integers(0, 12, rows),
        r_tp1=rng.standard_normal(rows).astype(np.float32),
        discount=np.where(rng.random(rows) < ended, 0.0, 0.9).astype(np.float32),
        s_tp1=rng.standard_normal((rows, 27)).astype(np.float32),
    )


def learner(learning_rate: float = 1e-3, seed: int = 0) -> Learner:
    return Learner(QNetwork(np.random.default_rng(seed)), learning_rate)


def test_online_network_selects_and_target_network_values():
    q_next_online = np.float32([[1.0, 3.0, 2.0], [5.0, 0.0, 4.0]])
    q_next_target = np.float32([[9.0, 2.0, 4.0], [1.0, 7.0, 3.0]])
    r_tp1, discount = np.float32([0.5, -1.0]), np.float32([0.9, 0.9])
    # Online picks actions 1 and 0, which the target network values 2 and 1.
    # DQN's max over the target: 8.6, 5.3; online values alone: 3.2, 3.5.
    target = double_q_target(r_tp1, discount, q_next_online, q_next_target)
    assert np.allclose(target, [0.5 + 0.9 * 2.0, -1.0 + 0.9 * 1.0])


def test_error_is_target_minus_the_value_of_the_action_taken():
    q_t = np.float32([[1.0, 4.0], [2.0, 8.0]])
    assert td_error(np.float32([3.0, 3.0]), q_t, np.array([1, 0])).tolist() == [-1.0, 1.0]


def test_only_the_action_taken_is_pulled_towards_its_target():
    # d/dQ of ((y - Q)^2 + ...) / 2 with y - Q = -1 and 3: -2 * -1 / 2 and -2 * 3 / 2.
    gradient = q_gradient(np.float32([-1.0, 3.0]), np.array([1, 0]), 3)
    assert gradient.tolist() == [[0.0, 1.0, 0.0], [-3.0, 0.0, 0.0]]


def reference(network: QNetwork, learning_rate: float):
    """The same update by torch's own autograd and Adam, a target for every row."""
    online = torch.nn.Sequential(
        torch.nn.Linear(27, 100),
        torch.nn.LeakyReLU(0.01),
        torch.nn.Linear(100, 100),
        torch.nn.LeakyReLU(0.01),
        torch.nn.Linear(100, 12),
    ).to(torch.from_numpy(network.flat).dtype)
    with torch.no_grad():
        for ours, theirs in zip(network.tensors().values(), online.parameters(), strict=True):
            theirs.copy_(torch.from_numpy(ours))
    target = copy.deepcopy(online)
    optimizer = torch.optim.Adam(online.parameters(), lr=learning_rate)

    def update(batch: Batch) -> float:
        s_t, a_t, r_tp1, discount, s_tp1 = (torch.from_numpy(x) for x in batch[:5])
        with torch.no_grad():
            a_next = online(s_tp1).argmax(1, keepdim=True)
            y = r_tp1 + discount * target(s_tp1).gather(1, a_next)[:, 0]
        error = (y - online(s_t).gather(1, a_t[:, None])[:, 0]) ** 2
        weights = 1.0 if batch.weights is None else torch.from_numpy(batch.weights)
        loss = (weights * error).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.item()

    return online, target, update


@pytest.mark.parametrize("ended", [0.0, 0.5, 1.0])
def test_written_out_update_equals_autograd_and_torchs_adam_over_300_steps(ended):
    # In float64, because in float32 one argmax that rounds the other way parts the two for good.
    network = QNetwork(np.random.default_rng(0))
    network.flat = network.flat.astype(np.float64)
    ours = Learner(network, 1e-3)
    online, target, update = reference(network, 1e-3)
    rng = np.random.default_rng(1)
    for step in range(300):
        batch = random_batch(rng, ended=ended)
        if step % 2:
            batch = batch._replace(weights=rng.random(64))
        batch = Batch(*(x if x is None or x.dtype.kind == "i" else x.astype(float) for x in batch))
        assert ours.update(batch).loss == pytest.approx(update(batch), rel=1e-9)
        if step % 50 == 49:
            ours.sync_target()
            target.load_state_dict(online.state_dict())
    for mine, theirs in zip(network.tensors().values(), online.parameters(), strict=True):
        assert np.allclose(mine, theirs.detach().numpy(), atol=1e-10, rtol=1e-9)


@pytest.mark.parametrize("kernel", [torch._fused_adam_, None], ids=["kernel", "public"])
def test_a_step_has_the_bits_of_torchs_fused_adam(kernel, monkeypatch):
    monkeypatch.setattr("drl_av.learning.learner.FUSED_ADAM", kernel)
    # all rows are terminal, so that the target is the reward, whatever the networks are
    ours, rng = learner(), np.random.default_rng(5)
    flat = torch.nn.Parameter(torch.from_numpy(ours.network.flat.copy()))
    adam = torch.optim.Adam([flat], lr=1e-3, fused=True)
    flat.grad = torch.zeros_like(flat)
    split, parameters, gradients = ours.network.split, flat.detach().numpy(), flat.grad.numpy()
    for _ in range(100):
        batch = random_batch(rng, ended=1.0)
        ours.update(batch)
        entered, q_t = forward(split(parameters), batch.s_t)
        td = td_error(batch.r_tp1, q_t, batch.a_t)
        backward(split(parameters), entered, q_gradient(td, batch.a_t, 12), split(gradients))
        adam.step()
        assert ours.network.flat.tobytes() == parameters.tobytes()


def test_a_collision_row_ignores_its_next_state_whatever_stands_there():
    rng = np.random.default_rng(2)
    batch = random_batch(rng)
    nonsense = batch.s_tp1.copy()
    nonsense[batch.discount == 0.0] = np.nan
    first, second = learner(), learner()
    assert first.update(batch).loss == second.update(batch._replace(s_tp1=nonsense)).loss
    assert np.array_equal(first.network.flat, second.network.flat)


def test_an_update_returns_the_loss_and_the_errors_row_by_row():
    ours = learner()
    batch = random_batch(np.random.default_rng(2), ended=1.0)
    q_t = forward(ours.network.layers, batch.s_t)[1]
    loss, td_errors = ours.update(batch)
    assert np.allclose(td_errors, batch.r_tp1 - q_t[np.arange(64), batch.a_t], atol=1e-6)
    assert loss == pytest.approx(np.mean(td_errors**2), rel=1e-5)


def learn(ours: Learner, rng: np.random.Generator, steps: int) -> None:
    for step in range(steps):
        ours.update(random_batch(rng))
        if step % 7 == 0:
            ours.sync_target()


def state_bytes(ours: Learner) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in ours.state().items()}


def test_two_runs_end_in_the_same_bytes_wherever_their_batches_lie_in_memory():
    first, second = learner(), learner()
    learn(first, np.random.default_rng(3), 200)
    rng = np.random.default_rng(3)
    for step in range(200):
        batch = random_batch(rng)
        shifted = []
        for part in batch[:5]:
            room = np.empty(part.size + 1 + step % 5, part.dtype)[1 + step % 5 :]
            shifted.append(room.reshape(part.shape))
            shifted[-1][...] = part
        second.update(Batch(*shifted))
        if step % 7 == 0:
            second.sync_target()
    assert state_bytes(first) == state_bytes(second)


def test_a_restored_learner_continues_bit_for_bit():
    first, second = learner(), learner(seed=8)
    learn(first, np.random.default_rng(3), 50)
    second.restore(first.state())
    assert state_bytes(first) == state_bytes(second)
    for each in (first, second):
        learn(each, np.random.default_rng(4), 50)
    assert state_bytes(first) == state_bytes(second)
    assert np.array_equal(first.network.flat, second.network.flat)


@pytest.mark.parametrize("damage", ["missing", "short", "float64"])
def test_a_state_that_does_not_fit_is_refused(damage):
    ours, state = learner(), learner(seed=8).state()
    if damage == "missing":
        del state["step"]
    elif damage == "short":
        state["target"] = state["target"][:-1]
    else:
        state["second_moment"] = state["second_moment"].astype(np.float64)
    with pytest.raises((KeyError, TypeError, ValueError)):
        ours.restore(state)
