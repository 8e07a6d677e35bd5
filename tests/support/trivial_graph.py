"""Graphs of the stages in `trivial_stages`."""

from dmfc.engine.kinds import StageKind, registry
from dmfc.engine.stage import Stage

TRIVIAL = registry(
    *(
        StageKind(name, f"tests.support.trivial_stages:{name}", version=1)
        for name in ("add", "slow", "gated", "fail", "die", "die_once", "seen", "crash", "sick")
    ),
    StageKind("threads", "tests.support.trivial_stages:threads", version=1, cpus=lambda config: 2),
)


def trivial(kind, name, value=1, inputs=None, **settings):
    """A stage of the registry TRIVIAL."""
    return Stage(kind, name, 1, {"value": value, **settings}, inputs or {})
