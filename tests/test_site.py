"""The site: every page, links that lead somewhere; names on the front page."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pages_site
import pytest
import reference

import cc_mujoco


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    pages_site.write_site(folder)
    return folder


def test_the_front_page_groups_every_public_name_once() -> None:
    front = (pages_site.ROOT / "README.md").read_text("utf-8")
    table = front.partition("| topic | public names")[2].partition("\n\n")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    names = [name for row in rows for name in re.findall(r"`(\w+)`", row[1])]
    public = cc_mujoco.__all__
    modules = {name for name in public if inspect.ismodule(getattr(cc_mujoco, name))}
    assert sorted(names) == sorted(set(public) - modules | {"benchmark"})


def test_every_page_and_example_is_there(site: Path) -> None:
    examples = (pages_site.ROOT / "scripts" / "examples").glob("*.py")
    for path in (*pages_site.pages(), *examples):
        assert (site / pages_site.address(path)).is_file()


def test_links_and_pictures_of_the_site_are_there(site: Path) -> None:
    for page in site.rglob("*.html"):
        for target in re.findall(r'(?:href|src)="([^"#]+)', page.read_text("utf-8")):
            if "://" not in target and target.rpartition("/")[2] != "cc_mujoco.html":
                assert (page.parent / target).exists(), (page, target)


def test_no_row_of_a_table_stands_outside_it(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not re.search(r"<p>\|", page.read_text("utf-8")), page


def test_equations_are_drawn_without_a_network(site: Path) -> None:
    text = reference.equations(r"a \(T_p\) and \[ \frac{W}{W + D} > 0 \]")
    assert "<msub><mi>T</mi><mi>p</mi></msub>" in text and "<mfrac>" in text
    assert "\\" not in text
    for page in site.rglob("*.html"):
        assert not re.search(r'src="https?:', page.read_text("utf-8")), page
