"""Grasps of other projects: read into grasp sets, and written for their tools.

A reader (`graspit`, `dexgraspnet`, `dexgraspbench`) says what stands in a file; a YAML file of
`data` says how that project's hand maps to ours; `convert` makes a grasp set of both.
"""
