"""`CloudQuery`: a user's file of a cloud or depth image, how to read it, and what to ask of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply
from dmfc.prediction.depth_image import (
    Intrinsics,
    check_depth,
    cloud_of_depth,
    depth_in_metres,
    read_image,
    read_pose,
)
from dmfc.prediction.planner import UP, load, upright
from dmfc.prediction.ranked import RankedGrasps
from dmfc.sensing.check_cloud import (
    CheckedCloud,
    answered,
    check_cloud,
    check_extent,
    require_points,
)
from dmfc.sensing.read_cloud import read_cloud


@dataclass(frozen=True)
class CloudQuery:
    """The options of `dmfc predict` and `dmfc view`, as they are given on the command line."""

    file: Path
    model: str = ""
    unit: str = ""
    depth_scale: str = ""
    up: str = ""
    intrinsics: str = ""
    mask: Path | None = None
    pose: Path | None = None
    table: str = "refuse"
    drop_invalid: bool = False
    check: bool = False

    @property
    def direction(self) -> tuple[float, ...]:
        """`up` as numbers [3]; upwards where it is not given."""
        if not self.up:
            return UP
        try:
            found = tuple(float(word) for word in self.up.split(","))
        except ValueError:
            raise DmfcError(f"--up wants three numbers such as 0,0,1, not '{self.up}'") from None
        upright(found)
        return found

    def cloud(self) -> CheckedCloud:
        """The points in metres, in the frame of the grasps; rows are those of the file, or the
        pixels with a depth in their order. Raises DmfcError for what is wrong with them."""
        pose = None if self.pose is None else read_pose(self.pose)
        found = self._of_depth() if self.intrinsics else self._of_points()
        if pose is None:
            return found
        return CheckedCloud(apply(pose, found.points), found.rows)

    def answer(self) -> tuple[np.ndarray, RankedGrasps]:
        """The points [N, 3] that were used, in metres, and the grasps, both in the same frame.

        Raises DmfcError where the options or the points are not fit, or no grasp is left.
        """
        direction = self.direction
        cloud = self.cloud()
        # One cloud: compiling loops would take longer than doing without.
        planner = load(self.model or None, compiled=False)
        grasps = planner(cloud.points, up=direction, table=self.table, check=self.check)
        if not len(grasps):
            raise DmfcError(
                "the cloud's points, or the table under the lowest of them, are in the way of "
                "every grasp: go without --check, or look whether --up and the table are right"
            )
        return cloud.points, replace(grasps, point=cloud.rows[grasps.point])

    def _of_points(self) -> CheckedCloud:
        for option, given in (("--mask", self.mask), ("--depth-scale", self.depth_scale)):
            if given:
                raise DmfcError(
                    f"{option} belongs to a depth image: give --intrinsics fx,fy,cx,cy too"
                )
        return check_cloud(read_cloud(self.file), self.unit or "m", self.drop_invalid)

    def _of_depth(self) -> CheckedCloud:
        if self.pose is None and not self.up:
            raise DmfcError(
                "a depth image does not say which way is up: give its camera's pose (--pose FILE), "
                "or the direction in the camera's frame (--up 0,-1,0 for a level camera)"
            )
        camera = Intrinsics.parse(self.intrinsics)
        depth = depth_in_metres(read_image(self.file), self.unit, self.depth_scale)
        mask = None if self.mask is None else read_image(self.mask, "--mask")
        points = cloud_of_depth(depth, camera, mask)
        stated = f"--unit {self.unit}" if self.unit else ""
        check_depth(points, f"--depth-scale {self.depth_scale}" if self.depth_scale else stated)
        cloud = answered(points)
        require_points(cloud)
        check_extent(cloud.points, None)
        return cloud
