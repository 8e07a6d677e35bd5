"""dmfc: train, ablate and evaluate dense multi-fingered grasp networks."""

__version__ = "0.1.0"
