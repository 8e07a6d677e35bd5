"""The network against a straightforward reference, and its symmetries."""

from __future__ import annotations

import copy
import dataclasses
import math
import subprocess
import sys

import pytest
import torch

from dmfc.config.network import NetworkConfig
from dmfc.errors import DmfcError
from dmfc.geometry.points import ball_query, farthest_points, take_points
from dmfc.network.ball_kernels import compact
from dmfc.network.model import HEIGHT_UNIT_M, DmfcGraspNet, Prediction
from tests.benchmarks.reference import ReferenceNet

SMALL = NetworkConfig(
    levels=[32, 16, 8],
    radii=[0.05, 0.1, 0.2],
    neighbours=[8, 8, 8],
    abstraction=[[8, 8, 16], [16, 24], [24, 32]],
    global_widths=[32, 48],
    propagation=[[32], [24, 24], [16]],
    features=16,
    width=16,
)
OUTPUTS = ("offset", "rotation6d", "joints", "logit")


def network(config: NetworkConfig = SMALL, dtype=torch.float64, seed: int = 0) -> DmfcGraspNet:
    """A network that answers strongly, with norms that have statistics and both signs of scale."""
    torch.manual_seed(seed)
    net = DmfcGraspNet(config, torch.full((18,), -0.5), torch.full((18,), 1.5)).to(dtype)
    with torch.no_grad():
        for module in net.modules():
            if isinstance(module, torch.nn.Linear):
                module.weight.normal_(std=(2 / module.in_features) ** 0.5)
            if isinstance(module, torch.nn.BatchNorm2d):
                module.weight.normal_()
                module.bias.normal_()
                module.running_mean.normal_(std=0.1)
                module.running_var.uniform_(0.5, 2)
    return net


def cloud(batch: int = 2, size: int = 100, seed: int = 3) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(batch, size, 3, generator=generator, dtype=torch.float64) * 0.2 + 0.1


def outputs(prediction: Prediction) -> list[torch.Tensor]:
    return [getattr(prediction, name) for name in OUTPUTS]


@pytest.mark.parametrize("training", [True, False])
def test_equals_the_reference_with_its_gradients(training):
    net = network().train(training)
    reference = ReferenceNet(net).train(training)
    points = cloud()
    ours = outputs(net(points))
    theirs = reference(points)
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, other.view_as(mine), rtol=1e-9, atol=1e-11)
    sum(out.square().sum() for out in ours).backward()
    sum(out.square().sum() for out in theirs).backward()
    first = net.backbone.down[1].layers
    gradient = torch.cat([first.from_position.weight.grad, first.from_features.weight.grad], 1)
    torch.testing.assert_close(gradient[..., None, None], reference.down[1][0].weight.grad)
    last = net.joints_head[-1].weight.grad
    torch.testing.assert_close(last[..., None, None], reference.heads[2][-1].weight.grad)


@pytest.mark.parametrize("training", [True, False])
def test_compiled_layers_equal_torch_layers(training, monkeypatch):
    points = cloud()
    index = farthest_points(points, 32)
    nets = [network().train(training), network().train(training)]
    sides = []
    for net, compiled in zip(nets, (True, False), strict=True):
        if not compiled:
            monkeypatch.setattr("dmfc.network.rows.runs_here", lambda rows: False)
        with torch.set_grad_enabled(training):
            sides.append(outputs(net(points, index)))
    for mine, other in zip(*sides, strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-9, atol=1e-11)
    for name, value in nets[0].state_dict().items():
        torch.testing.assert_close(value, nets[1].state_dict()[name])
    if training:
        for side in sides:
            sum((out * out.detach().cos()).sum() for out in side).backward()
        for one, other in zip(nets[0].parameters(), nets[1].parameters(), strict=True):
            torch.testing.assert_close(one.grad, other.grad, rtol=1e-8, atol=1e-10)


def test_balls_of_the_tests_are_partly_padded():
    points = cloud()
    centres = take_points(points, farthest_points(points, 32))
    ball = ball_query(points, centres, SMALL.radii[0], SMALL.neighbours[0])
    source, starts = compact(ball.numpy(), 100)
    for i, row in enumerate(ball.flatten(0, 1).tolist()):
        expected = [100 * (i // 32) + j for j in dict.fromkeys(row)]
        assert source[starts[i] : starts[i + 1]].tolist() == expected
    counts = starts[1:] - starts[:-1]
    assert counts.min() < 4
    assert counts.max() == SMALL.neighbours[0]


def test_default_layout_equals_the_reference():
    net = network(NetworkConfig()).eval()
    points = cloud(1, 2048)
    with torch.no_grad():
        for mine, other in zip(outputs(net(points)), ReferenceNet(net).eval()(points), strict=True):
            torch.testing.assert_close(mine, other.view_as(mine), rtol=1e-8, atol=1e-10)


def test_predictions_move_with_the_cloud():
    net = network().eval()
    points = cloud()
    shift = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    here, there = net(points), net(points + shift)
    for one, other in zip(outputs(here), outputs(there), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(here.position + shift, there.position)


def test_predictions_follow_a_permutation_of_the_points():
    config = dataclasses.replace(SMALL, neighbours=[100, 32, 16])  # no ball is cut short
    net = network(config).eval()
    points = cloud()
    seeds = farthest_points(points, 32)
    order = torch.randperm(100, generator=torch.Generator().manual_seed(5))
    place = torch.empty_like(order)
    place[order] = torch.arange(100)
    plain, permuted = net(points, seeds), net(points[:, order], place[seeds])
    for one, other in zip(outputs(plain), outputs(permuted), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(plain.position, permuted.position)


def test_height_feature_sees_the_vertical_alone():
    net = network(dataclasses.replace(SMALL, height_feature=True)).eval()
    points = cloud()
    base = net(points).offset
    sideways = net(points + torch.tensor([0.3, 0.1, 0.0], dtype=torch.float64)).offset
    upwards = net(points + torch.tensor([0.0, 0.0, HEIGHT_UNIT_M], dtype=torch.float64)).offset
    torch.testing.assert_close(base, sideways, rtol=1e-9, atol=1e-9)
    assert base.std(1).mean() > 1e-2  # seeds differ: the tests of symmetry compare something
    assert (base - upwards).abs().max() > 1e-3


def test_starts_from_a_sane_hand():
    torch.manual_seed(0)
    lower, upper = torch.linspace(-1, 0, 18), torch.linspace(0.5, 2, 18)
    prediction = DmfcGraspNet(SMALL, lower, upper)(cloud().float())
    middle = (lower + upper) / 2
    assert (prediction.joints - middle).abs().max() < 0.3
    assert prediction.offset.norm(dim=-1).max() < 0.3
    assert (prediction.confidence - 0.5).abs().max() < 0.1
    assert prediction.joints.shape == (2, 32, 18)
    torch.testing.assert_close(
        prediction.rotation @ prediction.rotation.mT, torch.eye(3).expand(2, 32, 3, 3)
    )


def test_seeds_are_the_farthest_points_given_or_not():
    net = network().eval()
    points = cloud()
    seeds = farthest_points(points, 32)
    torch.testing.assert_close(net(points).offset, net(points, seeds).offset)
    torch.testing.assert_close(net(points).seeds[1], points[1, seeds[1]])


def test_wrong_number_of_seeds_is_an_error():
    with pytest.raises(DmfcError, match=r"16 seeds .* needs 32"):
        network()(cloud(), farthest_points(cloud(), 16))


@pytest.mark.parametrize(
    "change",
    [{"radii": [0.1]}, {"levels": [32, 32, 8]}, {"levels": [32, 16, 2]}, {"global_widths": []}],
)
def test_levels_that_do_not_fit_are_an_error(change):
    with pytest.raises(ValueError, match=r"network\."):
        dataclasses.replace(SMALL, **change)


def test_norm_of_rows_is_batch_norm():
    from dmfc.network.rows import RowNorm

    rows = torch.randn(40, 7, dtype=torch.float64)
    ours, theirs = RowNorm(7).double(), torch.nn.BatchNorm1d(7).double()
    torch.testing.assert_close(ours(rows), theirs(rows))
    torch.testing.assert_close(ours.running_var, theirs.running_var)
    assert math.isclose(ours(rows).mean().item(), 0, abs_tol=1e-12)


def test_network_imports_without_orchestration():
    heavy = ["ray", "mlflow", "mujoco", "trimesh", "lightning", "matplotlib", "coacd"]
    code = f"import sys, dmfc.network.model; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def test_weights_survive_a_copy():
    net = network()
    other = DmfcGraspNet(SMALL, torch.zeros(18), torch.ones(18)).double()
    other.load_state_dict(copy.deepcopy(net.state_dict()))
    torch.testing.assert_close(net.eval()(cloud()).joints, other.eval()(cloud()).joints)
    torch.testing.assert_close(other.lower, net.lower)
