"""The evaluation stage in a process that dies in the middle. Imported by Ray's workers too."""

import dataclasses
import os
import signal

from dmfc.sweep import stages
from dmfc.sweep.kinds import KINDS

DYING = KINDS | {
    "evaluate": dataclasses.replace(
        KINDS["evaluate"], entry="tests.sweep.dying_stages:evaluate_and_die"
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
