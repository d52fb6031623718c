import copy
import pickle

import numpy as np
import pytest
import torch

from drl_av.learning.qnetwork import GreedyPolicy, QNetwork


def network(seed: int = 0, **sizes) -> QNetwork:
    return QNetwork(np.random.default_rng(seed), **sizes)


def test_default_network_has_the_papers_layers():
    shapes = {name: tuple(p.shape) for name, p in network().named_parameters()}
    assert shapes == {
        "layers.0.weight": (100, 27),
        "layers.0.bias": (100,),
        "layers.1.weight": (100, 100),
        "layers.1.bias": (100,),
        "layers.2.weight": (12, 100),
        "layers.2.bias": (12,),
    }


def test_start_is_drawn_within_one_over_root_of_inputs_from_the_generator_alone():
    first = network(3)
    torch.manual_seed(99)
    assert torch.equal(first.flat, network(3).flat)
    assert not torch.equal(first.flat, network(4).flat)
    weight = first.layers[1].weight
    assert 0.09 < weight.abs().max() <= 0.1


def test_negative_half_of_a_hidden_unit_leaks_a_hundredth():
    tiny = network(observation_size=1, action_size=2, hidden=(1,))
    with torch.no_grad():
        tiny.flat.copy_(torch.tensor([-2.0, 1.0, 10.0, -10.0, 0.5, 0.25]))
    # s = 3: z = -2 * 3 + 1 = -5 -> -0.05; a plain ReLU would give the two biases, 0.5 and 0.25.
    values = tiny(torch.tensor([[3.0]]))
    assert torch.allclose(values, torch.tensor([[0.0, 0.75]]), atol=1e-6)
    policy = GreedyPolicy(tiny)
    assert np.allclose(policy.values(np.array([3.0], np.float32)), [0.0, 0.75], atol=1e-6)
    assert policy(np.array([3.0], np.float32)) == 1


def test_policy_agrees_with_the_module_and_leaves_the_observation_alone():
    net = network()
    policy = GreedyPolicy(net)
    for s_t in np.random.default_rng(1).standard_normal((200, 27)).astype(np.float32):
        before = s_t.copy()
        expected = net(torch.from_numpy(s_t)[None]).detach().numpy()[0]
        assert np.allclose(policy.values(s_t), expected, atol=1e-6)
        assert policy(s_t) == policy.values(s_t).argmax()
        assert np.array_equal(s_t, before)


def test_policy_follows_parameters_that_change_in_place():
    net, other = network(0), network(1)
    policy = GreedyPolicy(net)
    net.load_state_dict(other.state_dict())
    s_t = np.ones(27, np.float32)
    assert np.array_equal(policy.values(s_t), GreedyPolicy(other).values(s_t))
    assert torch.equal(net.flat, other.flat)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda net: pickle.loads(pickle.dumps(net))])
def test_a_copy_keeps_its_own_parameters_in_its_own_vector(copied):
    net = network()
    twin = copied(net)
    assert torch.equal(twin.flat, net.flat)
    twin.flat.zero_()
    assert not twin.layers[0].weight.any()
    assert net.layers[0].weight.any()
