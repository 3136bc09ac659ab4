"""One type of array for the kernels, whoever calls."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input


def test_the_callers_array_is_neither_copied_nor_locked():
    array = np.arange(6, dtype=np.int32).reshape(2, 3)
    view = as_kernel_input(array, np.int32)
    assert np.shares_memory(array, view)
    assert not view.flags.writeable
    assert array.flags.writeable


def test_other_types_and_layouts_are_copied():
    array = np.asfortranarray(np.arange(6, dtype=np.int64).reshape(2, 3))
    view = as_kernel_input(array, np.int32)
    assert view.dtype == np.int32
    assert view.flags.c_contiguous
    assert view.tolist() == array.tolist()
