"""Self-contained HTML pages, with style and pictures inside.

Functions escape plain text. They return `Html`, which other functions do not escape.
"""

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from types import MappingProxyType

from cc_mujoco.report._figures import BLUE, GREEN, GREY, ORANGE, PINK, SKY


class Html(str):
    """Text that is HTML, and is not escaped again."""


Content = str | Html


def element(name: str, *content: Content, **attributes: str) -> Html:
    """Return an element with its content, escaped unless it is `Html`.

    Underscores in names of attributes become hyphens; one at the end is dropped
    (`class_`).
    """
    inside = "".join(map(_html, content))
    return Html(f"<{name}{_attributes(attributes)}>{inside}</{name}>")


def join_pieces(parts: Iterable[Content], between: Content = "") -> Html:
    return Html(_html(between).join(map(_html, parts)))


def paragraph(*content: Content, kind: str = "") -> Html:
    """Return a paragraph, of the style sheet's class `kind` if that is not empty."""
    return element("p", *content, **({"class_": kind} if kind else {}))


def bullet_list(items: Iterable[Content], ranked: bool = False) -> Html:
    return element("ol" if ranked else "ul", *(element("li", item) for item in items))


def table(head: Sequence[str], rows: Iterable[Sequence[Content]]) -> Html:
    """Return a table that scrolls sideways on its own if the page is too narrow."""
    top = element("thead", element("tr", *(element("th", each) for each in head)))
    lines = (element("tr", *map(_cell, row)) for row in rows)
    whole = element("table", top, element("tbody", *lines))
    return element("div", whole, class_="wide")


def _cell(content: Content) -> Html:
    """Return a cell of a table; numbers get a class that keeps them on one line."""
    if re.fullmatch(r"[-\d.]+(e[-+]?\d+)?", content):
        return element("td", content, class_="number")
    return element("td", content)


def inline_markdown(text: str) -> Html:
    """Return a text in which `code` and *emphasis* are HTML elements."""
    return Html(re.sub(r"`([^`]+)`|\*([^*]+)\*", _marked, escape(text)))


def short_table(head: Sequence[str], rows: Iterable[Sequence[Content]]) -> Html:
    """Return the first five rows and six columns; a larger table follows, collapsed."""
    rows = list(rows)
    if len(rows) <= 5 and len(head) <= 6:
        return table(head, rows)
    title = f"All {len(rows)} rows" if len(rows) > 5 else "All columns"
    few = table(head[:6], [row[:6] for row in rows[:5]])
    return join_pieces([few, folded(title, table(head, rows))])


def folded(title: Content, *content: Content) -> Html:
    """Return `content` collapsed below a title; a click opens it, and printing does."""
    return element("details", element("summary", title), *content)


def share_bar(part: float) -> Html:
    """Return a bar whose length is `part` of the full width, limited to 0 to 1."""
    width = 100.0 * min(1.0, max(0.0, part))
    bar = element("span", style=f"width:{width:.1f}%")
    return element("span", bar, class_="bar", aria_hidden="true")


def embed_picture(path: Path, words: str) -> Html:
    """Return a PNG file embedded in the page; `words` are caption and alternative."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    given = _attributes({"src": f"data:image/png;base64,{data}", "alt": words})
    return element("figure", Html(f"<img{given}>"), element("figcaption", words))


def scrolled(picture: Html) -> Html:
    """Return a picture that keeps its size and scrolls sideways on a narrow page."""
    return element("div", picture, class_="wide whole")


def illustrated(part: Html | None, *pictures: Html) -> Html | None:
    """Return `part` with pictures below it; None if it is None."""
    return None if part is None else join_pieces([part, *pictures])


def sections(titles: Mapping[str, str], parts: Mapping[str, Content]) -> Html:
    """Return the parts as sections with headings, after a list of links to them."""
    links = [element("a", titles[key], href=f"#{key}") for key in parts]
    blocks = [
        element("section", element("h2", titles[key]), part, id=key)
        for key, part in parts.items()
    ]
    return join_pieces([element("nav", join_pieces(links, " ")), *blocks])


def page(
    title: str,
    kind: str,
    *content: Content,
    style: str = "",
    scripts: Sequence[str] = (),
    data: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return a complete HTML page.

    `kind` is the class of the body, which sets the colour of the verdict, and `style`
    is CSS in addition to the common style sheet. `scripts` are JavaScript, run in this
    order; without any the page may run none. `data` is JSON for them, by the id of the
    element that holds it.
    """
    held = [
        Html(
            f'<script type="application/json"{_attributes({"id": name})}>'
            f"{text.replace('<', chr(92) + 'u003c')}</script>"
        )
        for name, text in data.items()
    ]
    run = [element("script", Html(script)) for script in scripts]
    common = _template("page.css").substitute(
        blue=BLUE, green=GREEN, grey=GREY, orange=ORANGE, pink=PINK, sky=SKY
    )
    return _template("page.html").substitute(
        title=escape(title),
        kind=escape(kind),
        scripting=" script-src 'unsafe-inline';" if scripts else "",
        style=common + style,
        body=join_pieces([element("main", *content), *held, *run], Html("\n")),
    )


def list_words(words: Iterable[str], last: str = "and") -> str:
    """Return the words listed as in a sentence: `a, b and c`."""
    words = list(words)
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def _marked(found: re.Match[str]) -> str:
    return f"<code>{found[1]}</code>" if found[1] else f"<em>{found[2]}</em>"


def _html(content: Content) -> str:
    return content if isinstance(content, Html) else escape(content)


def _attributes(attributes: dict[str, str]) -> str:
    return "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for name, value in attributes.items()
    )


def _template(name: str) -> Template:
    return Template(Path(__file__).with_name(name).read_text(encoding="utf-8"))
