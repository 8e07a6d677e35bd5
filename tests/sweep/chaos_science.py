"""The stages of `fake_science`, slow enough to be killed; each commit leaves a line in a log."""

import dataclasses
import json
import os
import time

from dmfc.sweep.ledger import Ledger
from tests.sweep.fake_science import FAKES, evaluate, fake_refs, grasps, hand, object, scenes

__all__ = ["CHAOS", "evaluate", "fake_refs", "grasps", "hand", "object", "scenes"]
CHAOS = {
    name: dataclasses.replace(kind, entry=f"tests.sweep.chaos_science:{name}")
    for name, kind in FAKES.items()
}
EPOCHS, SECONDS = 3, 0.25
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


def _learn(ctx, stage):
    """Epochs that a later attempt does not repeat, as training does from its checkpoint."""
    path = ctx.work / "metrics.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    (ctx.work / "pid").write_text(str(os.getpid()))
    for epoch in range(len(lines), EPOCHS):
        time.sleep(SECONDS)
        line = {"stage": stage, "epoch": epoch, "split": "train", "loss": 1.0 / (epoch + 1)}
        lines.append(json.dumps({**line, "time": round(time.time(), 3)}))
        part = path.with_suffix(".part")
        part.write_text("".join(f"{text}\n" for text in lines))
        part.replace(path)
        ctx.progress((epoch + 1) / EPOCHS, f"epoch {epoch + 1}")
    (ctx.out / "metrics.jsonl").write_text(path.read_text())
    (ctx.out / "weights").touch()
