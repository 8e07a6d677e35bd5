"""Times of the network beside the straightforward reference: `make bench`.

Not collected by the ordinary test run, which times nothing.
"""

from __future__ import annotations

import pytest
import torch

from dmfc.config.network import NetworkConfig
from dmfc.geometry.points import farthest_points
from dmfc.network.inference import predict
from dmfc.network.model import DmfcGraspNet
from tests.benchmarks.compare import Compare
from tests.benchmarks.reference import ReferenceNet
from tests.benchmarks.workload import surface_cloud


@pytest.fixture
def net() -> DmfcGraspNet:
    torch.manual_seed(0)
    return DmfcGraspNet(NetworkConfig(), torch.zeros(18), torch.ones(18))


@pytest.mark.benchmark(group="step: forward and backward, 4 clouds")
def test_step(compare: Compare, net):
    points, reference = surface_cloud(4), ReferenceNet(net)
    seeds = farthest_points(points, 512)  # the loader makes them

    def ours():
        out = net(points, seeds)
        (out.offset.sum() + out.rotation6d.sum() + out.joints.sum() + out.logit.sum()).backward()
        net.zero_grad()

    def theirs():
        sum(out.sum() for out in reference(points)).backward()
        reference.zero_grad()

    compare(ours, theirs, "the straightforward step", limit=0.4)


@pytest.mark.benchmark(group="inference: 1 cloud, 512 ranked grasps")
def test_inference(compare: Compare, net):
    cloud, reference = surface_cloud(1), ReferenceNet(net).eval()

    @torch.inference_mode()
    def theirs():
        confidence = reference(cloud)[-1].sigmoid()
        return confidence.sort(descending=True)

    points = cloud[0].numpy()
    compare(lambda: predict(net, points), theirs, "the straightforward network", limit=0.35)
