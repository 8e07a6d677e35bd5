"""Names of the files of a trained model: what `dmfc.training.fit` writes into its folder."""

from __future__ import annotations

WEIGHTS = "weights.safetensors"
"""The network's weights; the file by which a trained model is known."""
METRICS = "metrics.jsonl"
"""A line per epoch and split."""
CONFIG = "config.yaml"
"""Settings of the network, the losses, the training and the validation; and the hand's name."""
SUMMARY = "summary.json"
"""Epochs, parameters, seconds, digest of the data, the last metrics."""
BACKBONE = "backbone.py"
"""The user's file that the backbone is in; there where `network.backbone` is `file.py:Class`."""
