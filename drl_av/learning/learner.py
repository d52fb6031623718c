"""One gradient step of Algorithm 1, lines 14 and 15.

Both passes are written out in numpy because autograd costs more than the arithmetic of 64 rows;
torch is there for its fused step of Adam.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from torch import Tensor
from torch.optim.adam import adam

from drl_av.drivers.network import LEAK, Float32Array, Layers, QNetwork, forward
from drl_av.drivers.policy_file import State
from drl_av.errors import CheckpointError
from drl_av.learning.buffers import Batch


def double_q_target(
    r_tp1: Float32Array,
    discount: Float32Array,
    q_next_online: Float32Array,
    q_next_target: Float32Array,
) -> Float32Array:
    """r + discount * Q^(s', argmax_a Q(s', a)): the online network selects, the target values.

    Algorithm 1, line 14, sample from Buf_S. Shapes: (rows,), (rows,), and twice (rows, actions).
    """
    a_next = q_next_online.argmax(axis=1)
    target: Float32Array = r_tp1 + discount * q_next_target[np.arange(len(a_next)), a_next]
    return target


def td_error(target: Float32Array, q_t: Float32Array, a_t: NDArray[np.int64]) -> Float32Array:
    """y - Q(s, a): how far the target lies above the value, (rows,).

    Algorithm 1, line 15. Shapes: (rows,), (rows, actions), (rows,).
    """
    return target - q_t[np.arange(len(a_t)), a_t]


def q_gradient(weighted_td: Float32Array, a_t: NDArray[np.int64], action_size: int) -> Float32Array:
    """The derivative of mean (y - Q(s, a))^2 by every Q(s, .): 0 except at the action taken.

    Algorithm 1, line 15. Shapes: (rows,), (rows,); returns (rows, action_size).
    """
    gradient = np.zeros((len(a_t), action_size), weighted_td.dtype)
    gradient[np.arange(len(a_t)), a_t] = weighted_td * (-2.0 / len(a_t))
    return gradient


def backward(
    layers: Layers, entered: list[Float32Array], dq: Float32Array, gradients: Layers
) -> None:
    """Write the gradient of every weight and bias into ``gradients``, by the chain rule.

    Shapes: ``entered`` as from ``forward``, ``dq`` (rows, actions).
    """
    dz = dq
    for i in reversed(range(len(layers))):
        d_weight, d_bias = gradients[i]
        np.matmul(dz.T, entered[i], out=d_weight)
        np.add.reduce(dz, axis=0, out=d_bias)
        if i:
            dz = dz @ layers[i][0]
            dz *= np.maximum(entered[i] > 0, LEAK, dtype=dz.dtype)


class Update(NamedTuple):
    """What a gradient step found, before it changed the network."""

    loss: float
    """The mean of the weighted squared errors."""
    td_errors: Float32Array
    """y - Q(s, a) of each row, (rows,)."""


class Learner:
    """The online and the target network and Adam's moments; learns a batch at a time.

    Sets numpy and torch to one thread for the whole process: at this size more threads are
    slower, and one keeps the order of sums the same from run to run.
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
        self._online_layers = network.layers
        self._target_layers = network.split(self._target.numpy())
        self._gradient_layers = network.split(self._gradient.numpy())

    @property
    def steps(self) -> int:
        """Gradient steps made so far."""
        return int(self._step)

    def update(self, batch: Batch) -> Update:
        """One step of Adam on the squared error of a batch.

        Algorithm 1, lines 14 and 15. The next state of a row without a discount is never read.
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
        """The step of torch.optim.Adam(fused=True), by the function under it at half the cost."""
        adam(
            [self._online],
            [self._gradient],
            [self._first_moment],
            [self._second_moment],
            [],
            [self._step],
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=self.learning_rate,
            weight_decay=0.0,
            eps=1e-8,
            maximize=False,
        )

    def sync_target(self) -> None:
        """Q^ = Q. Algorithm 1, line 16."""
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
        """A copy of all that the next update depends on, except the batch."""
        return {name: tensor.numpy().copy() for name, tensor in self._tensors().items()}

    def restore(self, state: State) -> None:
        """Go on from ``state`` exactly.

        Raises:
            CheckpointError: a tensor is missing, or of another shape or type than this network's.
        """
        for name, tensor in self._tensors().items():
            stored = state.get(name)
            if stored is None or stored.shape != tensor.shape or stored.dtype != np.float32:
                raise CheckpointError(
                    f"The stored learner's {name!r} does not fit a network of "
                    f"{' -> '.join(map(str, self.network.sizes))}: go on with the configuration "
                    "the run was started with."
                )
        for name, tensor in self._tensors().items():
            tensor.copy_(torch.from_numpy(np.asarray(state[name])))
