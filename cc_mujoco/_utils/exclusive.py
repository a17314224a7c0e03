"""Protection of objects whose memory compiled code uses: one thread at a time."""

import functools
from collections.abc import Callable
from threading import get_ident
from typing import Any, TypeVar, cast

from cc_mujoco.errors import CableError

Method = TypeVar("Method", bound=Callable[..., Any])


def exclusive(method: Method) -> Method:
    """Make a method raise while another thread runs such a method of the same object.

    Compiled functions run without Python's lock (GIL): two that share memory would
    write wrong numbers there, or crash.
    """

    @functools.wraps(method)
    def call(self: Any, *given: Any, **named: Any) -> Any:
        own = (get_ident(),)
        # At once, even between threads
        user = self.__dict__.setdefault("_used_by_thread", own)
        if user is not own and user != own:
            raise CableError(
                f"a {type(self).__name__} is called by one thread while another is "
                f"inside its {method.__name__}() or the like; make one for each thread."
            )
        try:
            return method(self, *given, **named)
        finally:
            if user is own:
                del self.__dict__["_used_by_thread"]

    return cast("Method", call)
