"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()
) -> str:
    """Return a table in Markdown, without a final newline.

    Columns whose indices are in `numbers` are aligned right.
    """
    right = set(numbers)
    rule = "|".join("---:" if k in right else "---" for k in range(len(head)))
    return "\n".join((_line(head), f"|{rule}|", *map(_line, rows)))


def _line(cells: Sequence[str]) -> str:
    escaped = (cell.replace("|", "\\|") for cell in cells)
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in escaped)
