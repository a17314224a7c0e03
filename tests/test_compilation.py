"""The notice of a compilation that takes long."""

from __future__ import annotations

from typing import Any

import pytest

from cc_mujoco._utils import compilation


@pytest.mark.parametrize("kept", [True, False])
def test_the_notice_says_where_compiled_code_may_be_kept_if_it_is_not(
    kept: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Numba raises where it finds no folder that it may write."""
    real = compilation.njit

    def njit(cache: bool = False, **options: Any) -> Any:
        if cache and not kept:
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    notice = compilation._Notice()
    monkeypatch.setattr(compilation, "_notice", notice)
    monkeypatch.setattr(compilation, "njit", njit)
    assert compilation.compiled(lambda x: 2 * x)(3) == 6
    notice._tell()
    notice._tell()
    said, goes_on = capsys.readouterr().err.splitlines()
    assert ("this happens once" in said) == kept
    assert ("at every start" in said and "NUMBA_CACHE_DIR" in said) != kept
    assert "still compiling, after 36 s" in goes_on
