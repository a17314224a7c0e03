"""An `info` whose columns are computed when it is first read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_PENDING = object()


class LazyInfo(dict[str, Any]):
    """A dictionary that is filled when it is first read; what is set before, stays.

    Until then one key has a placeholder: code in C, as that of `json`, looks at the
    size of a dictionary before it asks for its items.
    """

    def __init__(self, make: Callable[[], dict[str, Any]]) -> None:
        """Take the function that computes the entries, which is called at most once."""
        super().__init__(time_s=_PENDING)
        self._make: Callable[[], dict[str, Any]] | None = make

    def _fill(self) -> None:
        make, self._make = self._make, None
        if make is not None:
            own = {k: v for k, v in dict.items(self) if v is not _PENDING}
            dict.clear(self)
            dict.update(self, make() | own)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a plain dictionary."""
        self._fill()
        return dict, (list(dict.items(self)),)


def _filled(name: str) -> Callable[..., Any]:
    plain = getattr(dict, name)

    def method(self: LazyInfo, *given: Any) -> Any:
        if self._make is not None:
            self._fill()
        return plain(self, *given)

    method.__name__, method.__doc__ = name, plain.__doc__
    return method


for _name in (
    "__contains__", "__delitem__", "__eq__", "__getitem__", "__ior__", "__iter__",
    "__len__", "__ne__", "__or__", "__repr__", "__reversed__", "__ror__", "clear",
    "copy", "get", "items", "keys", "pop", "popitem", "setdefault", "values",
):  # fmt: skip
    setattr(LazyInfo, _name, _filled(_name))
