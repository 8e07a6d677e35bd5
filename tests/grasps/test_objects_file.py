"""Pickles of strangers: what rebuilds arrays is read, everything else is refused."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from dmfc.errors import DmfcError
from dmfc.grasps.exchange.objects_file import load_objects


class Evil:
    def __reduce__(self):
        return os.mkdir, ("broken_into",)


def test_a_pickle_that_calls_something_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("evil.npy", np.array([{"qpos": Evil()}], dtype=object))
    with pytest.raises(DmfcError, match=r"asks for 'posix\.mkdir'|asks for 'nt\.mkdir'"):
        load_objects(Path("evil.npy"))
    assert not Path("broken_into").exists()


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_every_protocol_of_pickle_is_read(tmp_path, protocol):
    """As NumPy 1, Python 2 and their successors wrote: arrays, scalars and text come back."""
    rows = np.array([{"a": np.arange(3.0), "b": np.float32(0.5), "c": "mug", "d": [1]}], object)
    with open(tmp_path / "a.npy", "wb") as file:
        npy.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": (1,)})
        pickle.dump(rows, file, protocol)
    found = load_objects(tmp_path / "a.npy")[0]
    assert found["a"].tolist() == [0, 1, 2]
    assert (found["b"], found["c"], found["d"]) == (0.5, "mug", [1])


def test_damaged_files_are_one_line(tmp_path):
    np.save(tmp_path / "plain.npy", np.zeros(3))
    with pytest.raises(DmfcError, match="an array of float64, not of grasps"):
        load_objects(tmp_path / "plain.npy")
    np.save(tmp_path / "cut.npy", np.array([{"a": 1}], dtype=object))
    (tmp_path / "cut.npy").write_bytes((tmp_path / "cut.npy").read_bytes()[:-4])
    with pytest.raises(DmfcError, match=r"cut\.npy: cannot be read"):
        load_objects(tmp_path / "cut.npy")
    with pytest.raises(DmfcError, match=r"none\.npy: cannot be read"):
        load_objects(tmp_path / "none.npy")
