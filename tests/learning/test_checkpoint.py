import json

import numpy as np
import pytest
import safetensors.numpy
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from drl_av.config.presets import preset
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import FORMAT, load, load_policy, save, save_policy
from drl_av.errors import CheckpointError

TENSORS = {"online": np.arange(6, dtype=np.float32).reshape(2, 3), "step": np.array(7)}
METADATA = {"episode": 41, "name": "Straße", "nested": {"a": [1, 2.5, None]}}


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    save(path, TENSORS, METADATA)
    return path


def one_sentence(error: pytest.ExceptionInfo[CheckpointError]) -> bool:
    return "\n" not in str(error.value) and str(error.value).endswith(".")


arrays = st.sampled_from([np.float32, np.float64, np.int64, np.uint8]).flatmap(
    lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, min_side=0, max_side=4))
)


@settings(max_examples=50, deadline=None)
@given(tensors=st.dictionaries(st.text("ab.é", min_size=1, max_size=8), arrays, max_size=4))
def test_arrays_come_back_bit_for_bit(tmp_path_factory, tensors):
    path = tmp_path_factory.mktemp("round") / "trip"
    save(path, tensors, METADATA)
    found, metadata = load(path)
    assert metadata == METADATA
    assert found.keys() == tensors.keys()
    for name, expected in tensors.items():
        assert found[name].dtype == expected.dtype
        assert found[name].shape == expected.shape
        assert found[name].tobytes() == expected.tobytes()


def test_a_transposed_array_comes_back_as_it_looked(tmp_path):
    save(tmp_path / "t", {"x": TENSORS["online"].T}, {})
    assert np.array_equal(load(tmp_path / "t")[0]["x"], TENSORS["online"].T)


def test_the_same_contents_make_the_same_bytes(tmp_path, saved):
    save(tmp_path / "again", dict(reversed(TENSORS.items())), METADATA)
    assert (tmp_path / "again").read_bytes() == saved.read_bytes()


def test_no_flipped_bit_anywhere_goes_unnoticed(saved):
    data = saved.read_bytes()
    for position in range(len(data)):
        damaged = bytearray(data)
        damaged[position] ^= 1 << position % 8
        saved.write_bytes(damaged)
        with pytest.raises(CheckpointError) as error:
            load(saved)
        assert one_sentence(error)


def test_no_cut_goes_unnoticed(saved):
    data = saved.read_bytes()
    for length in range(len(data)):
        saved.write_bytes(data[:length])
        with pytest.raises(CheckpointError, match="cut short"):
            load(saved)


def test_files_of_another_kind_are_refused(tmp_path):
    path = tmp_path / "other"
    torch.save({"x": torch.zeros(2)}, path)
    with pytest.raises(CheckpointError, match="no checkpoint at all"):
        load(path)
    from safetensors.numpy import save_file

    save_file(TENSORS, path)
    with pytest.raises(CheckpointError, match="not one of this version") as error:
        load(path)
    assert one_sentence(error)
    with pytest.raises(CheckpointError, match="No such file"):
        load(tmp_path / "missing")
    with pytest.raises(CheckpointError, match="cannot be read"):
        load(tmp_path)


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(CheckpointError, match="gone/x cannot be written") as error:
        save(tmp_path / "gone" / "x", TENSORS, METADATA)
    assert one_sentence(error)


def test_a_policy_file_stands_on_its_own(tmp_path):
    config = preset("literal").updated("learning", hidden_units=30, mirrored=True)
    network = QNetwork(np.random.default_rng(0), hidden=(30, 30))
    save_policy(tmp_path / "policy.safetensors", network, config)
    found, found_config = load_policy(tmp_path / "policy.safetensors")
    assert found_config == config
    assert np.array_equal(found.flat, network.flat)


def test_other_users_can_read_the_policy_with_safetensors_alone(tmp_path):
    from safetensors.torch import load_file

    network = QNetwork(np.random.default_rng(0))
    save_policy(tmp_path / "policy.safetensors", network, preset("paper"))
    tensors = load_file(tmp_path / "policy.safetensors")
    assert np.array_equal(tensors["layers.1.weight"].numpy(), network.layers[1][0])


def test_a_policy_of_other_shapes_or_none_at_all_is_refused(tmp_path, saved):
    with pytest.raises(CheckpointError, match="holds no policy"):
        load_policy(saved)
    path = tmp_path / "policy.safetensors"
    save_policy(path, QNetwork(np.random.default_rng(0), hidden=(30, 30)), preset("paper"))
    with pytest.raises(CheckpointError, match="does not fit a network of 27 -> 100") as error:
        load_policy(path)
    assert one_sentence(error)
    save_policy(path, QNetwork(np.random.default_rng(0), action_size=6), preset("paper"))
    with pytest.raises(CheckpointError, match="does not fit"):
        load_policy(path)
    save(path, {}, {"kind": "policy", "config": "[learning]\nwings = 2\n"})
    with pytest.raises(CheckpointError, match="no key 'wings'"):
        load_policy(path)


@pytest.mark.parametrize("number", [np.nan, np.inf, -1e30])
def test_weights_with_which_the_values_of_actions_overflow_are_refused(tmp_path, number):
    network = QNetwork(np.random.default_rng(0))
    network.layers[1][0][3, 4] = number
    save_policy(tmp_path / "policy.safetensors", network, preset("paper"))
    with pytest.raises(CheckpointError, match="no finite numbers") as error:
        load_policy(tmp_path / "policy.safetensors")
    assert one_sentence(error)


def test_metadata_nested_too_deep_is_refused(saved):
    header = json.dumps({"metadata": "[" * 100_000, "sha256": ""})
    safetensors.numpy.save_file(TENSORS, saved, {FORMAT: header})
    with pytest.raises(CheckpointError, match="damaged") as error:
        load(saved)
    assert one_sentence(error)
