"""Pages and examples as HTML around the reference of `scripts/docs`."""

from __future__ import annotations

import html
import os
import re
import shutil
from pathlib import Path

import markdown2

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r'(href|src)="([^"#]*)(#[^"]*)?"')
LEFT_OUT = {"build", "dist", "runs"}
STYLE = (ROOT / "scripts" / "site.css").read_text(encoding="utf-8")
EXTRAS = [
    "fenced-code-blocks", "tables", "header-ids", "cuddled-lists", "footnotes",
    "code-friendly",
]  # fmt: skip


def pages() -> list[Path]:
    return [
        path
        for path in sorted(ROOT.rglob("*.md"))
        if not any(
            part in LEFT_OUT or (part.startswith(".") and part != ".github")
            for part in path.relative_to(ROOT).parts
        )
    ]


def address(path: Path) -> str:
    """Return the address of a page or an example in the site."""
    place = path.relative_to(ROOT)
    if place == Path("README.md"):
        return "index.html"
    return f"pages/{place.as_posix().removeprefix('.github/')}.html"


def rendered(path: Path) -> str:
    """Return the HTML of a page, or of an example's source."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        text = f"# {path.name}\n\n```python\n{text}```\n"
    body = str(markdown2.markdown(text, extras=EXTRAS))
    body = re.sub(r"(?<!<pre>)(?<!</span>)<code>([^<>]+)</code>", _breaking, body)
    return body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )


def _breaking(code: re.Match[str]) -> str:
    """Return code in a line that breaks behind slashes, and in no option's dashes."""
    text = code[1].replace("/", "/<wbr>")
    text = re.sub(r"(?<!\S)--[\w-]+", r'<span class="option">\g<0></span>', text)
    return f"<code>{text}</code>"


def write_site(out: Path) -> None:
    """Write all pages and examples around the reference that lies in a folder."""
    sources = {*pages(), *(ROOT / "scripts" / "examples").glob("*.py")}
    for path in sources:
        place = out / address(path)
        place.parent.mkdir(parents=True, exist_ok=True)
        up, body = os.path.relpath(out, place.parent), rendered(path)
        heading = re.search(r"<h1[^>]*>(.*?)</h1>", body, re.S)
        title = re.sub(r"<[^>]+>", "", heading[1]) if heading else path.stem
        place.write_text(
            '<!doctype html><html lang="en"><meta charset="utf-8">'
            f"<title>{title}</title>"
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<style>{STYLE}</style><body><nav><a href="{up}/index.html">cc_mujoco</a> '
            f'<a href="{up}/pages/envs/README.md.html#gallery">Gallery</a> '
            f'<a href="{up}/cc_mujoco.html">Public names</a></nav>'
            f"<main>{_linked(body, path, out, place, sources)}</main></body></html>",
            encoding="utf-8",
        )
    for path in {*out.rglob("cc_mujoco*.html")} - {*out.glob("pages/**/*")}:
        up = os.path.relpath(out, path.parent)
        text = path.read_text(encoding="utf-8")
        text = text.replace("<div>", f'<div><a href="{up}/index.html">All pages</a>', 1)
        path.write_text(text, encoding="utf-8")


def _linked(body: str, path: Path, out: Path, place: Path, known: set[Path]) -> str:
    """Return HTML whose links lead to pages of the site, and whose pictures are there.

    What has no page, such as a source, is named without a link.
    """

    def follow(found: re.Match[str]) -> str:
        kind, target, heading = found[1], found[2], found[3] or ""
        if "://" in target or not target:
            return found[0]
        file = (path.parent / target).resolve()
        if file in known:
            leads = out / address(file)
        elif file.is_file() and (kind == "src" or file.suffix in (".csv", ".xml")):
            leads = out / "files" / file.relative_to(ROOT)
            leads.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, leads)
        else:
            return f'title="{html.escape(target)}"'
        return f'{kind}="{os.path.relpath(leads, place.parent)}{heading}"'

    return LINK.sub(follow, body)
