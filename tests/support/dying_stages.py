"""Evaluation stages that die in the middle, or raise. Imported by Ray's workers too."""

import dataclasses
import os
import signal

import pandas as pd

from dmfc.pipeline import stages
from dmfc.pipeline.kinds import KINDS
from tests.support import fake_science

DYING = KINDS | {
    "evaluate": dataclasses.replace(
        KINDS["evaluate"], entry="tests.support.dying_stages:evaluate_and_die"
    )
}


def evaluate_and_die(ctx):
    """As the stage itself, but the first attempt is killed after its first scene."""
    mark = killed_mark(ctx.work)
    if not mark.exists():
        ctx.progress = lambda fraction, message: (
            mark.touch(),
            os.kill(os.getpid(), signal.SIGKILL),
        )
    stages.evaluate(ctx)


def killed_mark(work):
    """Left where a stage died; the work folder itself goes when the stage is finished."""
    return work.with_name(f"{work.name}-killed")


def fake_evaluate_or_crash(ctx):
    """As the stage without its science, but it raises at the shard that begins with scene 2."""
    fake_science.evaluate(ctx)
    if pd.read_parquet(ctx.out / "trials.parquet")["scene"].min() == 2:
        raise RuntimeError("the simulator is gone")
