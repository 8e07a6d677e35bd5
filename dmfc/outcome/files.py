"""Names of the files of an outcome predictor, and the version of what it is made of."""

WEIGHTS = "outcome.safetensors"
"""The file by which it is known."""
ABOUT = "outcome.json"
FEATURES_VERSION = 2
"""Of the list of features (`FeatureMaker.names`): a trained predictor knows the one it is for."""
