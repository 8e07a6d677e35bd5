"""Names of the files of an outcome predictor."""

WEIGHTS = "outcome.safetensors"
"""The file by which it is known."""
ABOUT = "outcome.json"
