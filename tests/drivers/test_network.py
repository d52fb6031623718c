"""The Q-network's layers lie in one vector, and one forward pass serves driving and learning."""

import copy
import pickle

import numpy as np
import pytest

from drl_av.drivers.network import QNetwork, forward


def network(seed: int = 0, **sizes) -> QNetwork:
    return QNetwork(np.random.default_rng(seed), **sizes)


def test_start_is_drawn_within_one_over_root_of_inputs_from_the_generator_alone():
    first = network(3)
    assert np.array_equal(first.flat, network(3).flat)
    assert not np.array_equal(first.flat, network(4).flat)
    weight, _ = first.layers[1]
    assert 0.09 < np.abs(weight).max() <= 0.1


def test_negative_half_of_a_hidden_unit_leaks_a_hundredth():
    tiny = network(observation_size=1, action_size=2, hidden=(1,))
    tiny.flat[:] = [-2.0, 1.0, 10.0, -10.0, 0.5, 0.25]
    # s = 3: z = -2 * 3 + 1 = -5 -> -0.05; a plain ReLU would give the two biases, 0.5 and 0.25.
    entered, values = forward(tiny.layers, np.array([3.0], np.float32))
    assert np.allclose(values, [0.0, 0.75], atol=1e-6)
    assert [x.tolist() for x in entered] == [[3.0], pytest.approx([-0.05])]


def test_an_observation_and_its_row_in_a_batch_have_the_same_values():
    net, states = network(), np.random.default_rng(1).standard_normal((200, 27))
    states = states.astype(np.float32)
    before = states.copy()
    _, rows = forward(net.layers, states)
    assert rows.shape == (200, 12)
    for s_t, row in zip(states, rows, strict=True):
        _, values = forward(net.layers, s_t)
        assert values.dtype == np.float32
        assert np.allclose(values, row, atol=1e-6)
        assert np.array_equal(values, forward(net.layers, s_t[None])[1][0])
    assert np.array_equal(states, before)


def test_views_follow_the_vector_and_the_vector_follows_them():
    net, other = network(0), network(1)
    layers = net.layers
    net.flat[:] = other.flat
    s_t = np.ones(27, np.float32)
    assert np.array_equal(forward(layers, s_t)[1], forward(other.layers, s_t)[1])
    net.tensors()["layers.2.bias"][11] = 7.0
    assert net.flat[-1] == 7.0


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda net: pickle.loads(pickle.dumps(net))])
def test_a_copy_keeps_its_own_parameters_in_its_own_vector(copied):
    net = network()
    twin = copied(net)
    assert np.array_equal(twin.flat, net.flat)
    twin.flat[:] = 0
    assert not twin.layers[0][0].any()
    assert net.layers[0][0].any()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("rows", [(), (64,)])
def test_the_compiled_leaky_relu_has_the_bits_of_numpys(kind, rows):
    net = network(2)
    layers = [(weight.astype(kind), bias.astype(kind)) for weight, bias in net.layers]
    s = np.random.default_rng(3).normal(size=(*rows, 27)).astype(kind)
    expected = s
    for weight, bias in layers[:-1]:
        z = expected.dot(weight.T) + bias
        expected = np.maximum(z, z * 0.01)  # numpy rounds 0.01 to the type of z
    (*_, entered), _ = forward(layers, s)
    assert entered.dtype == kind
    assert entered.tobytes() == expected.tobytes()
