"""`fake_science`, held where a test wants to kill; each commit leaves a line in a log.

A stage waits while the store has a file `hold-<kind>`. So what is killed is at work for certain,
however busy the machine is, and the sweep cannot come to its end before.
"""

import dataclasses
import json
import os
import time

from dmfc.engine.ledger import Ledger
from dmfc.files.atomic import write_json
from tests.chaos.held import HELD
from tests.support import fake_science
from tests.support.fake_science import FAKES, fake_refs, grasps, hand, object, scenes

__all__ = ["CHAOS", "fake_refs", "grasps", "hand", "object", "scenes"]
CHAOS = {
    name: dataclasses.replace(kind, entry=f"tests.chaos.chaos_science:{name}")
    for name, kind in FAKES.items()
}
EPOCHS = 3
_commit = Ledger.commit


def _logged(self, address, record):
    _commit(self, address, record)
    with (self.store / "commits.log").open("a") as log:
        log.write(f"{address}\n")


Ledger.commit = _logged


def pretrain(ctx):
    _learn(ctx, "pretrain")


def finetune(ctx):
    assert (ctx.input("weights") / "weights").is_file()
    _learn(ctx, "finetune")


def evaluate(ctx):
    _hold(ctx)
    fake_science.evaluate(ctx)


def _learn(ctx, stage):
    """Epochs that a later attempt does not repeat, as training does from its checkpoint."""
    path = ctx.work / "metrics.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    for epoch in range(len(lines), EPOCHS):
        line = {"stage": stage, "epoch": epoch, "split": "train", "loss": 1.0 / (epoch + 1)}
        lines.append(json.dumps({**line, "time": round(time.time(), 3), "by": str(os.getpid())}))
        part = path.with_suffix(".part")
        part.write_text("".join(f"{text}\n" for text in lines))
        part.replace(path)
        ctx.progress((epoch + 1) / EPOCHS, f"epoch {epoch + 1}")
        _hold(ctx)
    (ctx.out / "metrics.jsonl").write_text(path.read_text())
    (ctx.out / "weights").touch()


def _hold(ctx):
    """Say which process waits on which node, and wait."""
    import ray  # late: a cluster of its own is prepared before

    node = ray.get_runtime_context().get_node_id()
    write_json(ctx.work / HELD, {"pid": os.getpid(), "node": node})
    while (ctx.work.parents[1] / f"hold-{ctx.kind}").exists():
        time.sleep(0.05)
