"""A page of HTML that needs nothing but itself: style and pictures are inside it.

Functions take text as people wrote it and escape it; what they return is `Html`, which
is put into other elements as it is.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from types import MappingProxyType

from cc_mujoco.report._figures import BLUE, GREEN, GREY, ORANGE, PINK, SKY


class Html(str):
    """Text that is HTML already."""


Content = str | Html


def element(name: str, *content: Content, **attributes: str) -> Html:
    """Return an element with its content, escaped unless it is `Html`.

    A trailing underscore of an attribute's name is dropped: `class_`.
    """
    inside = "".join(map(_html, content))
    return Html(f"<{name}{_attributes(attributes)}>{inside}</{name}>")


def join_pieces(parts: Iterable[Content], between: Content = "") -> Html:
    return Html(_html(between).join(map(_html, parts)))


def paragraph(*content: Content, kind: str = "") -> Html:
    """Return a paragraph, of a class of the style sheet if it has one."""
    return element("p", *content, **({"class_": kind} if kind else {}))


def bullet_list(items: Iterable[Content], ranked: bool = False) -> Html:
    return element("ol" if ranked else "ul", *(element("li", item) for item in items))


def table(head: Sequence[str], rows: Iterable[Sequence[Content]]) -> Html:
    """Return a table that scrolls sideways by itself where the page is narrow."""
    top = element("thead", element("tr", *(element("th", each) for each in head)))
    lines = (element("tr", *map(_cell, row)) for row in rows)
    whole = element("table", top, element("tbody", *lines))
    return element("div", whole, class_="wide")


def _cell(content: Content) -> Html:
    """Return a cell of a table; a number with its sign or power is not broken."""
    if re.fullmatch(r"[-\d.]+(e[-+]?\d+)?", content):
        return element("td", content, class_="number")
    return element("td", content)


def inline_markdown(text: str) -> Html:
    """Return a text whose `code` and *emphasis* are elements."""
    return Html(re.sub(r"`([^`]+)`|\*([^*]+)\*", _marked, escape(text)))


def short_table(head: Sequence[str], rows: Iterable[Sequence[Content]]) -> Html:
    """Return a table of at most five rows and six columns, all of it folded."""
    rows = list(rows)
    if len(rows) <= 5 and len(head) <= 6:
        return table(head, rows)
    title = f"All {len(rows)} rows" if len(rows) > 5 else "All columns"
    few = table(head[:6], [row[:6] for row in rows[:5]])
    return join_pieces([few, folded(title, table(head, rows))])


def folded(title: Content, *content: Content) -> Html:
    """Return content below a title that opens it; on paper it is open."""
    return element("details", element("summary", title), *content)


def share_bar(part: float) -> Html:
    """Return a bar as long as a share of 1; nothing for a negative one."""
    width = 100.0 * min(1.0, max(0.0, part))
    bar = element("span", style=f"width:{width:.1f}%")
    return element("span", bar, class_="bar", aria_hidden="true")


def embed_picture(path: Path, words: str) -> Html:
    """Return a PNG file embedded in the page, with alternative text."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    given = _attributes({"src": f"data:image/png;base64,{data}", "alt": words})
    return element("figure", Html(f"<img{given}>"), element("figcaption", words))


def scrolled(picture: Html) -> Html:
    """Return a picture that keeps its size and scrolls where the page is narrow."""
    return element("div", picture, class_="wide whole")


def illustrated(part: Html | None, *pictures: Html) -> Html | None:
    """Return a part with pictures below; None without the part."""
    return None if part is None else join_pieces([part, *pictures])


def sections(titles: Mapping[str, str], parts: Mapping[str, Content]) -> Html:
    """Return links to parts of a page, and then each part below its title."""
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
    """Return the whole page.

    `kind` is the class of the body, which sets the colour of the verdict, and `style` a
    sheet that adds to the common one. `scripts` are run in this order; without, the
    page may run none. `data` is JSON for them, by the id of the element that will hold
    it.
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
    """Return the words as a sentence lists them: `a, b and c`."""
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
