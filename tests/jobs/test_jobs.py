"""The files of jobs/: each read by what will read it, and its `dmfc` line by dmfc itself."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import jsonschema
import pytest
import yaml
from packaging.requirements import Requirement
from ray.scripts import scripts as ray_cli
from typer.testing import CliRunner

from dmfc.cli import main as cli
from dmfc.cli import sweep as cli_sweep
from dmfc.pipeline import selection
from tests.support.fake_science import fake_refs

HERE = Path(__file__).resolve().parent

ROOT = HERE.parents[1]
JOBS = ROOT / "jobs"


@pytest.fixture
def planned(monkeypatch):
    """What a `dmfc sweep ...` line would drive: its plans, with every cell resolved."""
    monkeypatch.setattr(selection, "list_refs", fake_refs)

    def plan(words):
        found = []
        monkeypatch.setattr(
            cli_sweep, "drive", lambda plans, *_: found.extend(plans) or sys.exit(0)
        )
        assert words[0] == "dmfc"
        answer = CliRunner().invoke(cli.app, words[1:])
        assert answer.exit_code == 0, answer.output
        return found

    return plan


def test_the_kuberay_manifest_fits_its_schema(planned):
    manifest = yaml.safe_load((JOBS / "kuberay.yaml").read_text())
    schema = json.loads((HERE / "rayjob.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(manifest)
    misspelt = {**manifest, "spec": {**manifest["spec"], "entrypiont": ""}}
    with pytest.raises(jsonschema.ValidationError, match="entrypiont"):
        jsonschema.Draft202012Validator(schema).validate(misspelt)

    cluster = manifest["spec"]["rayClusterSpec"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (ray,) = (
        r for r in map(Requirement, project["optional-dependencies"]["sweep"]) if r.name == "ray"
    )
    assert cluster["rayVersion"] in ray.specifier
    options = {opt for param in ray_cli.start.params for opt in param.opts}
    groups = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    for group in groups:
        assert {f"--{name}" for name in group["rayStartParams"]} <= options
        pod = group["template"]["spec"]
        mounts = {m["name"]: m["mountPath"] for c in pod["containers"] for m in c["volumeMounts"]}
        assert set(mounts) == {volume["name"] for volume in pod["volumes"]}
        assert mounts["store"] == "/store"
    plans = planned(shlex.split(manifest["spec"]["entrypoint"]))
    assert [plan.sweep.name for plan in plans] == ["table1", "table2"]
    assert plans[0].config.run.ray_address == "auto"
    assert plans[0].config.run.scales_up
    assert cluster["enableInTreeAutoscaling"], "without it maxReplicas does nothing"
    assert cluster["authOptions"] == {"mode": "token"}
    for container in (c for g in groups for c in g["template"]["spec"]["containers"]):
        assert {"name": "DMFC_CACHE", "value": "/store"} in container["env"]
    granted = [c["resources"] for g in groups for c in g["template"]["spec"]["containers"]]
    assert any("nvidia.com/gpu" in given["limits"] for given in granted)


def shims(folder: Path, log: Path) -> dict[str, str]:
    """Commands of a cluster that write their arguments down, and run nothing.

    The driver ends once Ray was started on three nodes: a script kills what is left behind it. Or,
    with DRIVER=waits, when it is sent SIGTERM, which it writes down.
    """
    folder.mkdir()
    started = f'[ "$(grep -ac -e --block {log})" -ge 3 ]'
    waits = f"trap 'echo stopped >> {log}.driver; exit 130' TERM; echo begun >> {log}.driver"
    bodies = {
        "srun": 'for w in "$@"; do case "$w" in hostname) echo 10.0.0.1 ;; esac; done',
        "dmfc": f"{waits}; for _ in {{1..6000}}; do "
        f'{started} && [ "${{DRIVER:-}}" != waits ] && exit; sleep 0.05; done; exit 1',
        "scontrol": 'printf "n1\\nn2\\nn3\\n"',
        "ray": "exit 0",
    }
    for name, body in bodies.items():
        path = folder / name
        line = f'printf "%s\\0" {name} "$@" $\'\\n\' >> {log}'
        path.write_text(f"#!/bin/bash\n{line}\n{body}\n")
        path.chmod(0o755)
    return {"PATH": f"{folder}:{os.environ['PATH']}"}


def calls(script, arguments, tmp_path, **environment):
    """The commands that a script runs, each as its words."""
    log = tmp_path / "log"
    done = subprocess.run(
        ["bash", JOBS / script, *arguments],
        env={**os.environ, **shims(tmp_path / "bin", log), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return commands(log)


def commands(log: Path) -> list[list[str]]:
    return [line.split("\0")[:-1] for line in log.read_text().split("\n\0")[:-1]]


SLURM = {"SLURM_JOB_NODELIST": "n[1-3]", "SLURM_JOB_ID": "7", "STORE": "/shared/store"}


def test_slurm_starts_ray_on_every_node_and_the_driver_beside_the_head(planned, tmp_path):
    given = ["table1", "--preset", "smoke"]
    made = calls("slurm.sh", given, tmp_path, **SLURM)
    starts = {c[c.index("-w") + 1]: c[c.index("ray") :] for c in made if "start" in c}
    assert set(starts) == {"n1", "n2", "n3"}
    for node, words in starts.items():
        context = ray_cli.start.make_context("start", words[2:])
        assert context.params["block"]
        assert context.params["head"] == (node == "n1")
        if node != "n1":
            assert context.params["address"] == "10.0.0.1:6379"
    (driver,) = (c for c in made if "dmfc" in c)  # by no srun, which would keep signals from it
    (plan,) = planned(driver)
    assert plan.config.run.ray_address == "10.0.0.1:6379"


@pytest.mark.parametrize(("sent", "queued_again"), [("SIGUSR1", True), ("SIGTERM", False)])
def test_slurm_stops_the_driver_cleanly_before_the_time_limit(tmp_path, sent, queued_again):
    log = tmp_path / "log"
    driver = log.with_suffix(".driver")
    environment = {**os.environ, **shims(tmp_path / "bin", log), **SLURM, "DRIVER": "waits"}
    # Of a session of its own, without a terminal: as Slurm starts it.
    script = subprocess.Popen(
        ["bash", JOBS / "slurm.sh", "table1"],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    while not driver.exists():
        assert script.poll() is None
        time.sleep(0.02)
    script.send_signal(getattr(signal, sent))
    script.wait(60)
    assert driver.read_text().split() == ["begun", "stopped"]
    assert (["scontrol", "requeue", "7"] in commands(log)) == queued_again


def test_a_ray_job_is_submitted_with_the_sweep(planned, tmp_path):
    environment = {"RAY_ADDRESS": "http://head:8265", "STORE": "/shared/store"}
    (words,) = calls("ray_job.sh", ["table1", "--preset", "smoke"], tmp_path, **environment)
    assert words[:3] == ["ray", "job", "submit"]
    context = ray_cli.cli.commands["job"].commands["submit"].make_context("submit", words[3:])
    assert context.params["address"] == "http://head:8265"
    given = json.loads(context.params["runtime_env_json"])
    assert given == {"env_vars": {"DMFC_CACHE": "/shared/store"}}
    (plan,) = planned(list(context.params["entrypoint"]))
    assert plan.config.run.ray_address == "auto"


@pytest.mark.parametrize("script", ["slurm.sh", "ray_job.sh"])
def test_a_script_without_a_sweep_says_how(script, tmp_path):
    done = subprocess.run(
        ["bash", JOBS / script],
        env={**os.environ, "RAY_ADDRESS": "x", "STORE": "x"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "usage" in done.stderr
