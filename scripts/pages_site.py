"""Pages, examples and public names as a site around the reference of `scripts/docs`."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import markdown2

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = "cc_mujoco.html"  # page of the public names, as pdoc calls it
LINK = re.compile(r'(href|src)="([^"#]*)(#[^"]*)?"')
LEFT_OUT = {"build", "dist", "runs"}
STYLE, SCRIPT = (
    (ROOT / "scripts" / name).read_text(encoding="utf-8")
    for name in ("site.css", "site.js")
)


def topics(front: str) -> dict[str, tuple[list[str], list[tuple[str, str]]]]:
    """Return public names and pages (title, address) by topic, as the front page."""
    table = front.partition("| topic | public names")[2].partition("\n\n")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    return {
        topic: (
            re.findall(r"`(\w+)`", names),
            re.findall(r"\[([^\]]+)\]\(([^)]+)\)", " ".join(rest)),
        )
        for topic, names, *rest in rows
    }


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
    name = place.as_posix().removeprefix(".github/")
    return f"pages/{name}.html"


def rendered(path: Path) -> str:
    """Return the HTML of a page, or of an example's source."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        text = f"# {path.name}\n\n```python\n{text}```\n"
    extras = [
        "fenced-code-blocks", "tables", "header-ids", "cuddled-lists", "footnotes",
    ]  # fmt: skip
    body = str(markdown2.markdown(text, extras=extras))
    # A path may be wider than a narrow screen: it breaks behind its slashes.
    body = re.sub(
        r"<code>([^<>\n]+)</code>",
        lambda code: f"<code>{code[1].replace('/', '/<wbr>')}</code>",
        body,
    )
    return body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )


def headings(body: str) -> Iterator[tuple[str, str]]:
    for identifier, text in re.findall(r'<h[1-4] id="([^"]*)">(.*?)</h', body, re.S):
        yield html.unescape(re.sub(r"<[^>]+>", "", text)), identifier


def write_site(out: Path) -> None:
    """Write all pages and examples around the reference that lies in a folder."""
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    examples = sorted((ROOT / "scripts" / "examples").glob("*.py"))
    sources = [*pages(), *examples]
    bodies = {path: rendered(path) for path in sources}
    grouped = topics(front)
    index = [
        [name, f"{REFERENCE}#{name}"] for names, _ in grouped.values() for name in names
    ]
    for path, body in bodies.items():
        title = next((text for text, _ in headings(body)), path.stem)
        for text, identifier in headings(body):
            shown = text if text == title else f"{title}: {text}"
            index.append([shown, f"{address(path)}#{identifier}"])
    (out / "index.js").write_text(f"const INDEX = {json.dumps(index)};\n", "utf-8")
    for path, body in bodies.items():
        place = out / address(path)
        place.parent.mkdir(parents=True, exist_ok=True)
        up = os.path.relpath(out, place.parent) + "/"
        up = up if up != "./" else ""
        linked = _linked(body, path, out, place, set(sources))
        menu = _menu(grouped, examples, up)
        title = html.escape(next((text for text, _ in headings(body)), path.stem))
        place.write_text(
            '<!doctype html><html lang="en"><meta charset="utf-8">'
            f"<title>{title}</title>"
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<style>{STYLE}</style><body>{menu}"
            f'<main>{linked}</main><script>const UP = "{up}";</script>'
            f'<script src="{up}index.js"></script><script>{SCRIPT}</script>'
            "</body></html>",
            encoding="utf-8",
        )
    for path in out.rglob("cc_mujoco*.html"):
        if path.is_relative_to(out / "pages"):
            continue
        up = os.path.relpath(out, path.parent)
        text = path.read_text(encoding="utf-8")
        text = text.replace("<div>", f'<div><a href="{up}/index.html">All pages</a>', 1)
        path.write_text(text, encoding="utf-8")


def _menu(
    grouped: dict[str, tuple[list[str], list[tuple[str, str]]]],
    examples: list[Path],
    up: str,
) -> str:
    parts = [
        f'<nav><a href="{up}index.html"><b>cc_mujoco</b></a>'
        '<input type="search" placeholder="Search pages and names" aria-label="Search">'
        '<div id="found"></div><div id="groups">'
    ]
    for topic, (names, titled) in grouped.items():
        parts.append(f"<details open><summary><b>{topic}</b></summary>")
        for title, place in titled:
            file, _, heading = place.partition("#")
            target = address(ROOT / file) + (f"#{heading}" if heading else "")
            parts.append(f'<a href="{up}{target}">{title}</a>')
        for name in names:
            parts.append(f'<a href="{up}{REFERENCE}#{name}"><code>{name}</code></a>')
        parts.append("</details>")
    parts.append("<details open><summary><b>Examples</b></summary>")
    for path in examples:
        parts.append(f'<a href="{up}{address(path)}">{path.stem}</a>')
    return "".join([*parts, "</details></div></nav>"])


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
