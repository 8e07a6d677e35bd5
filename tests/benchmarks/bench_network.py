"""Times of the network beside the straightforward reference: `pytest tests/benchmarks/bench_*`.

Not collected by the ordinary test run, which times nothing.
"""

from __future__ import annotations

import pytest
import torch

from dmfc.config.network import NetworkConfig
from dmfc.geometry.points import farthest_points
from dmfc.network.model import DmfcGraspNet
from tests.benchmarks.reference import ReferenceNet


def surface_cloud(batch: int) -> torch.Tensor:
    """2,048 points on the surface of a 15 x 10 x 12 cm box, per cloud."""
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(batch, 2048, 3, generator=generator)
    axis = torch.randint(0, 3, (batch, 2048, 1), generator=generator)
    side = torch.randint(0, 2, (batch, 2048, 1), generator=generator).float()
    return points.scatter(2, axis, side) * torch.tensor([0.15, 0.10, 0.12])


@pytest.fixture
def net() -> DmfcGraspNet:
    torch.manual_seed(0)
    return DmfcGraspNet(NetworkConfig(), torch.zeros(18), torch.ones(18))


@pytest.mark.benchmark(group="step: forward and backward, 4 clouds")
def test_step_ours(benchmark, net):
    points = surface_cloud(4)
    seeds = farthest_points(points, 512)  # the loader makes them

    def step():
        out = net(points, seeds)
        (out.offset.sum() + out.rotation6d.sum() + out.joints.sum() + out.logit.sum()).backward()
        net.zero_grad()

    benchmark.pedantic(step, rounds=7, warmup_rounds=1)


@pytest.mark.benchmark(group="step: forward and backward, 4 clouds")
def test_step_reference(benchmark, net):
    points, reference = surface_cloud(4), ReferenceNet(net)

    def step():
        sum(out.sum() for out in reference(points)).backward()
        reference.zero_grad()

    benchmark.pedantic(step, rounds=5, warmup_rounds=1)


@pytest.mark.benchmark(group="inference: 1 cloud")
@pytest.mark.parametrize("which", ["ours", "reference"])
def test_inference(benchmark, net, which):
    points = surface_cloud(1)
    model = (net if which == "ours" else ReferenceNet(net)).eval()
    with torch.inference_mode():
        benchmark.pedantic(lambda: model(points), rounds=7, warmup_rounds=1)
