"""Write the public names, all pages and the examples as a site for `scripts/docs`.

python -W error scripts/reference.py
"""

from __future__ import annotations

import importlib
import pkgutil
import re
import shutil
import sys
import tomllib
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import get_type_hints

import pdoc
from latex2mathml.converter import convert

from cc_mujoco.errors import CableError

sys.path.insert(0, str(Path(__file__).resolve().parent))

from pages_site import write_site

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "docs"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES: list[str] = SETTINGS["tool"]["setuptools"]["packages"]
EQUATION = re.compile(r"\\\((.+?)\\\)|\\\[(.+?)\\\]", re.S)
"""Equation in a docstring, in a line or on lines of its own."""


def opened(package: str) -> list[ModuleType]:
    """Return a package and its public modules, prepared for pdoc."""
    if (module := found(package)) is None:
        return []
    folder = str(Path(module.__file__ or "").parent)
    inside = [
        entry.name
        for entry in pkgutil.iter_modules([folder])
        if not entry.name.startswith("_")
    ]
    # Environments and scenes lie beside the package that they are part of.
    inside += [
        name
        for parent, _, name in (other.rpartition(".") for other in PACKAGES)
        if parent == package and not name.startswith("_")
    ]
    modules = {name: there for name in inside if (there := found(f"{package}.{name}"))}
    if public := getattr(module, "__all__", None):
        # What a package gives on request is not in it before, where pdoc looks; and
        # of its modules pdoc shows those only that are public names.
        shown = []
        for name in public:
            with suppress(CableError):  # its module is reported already
                setattr(module, name, getattr(module, name))
                shown.append(name)
        module.__dict__["__all__"] = list(dict.fromkeys([*shown, *modules]))
    return [module, *modules.values()]


@cache
def found(name: str) -> ModuleType | None:
    """Return a module by name, None if a package that it needs is not installed."""
    try:
        return importlib.import_module(name)
    except (CableError, ImportError) as error:
        print(f"left out: {name}: {error}")
        return None


def resolve(module: ModuleType) -> None:
    """Resolve annotations of named tuples, whose names pdoc does not find."""
    shown = [item for item in vars(module).values() if isinstance(item, type)]
    homes = {sys.modules[item.__module__] for item in shown if item.__module__}
    for home in homes | {module}:
        for item in vars(home).values():
            if isinstance(item, type) and hasattr(item, "_field_defaults"):
                item.__new__.__annotations__ = get_type_hints(item)


def equations(text: str) -> str:
    """Return a docstring with its equations as MathML, which needs no network."""
    return EQUATION.sub(
        lambda found: convert(
            found[1] or found[2], display="inline" if found[1] else "block"
        ),
        text,
    )


def main() -> None:
    for package in PACKAGES:
        if any(part.startswith("_") for part in package.split(".")):
            continue
        for module in opened(package):
            resolve(module)
    shutil.rmtree(OUT, ignore_errors=True)
    pdoc.render.configure(docformat="google", show_source=False)
    # Markdown would take the backslashes, so equations come first.
    to_html = pdoc.render.env.filters["to_html"]
    pdoc.render.env.filters["to_html"] = lambda text: to_html(equations(text))
    pdoc.pdoc("cc_mujoco", output_directory=OUT)
    write_site(OUT)
    print(f"written: {(OUT / 'index.html').relative_to(ROOT)}")


if __name__ == "__main__":
    main()
