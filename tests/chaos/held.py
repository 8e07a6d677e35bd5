"""Where a stage that a test holds says its process and its node."""

HELD = "held.json"
