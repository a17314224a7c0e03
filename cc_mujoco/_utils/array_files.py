"""Columns of numbers from MATLAB and HDF5 files: variables, fields, datasets.

A column is named by its path, `data.time_s` in MATLAB and `data/time_s` in HDF5. The
columns of a matrix with a row per sample are named in the notation of the language:
`q(:,1)` and `q[:,0]` are the first. MATLAB files of version 7.3 and HDF5 need h5py.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._utils.parsing import one_sentence
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as FloatArray


class _Array(NamedTuple):
    data: Any  # array or HDF5 dataset
    # whether its axes are stored in the opposite order, as MATLAB does
    turned: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array as its language has it, without axes of length 1."""
        shape = self.data.shape[::-1] if self.turned else self.data.shape
        return tuple(n for n in shape if n != 1)

    def column(self, index: int | None) -> FloatArray:
        values = self.data[()]
        values = np.squeeze(values.T if self.turned else values)
        return np.array(values if index is None else values[:, index], dtype=float)


def _is_matlab(path: Path) -> bool:
    return path.suffix.lower() == ".mat"


def column_names(path: Path) -> list[str]:
    with _arrays(path) as arrays:
        return list(_columns(path, arrays))


def read_columns(
    path: Path, names: Iterable[str], _switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    with _arrays(path) as arrays:
        places = _columns(path, arrays)
        return {name: places[name][0].column(places[name][1]) for name in names}


def _columns(
    path: Path, arrays: Mapping[str, _Array]
) -> dict[str, tuple[_Array, int | None]]:
    columns: dict[str, tuple[_Array, int | None]] = {}
    matlab = _is_matlab(path)
    for place, array in arrays.items():
        if len(array.shape) == 1:
            columns[place] = array, None
        # Wider ones are no signals.
        elif len(array.shape) == 2 and array.shape[1] <= 64:
            for k in range(array.shape[1]):
                index = f"(:,{k + 1})" if matlab else f"[:,{k}]"
                columns[place + index] = array, k
    if not columns:
        raise CableError(
            f"{path} holds no vector of numbers; a trial needs one per channel, as a "
            "variable or a field."
        )
    return columns


@contextmanager
def _arrays(path: Path) -> Iterator[dict[str, _Array]]:
    from scipy.io.matlab import matfile_version

    with one_sentence(path):
        path.open("rb").close()  # the system's reason, where there is one
        # Version 2 is HDF5.
        if not _is_matlab(path) or matfile_version(str(path))[0] == 2:
            try:
                import h5py
            except ModuleNotFoundError:
                other = "save it with '-v7'" if _is_matlab(path) else "write Parquet"
                raise CableError(
                    f"{path} needs h5py to be read: pip install 'cc_mujoco[hdf5]', or "
                    f"{other}."
                ) from None
            with h5py.File(path, "r") as file:
                yield _hdf5_arrays(file, _is_matlab(path))
        else:
            yield _matlab_arrays(path)


def _matlab_arrays(path: Path) -> dict[str, _Array]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    found: dict[str, _Array] = {}
    objects = []

    def look(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                look(f"{name}.{key}", inner)
        elif isinstance(value, MatlabOpaque | MatlabFunction):
            objects.append(name)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            found[name] = _Array(value)

    for name, value in loadmat(str(path), simplify_cells=True).items():
        if not name.startswith("__"):
            look(name, value)
    if objects and not found:
        raise CableError(
            f"{path} holds MATLAB objects only, such as a table, which only MATLAB can "
            "read; save their columns: s = table2struct(t, 'ToScalar', true); "
            "save('run.mat', '-struct', 's')."
        )
    return found


def _hdf5_arrays(file: Any, matlab: bool) -> dict[str, _Array]:
    found: dict[str, _Array] = {}

    def look(name: str, item: Any) -> None:
        kind = item.attrs.get("MATLAB_class", b"double") if matlab else b"double"
        word = kind.decode() if isinstance(kind, bytes) else str(kind)
        if (
            hasattr(item, "dtype")
            and item.dtype.kind in "biuf"
            and word.startswith(("double", "single", "int", "uint", "logical"))
            and not name.startswith("#")  # where MATLAB keeps what it refers to
        ):
            found[name.replace("/", ".") if matlab else name] = _Array(item, matlab)

    file.visititems(look)
    return found
