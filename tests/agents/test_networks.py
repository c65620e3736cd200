"""Products of matrices, in whichever library they are taken."""

import pytest
import torch
from torch import nn

from orchid_uav.agents import networks
from orchid_uav.agents.networks import perceptron

SIZES = [(16, (256, 256, 256), 4), (5, (), 2), (197, (7,), 1)]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("rows", [(1,), (6,), (200,), (60, 4)])
@pytest.mark.parametrize("faster", [False, True])
def test_a_perceptron_is_its_layers_one_after_the_other(monkeypatch, sizes, rows, faster):
    if faster and not torch.backends.mkldnn.is_available():
        pytest.skip("this torch has no oneDNN")
    monkeypatch.setattr(networks, "onednn_is_faster", lambda: faster)
    torch.manual_seed(0)
    network = perceptron(*sizes)
    plain = nn.Sequential(*(nn.ReLU() if isinstance(one, nn.ReLU) else one for one in network))
    inputs = torch.randn(*rows, sizes[0], requires_grad=True)
    weights = torch.randn(*rows, sizes[2])
    found = []
    for function in (plain, network):
        outputs = function(inputs)
        leaves = [inputs, *network.parameters()]
        found.append([outputs, *torch.autograd.grad((weights * outputs).sum(), leaves)])
    for expected, own in zip(*found, strict=True):
        torch.testing.assert_close(own, expected, rtol=1e-4, atol=1e-5)
    with torch.inference_mode():
        torch.testing.assert_close(network(inputs), found[0][0], rtol=1e-4, atol=1e-5)


def test_other_numbers_than_single_precision_stay_as_they_are(monkeypatch):
    monkeypatch.setattr(networks, "onednn_is_faster", lambda: True)
    network = perceptron(3, (4,), 2).double()
    assert network(torch.ones(500, 3, dtype=torch.float64)).dtype == torch.float64


@pytest.mark.parametrize("vendor", ["GenuineIntel", "AuthenticAMD"])
@pytest.mark.parametrize("level", ["AVX2", "AVX512"])
def test_only_of_amds_processors_with_avx_512_onednn_is_held_to_be_faster(
    monkeypatch, vendor, level
):
    monkeypatch.setattr(networks, "_processor", lambda: f"vendor_id\t: {vendor}\n")
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: level)
    for library in (torch.backends.mkldnn, torch.backends.mkl):
        monkeypatch.setattr(library, "is_available", lambda: True)
    found = networks.onednn_is_faster.__wrapped__()
    assert found is ((vendor, level) == ("AuthenticAMD", "AVX512"))
