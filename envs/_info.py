"""A Gymnasium `info` dictionary whose values are computed on first access."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_PENDING = object()


class LazyInfo(dict[str, Any]):
    """Dictionary that is filled on first access; entries set before that are kept.

    Until then one key has a placeholder: C code, such as that of `json`, checks the
    size of a dictionary before it asks for items.
    """

    __slots__ = ("_given", "_make")

    def __init__(self, make: Callable[..., dict[str, Any]], *given: Any) -> None:
        """Take a function that returns the entries; it is called once with `given`."""
        self._make: Callable[..., dict[str, Any]] | None = make
        self._given = given
        dict.__setitem__(self, "time_s", _PENDING)

    def _fill(self) -> None:
        (make, given), self._make, self._given = (self._make, self._given), None, ()
        if make is not None:
            own = {k: v for k, v in dict.items(self) if v is not _PENDING}
            dict.clear(self)
            dict.update(self, make(*given) | own)

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
