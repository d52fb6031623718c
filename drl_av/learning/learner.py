"""The gradient step of Algorithm 1 of the paper, lines 14 and 15.

The functions are pure, except ``backward``; a Learner holds the networks and Adam's moments. The
forward and backward passes are written in numpy, because for 64 rows autograd and the calls of
torch cost more time than the arithmetic.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from drl_av.arrays import Float32Array, IntArray
from drl_av.compiled import compiled
from drl_av.drivers.network import Layers, QNetwork, activate_backward, forward
from drl_av.drivers.policy_file import State
from drl_av.errors import needed_by
from drl_av.learning.replay import Batch

with needed_by("Training", "torch", "'drl-av[train]'"):
    import torch
    from torch import Tensor
    from torch.optim.adam import adam

ADAM: dict[str, Any] = {
    "amsgrad": False,
    "beta1": 0.9,
    "beta2": 0.999,
    "weight_decay": 0.0,
    "eps": 1e-8,
    "maximize": False,
}
"""The arguments of Adam besides the learning rate: torch's defaults."""
FUSED_ADAM: Callable[..., None] | None = getattr(torch, "_fused_adam_", None)
"""The kernel of torch's fused Adam; None if this version of torch has no such function."""


@compiled
def double_q_target(
    r_tp1: Float32Array,
    discount: Float32Array,
    q_next_online: Float32Array,
    q_next_target: Float32Array,
) -> Float32Array:
    """Return the double Q-learning target, r + discount * Q^(s', argmax_a Q(s', a)), shape (rows,).

    The online network Q selects the next action and the target network Q^ evaluates it (Algorithm 1
    of the paper, line 14). The first two arguments have shape (rows,), the others (rows, actions).
    """
    target = r_tp1.copy()
    for row in range(len(target)):
        a_next = q_next_online[row].argmax()
        target[row] += discount[row] * q_next_target[row, a_next]
    return target


@compiled
def td_error(target: Float32Array, q_t: Float32Array, a_t: IntArray) -> Float32Array:
    """Return the TD error y - Q(s, a) of each transition, shape (rows,).

    The target y has shape (rows,), ``q_t`` (rows, actions), ``a_t`` (rows,). Algorithm 1 of the
    paper, line 15.
    """
    td = target.copy()
    for row in range(len(td)):
        td[row] -= q_t[row, a_t[row]]
    return td


@compiled
def q_gradient(weighted_td: Float32Array, a_t: IntArray, action_size: int) -> Float32Array:
    """Return the gradient of the loss with respect to Q(s, .), shape (rows, action_size).

    The loss is the mean of w (y - Q(s, a))^2. The gradient is zero except for the action a.
    ``weighted_td``, shape (rows,), is w (y - Q(s, a)), with the weights w of the batch. Algorithm 1
    of the paper, line 15.
    """
    gradient = np.zeros((len(a_t), action_size), weighted_td.dtype)
    slope = weighted_td.dtype.type(-2.0 / len(a_t))
    for row in range(len(a_t)):
        gradient[row, a_t[row]] = weighted_td[row] * slope
    return gradient


def backward(
    layers: Layers, entered: list[Float32Array], dq: Float32Array, gradients: Layers
) -> None:
    """Compute the gradient of all weights and biases, and write it into ``gradients``.

    ``entered`` holds the input of each layer, the first result of ``forward``. ``dq`` is the
    gradient of the loss with respect to Q(s, .), shape (rows, actions).
    """
    dz = dq
    for i in reversed(range(len(layers))):
        d_weight, d_bias = gradients[i]
        np.matmul(dz.T, entered[i], out=d_weight)
        np.add.reduce(dz, axis=0, out=d_bias)
        if i:
            dz = dz @ layers[i][0]
            activate_backward(dz, entered[i])


class Update(NamedTuple):
    """The loss and TD errors of a gradient step, computed before it changes the network."""

    loss: float
    """The mean of the weighted squared TD errors."""
    td_errors: Float32Array
    """y - Q(s, a) of each transition, shape (rows,)."""


class Learner:
    """Trains one network: holds the online network, the target network and the moments of Adam.

    It limits numpy and torch to one thread for the rest of the process: more threads are slower for
    networks of this size, and one thread adds numbers in the same order in each run.
    """

    def __init__(self, network: QNetwork, learning_rate: float = 1e-4) -> None:
        threadpool_limits(1, "blas")
        torch.set_num_threads(1)
        self.network = network
        self.learning_rate = learning_rate
        self._online = torch.from_numpy(network.flat)
        self._target = self._online.clone()
        self._gradient = torch.zeros_like(self._online)
        self._first_moment = torch.zeros_like(self._online)
        self._second_moment = torch.zeros_like(self._online)
        self._step = torch.zeros(())
        self._counter = self._step.numpy()  # the same memory: torch's add_ is slower
        self._online_layers = network.layers
        self._target_layers = network.split(self._target.numpy())
        self._gradient_layers = network.split(self._gradient.numpy())

    def update(self, batch: Batch) -> Update:
        """Make one step of Adam on the mean squared TD error of a batch; return loss and TD errors.

        Algorithm 1 of the paper, lines 14 and 15. ``s_tp1`` of terminal rows (discount 0) is not
        read.
        """
        rows = len(batch.a_t)
        goes_on = batch.discount.nonzero()[0]
        s = np.concatenate((batch.s_t, batch.s_tp1[goes_on]))
        entered, q_online = forward(self._online_layers, s)
        _, q_next_target = forward(self._target_layers, s[rows:])
        q_t, q_next_online = q_online[:rows], q_online[rows:]

        target = batch.r_tp1.copy()
        target[goes_on] = double_q_target(
            batch.r_tp1[goes_on], batch.discount[goes_on], q_next_online, q_next_target
        )
        td = td_error(target, q_t, batch.a_t)
        weighted_td = td if batch.weights is None else td * batch.weights
        dq = q_gradient(weighted_td, batch.a_t, q_t.shape[1])
        backward(self._online_layers, [x[:rows] for x in entered], dq, self._gradient_layers)
        self._adam()
        return Update(float(weighted_td.dot(td)) / rows, td)

    def _adam(self) -> None:
        """Change the online network by one step of torch.optim.Adam(fused=True).

        It calls the kernel directly if this version of torch has it, because the public function
        around it takes more time than the step itself.
        """
        parameters = [self._online], [self._gradient]
        state = [self._first_moment], [self._second_moment], list[Tensor](), [self._step]
        if FUSED_ADAM is None:
            adam(*parameters, *state, fused=True, lr=self.learning_rate, **ADAM)
        else:
            self._counter += 1
            FUSED_ADAM(*parameters, *state, lr=self.learning_rate, **ADAM)

    def sync_target(self) -> None:
        """Copy the online network to the target network: Algorithm 1 of the paper, line 16."""
        self._target.copy_(self._online)

    def _tensors(self) -> dict[str, Tensor]:
        return {
            "online": self._online,
            "target": self._target,
            "first_moment": self._first_moment,
            "second_moment": self._second_moment,
            "step": self._step,
        }

    def state(self) -> State:
        """Return a copy of all tensors on which the next update depends, by name."""
        return {name: tensor.numpy().copy() for name, tensor in self._tensors().items()}

    def restore(self, state: State) -> None:
        """Set the learner to exactly the state that ``state`` returned.

        Raises:
            LookupError, TypeError, ValueError: a tensor is missing, or its size or type is wrong
                for this network; the learner must not be used any more.
        """
        for name, tensor in self._tensors().items():
            np.copyto(tensor.numpy(), state[name].reshape(tensor.shape), casting="no")
