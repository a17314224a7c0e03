"""The pages hold together: their code runs, their links lead somewhere."""

from __future__ import annotations

import ast
import csv
import dataclasses
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import cc_mujoco
import page_blocks
from cc_mujoco.assets import SCENES
from cc_mujoco.cli._parsing import parse
from cc_mujoco.datasets import _dataset_file
from cc_mujoco.datasets._dataset_file import Source
from cc_mujoco.datasets._rig_table import RIG_CONSTANTS
from cc_mujoco.datasets._trials import TrialFacts
from cc_mujoco.plugin import CableReading
from page_blocks import PAGES, ROOT, found

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
sys.path.insert(0, str(Path(__file__).parents[1] / "scripts" / "figures"))

import demo_film
import fill_readme

FRONT = PAGES["README.md"]
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.M | re.S)
NOT_ALWAYS = [
    block
    for block in page_blocks.every_block()
    if block.group not in ("text", "wheel", "checkout")
]
LINK = re.compile(r"(!?)\[[^\]]*\]\(([^)\s]+)\)")


def links(place: str, pictures: bool) -> list[tuple[Path, str]]:
    """File and heading that every relative link, or picture, of a page leads to."""
    return [
        ((ROOT / place).parent / file if file else ROOT / place, heading)
        for mark, target in LINK.findall(CODE.sub("", PAGES[place]))
        if bool(mark) == pictures and "://" not in target
        for file, _, heading in [target.partition("#")]
    ]


def headings(text: str) -> set[str]:
    """Headings as addresses."""
    lines = re.findall(
        r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M
    )
    return {re.sub(r"[^\w\- ]", "", line).lower().replace(" ", "-") for line in lines}


def test_front_page_is_one() -> None:
    assert len(FRONT.splitlines()) <= 150


def test_all_pages_together_can_be_read() -> None:
    words = {
        place: len(text.split())
        for place, text in PAGES.items()
        if place != "CHANGELOG.md" and not place.startswith(".github")
    }
    assert sum(words.values()) <= 22_000, words


@pytest.mark.parametrize("place", PAGES)
def test_links_and_pictures_resolve(place: str) -> None:
    for path, heading in links(place, False) + links(place, True):
        assert path.exists(), path
        if heading:
            assert heading in headings(path.read_text("utf-8")), f"{path}#{heading}"


def test_every_page_is_reached_from_the_front_page() -> None:
    reached, new = set(), {(ROOT / "README.md").resolve()}
    while new:
        reached |= new
        new = {
            path.resolve()
            for page in new
            for path, _ in links(page.relative_to(ROOT.resolve()).as_posix(), False)
            if path.suffix == ".md"
        } - reached
    assert reached == {(ROOT / place).resolve() for place in PAGES}


def test_every_picture_lies_beside_a_page_that_shows_it() -> None:
    shown = {
        path.resolve()
        for place in PAGES
        for path, _ in links(place, True)
        if path.resolve().parent == (ROOT / place).resolve().parent
    }
    pictures = found("*.png") | found("*.webp")
    assert shown == {path.resolve() for path in pictures.values()}


def test_a_film_is_what_its_script_writes_and_soon_loaded() -> None:
    films = {
        path.stem.removeprefix("film-"): path
        for path in found("*.webp").values()
        if path.name.startswith("film-") or path.name == "controllers.webp"
    }
    assert set(films) == {*SCENES, "controllers"}
    assert set(demo_film.GALLERY) == set(SCENES)
    for name, path in films.items():
        assert path.stat().st_size < 8e5
        demo = name == "controllers"
        seconds = demo_film.DURATION if demo else demo_film.OF_A_DEVICE
        with Image.open(path) as film:
            assert film.size == demo_film.LAYOUTS[3 if demo else 1].size[::-1]
            assert film.n_frames == round(seconds * demo_film.RATE)  # type: ignore[attr-defined]


def test_the_gallery_gives_the_command_of_every_film() -> None:
    page = PAGES["envs/README.md"]
    for name, (law, _, task) in demo_film.GALLERY.items():
        choice = f" --task {task}" if task else ""
        command = f"cc-mujoco play {name}{choice} --controller {law} --video"
        (cell,) = (each for each in page.split("|") if f"(film-{name}.webp)" in each)
        assert f"`{command}`" in cell
        parse("cc-mujoco", command.split()[1:])


@pytest.mark.parametrize("name", fill_readme.SHORT)
def test_a_block_is_written_on_its_page_and_in_short_on_the_front_page(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = [fill_readme.PAGES[name].read_text("utf-8"), FRONT]
    places = [tmp_path / "page.md", tmp_path / "front.md"]
    for place, text in zip(places, before, strict=True):
        place.write_text(text, "utf-8")
    monkeypatch.setitem(fill_readme.PAGES, name, places[0])
    monkeypatch.setattr(fill_readme, "FRONT", places[1])
    parts = [r"1\0", "two\nlines", "three", "four"]
    fill_readme.write(name, "\n\n".join(parts))
    written = [place.read_text("utf-8") for place in places]
    for text, old, count in zip(
        written, before, (len(parts), fill_readme.SHORT[name]), strict=True
    ):
        assert fill_readme.between(text, name) == "\n\n".join(parts[:count])
        again = fill_readme.filled(text, name, fill_readme.between(old, name))
        assert again == old  # nothing else is touched


@pytest.mark.parametrize("name", fill_readme.TABLES)
def test_a_table_beside_a_page_is_that_of_the_package(name: str) -> None:
    with fill_readme.TABLES[name].open(encoding="utf-8", newline="") as file:
        written = list(csv.reader(file))
    assert written == fill_readme.package_tables()[name], "run fill_readme.py tables"
    assert (
        f"({fill_readme.TABLES[name].name})"
        in PAGES[f"cc_mujoco/{fill_readme.TABLES[name].parent.name}/README.md"]
    )


def test_every_key_of_a_dataset_is_in_its_example() -> None:
    place = Path(_dataset_file.__file__).with_name("dataset.toml")
    example = place.read_text("utf-8")
    for key in (
        *Source.__dataclass_fields__,
        *RIG_CONSTANTS,
        *TrialFacts.__annotations__,
    ):
        assert (
            re.search(rf"^ *#? *{key} =", example, re.M) or f" {key} = " in example
        ), key


def test_every_field_of_a_reading_is_on_the_page_of_the_engine() -> None:
    page = (ROOT / "cc_mujoco" / "plugin" / "README.md").read_text("utf-8")
    told = page.partition("| field |")[2].partition("\n\n")[0]
    rows = [row.split("|")[1] for row in told.splitlines()[2:]]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    fields = [field.name for field in dataclasses.fields(CableReading)]
    assert sorted(named) == sorted(fields)


@pytest.mark.parametrize(
    "text",
    [
        "```bash\nls\n```\n",
        "```\nls\n```\n",
        "```sh\n# in a checkout, 3 lightyears\nls\n```\n",
        "~~~sh\nls\n~~~\n",
        "One does\n\n    cc-mujoco play wrist\n",
    ],
)
def test_a_block_that_nobody_can_run_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^page\.md"):
        page_blocks.blocks_of("page.md", text)


def test_the_first_line_of_a_block_says_where_it_runs() -> None:
    def only(text: str, kind: str = "sh") -> page_blocks.Block:
        (block,) = page_blocks.blocks_of("page.md", f"\n```{kind}\n{text}\n```\n")
        return block

    assert only("ls").group == only("# any remark\nls").group == "wheel"
    assert only("ls").place == "page.md:2"
    assert only("# in a checkout\nls").group == "checkout"
    assert only("# in a checkout, 3 minutes\nls").seconds == 180.0
    assert only("# 40 s\nls").group == "wheel, study"
    assert only("# 2 hours\nls").group == "hours"
    assert only("# with a network\nls").group == "with a network"
    assert only('# in another terminal until "a b"\nls').until == "a b"
    assert only("<!-- wrist.xml -->\n<mujoco/>", "xml").file == "wrist.xml"
    assert only("# mine.py\nx = 1", "python").file == "mine.py"


@pytest.mark.parametrize("block", NOT_ALWAYS, ids=lambda block: block.place)
def test_a_block_that_does_not_always_run_has_commands_that_exist(
    block: page_blocks.Block,
) -> None:
    if block.kind == "python":
        compile(block.code, block.place, "exec")
    for words in block.commands("cc-mujoco"):
        parse("cc-mujoco", words)


@pytest.mark.study
@pytest.mark.parametrize(
    "block",
    [block for block in NOT_ALWAYS if "study" not in block.group],
    ids=lambda block: block.place,
)
def test_a_block_that_does_not_run_here_has_options_that_exist(
    block: page_blocks.Block,
) -> None:
    folder = re.search(r"^cd (\S+)$", block.code, re.M)
    for name, *words in block.commands("python"):
        options = {word for word in words if word.startswith("--")}
        place = ROOT / (folder[1] if folder else "") / name
        shown = subprocess.run(
            [sys.executable, place if place.is_file() else ROOT / name, "--help"],
            capture_output=True,
            check=True,
            text=True,
        )
        assert options <= set(re.findall(r"--[\w-]+", shown.stdout)), name


def test_mjcf_loads_and_pulls() -> None:
    (xml,) = re.findall(r"```xml\n(.*?)```", FRONT, re.S)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.ctrl[0] = 10.0 * 0.02  # holds the pretension
    mujoco.mj_step(model, data)
    reading = cc_mujoco.plugin.read(model, data, "flexor")
    assert reading.tension_proximal == pytest.approx(10.0)
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    assert np.abs(data.qvel).max() < 1e-6
    assert np.abs(data.qpos).max() < 0.02
    reading = cc_mujoco.plugin.read(model, data, "flexor")
    assert reading.tension_distal == pytest.approx(10.0, rel=0.05)
    assert reading.dissipated < 1e-3
    limits = cc_mujoco.plugin.step_limits(model)["flexor"]
    assert model.opt.timestep < 0.5 * min(limits)


CONTRIBUTING = PAGES[".github/CONTRIBUTING.md"]


def test_files_that_contributors_are_sent_to_exist() -> None:
    table = CONTRIBUTING.partition("## Where to add what")[2].partition("\n## ")[0]
    names = re.findall(r"`([\w/]*/\w*(?:\.\w+)?)`", table)
    assert len(names) > 20
    for name in names:
        places = ROOT / "cc_mujoco" / name, ROOT / name
        assert any(place.exists() for place in places), name
    for name, place in re.findall(r"`(\w+)` (?:in|of) `([\w/]+\.py)`", table):
        places = ROOT / "cc_mujoco" / place, ROOT / place
        (source,) = (path.read_text("utf-8") for path in places if path.exists())
        assert re.search(rf"^(class |def )?{name}\b", source, re.M), (name, place)


def test_layers_that_contributors_read_are_those_of_the_import_contract() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    contract = settings["tool"]["importlinter"]["contracts"][0]["layers"]
    enforced = [set(layer.split(" | ")) for layer in contract]
    table = CONTRIBUTING.partition("| layer |")[2].partition("\n\n")[0]
    rows = [row.split("|")[2] for row in table.splitlines()[2:]]
    written = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    written.remove("envs")
    for layer in enforced:
        assert set(written[: len(layer)]) == layer
        del written[: len(layer)]
    assert not written


@pytest.mark.parametrize("place", PAGES)
def test_scripts_that_it_names_exist(place: str) -> None:
    for name in re.findall(r"scripts/[\w/]+(?:\.\w+)?", PAGES[place]):
        assert (ROOT / name).exists(), name


def calls(text: str, is_page: bool) -> list[tuple[str, set[str]]]:
    """Return the scripts that a page or a docstring calls, with the options of each."""
    if is_page:
        blocks = re.findall(r"^```.*?^```", text, re.M | re.S)
        rest = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
        spans = (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", rest))
        text = "\n".join([*blocks, *spans])
    found = re.findall(
        r"\bpython (scripts/\S+\.py)([^\n#&|]*)", text.replace("\\\n", " ")
    )
    return [(name, set(re.findall(r"--[a-z][a-z-]*", rest))) for name, rest in found]


def options_of(script: Path) -> set[str]:
    """Return the options of a script, whether of `argparse` or of `tyro`."""
    tree = ast.parse(script.read_text("utf-8"))
    names = {
        each.args[0].value
        for each in ast.walk(tree)
        if isinstance(each, ast.Call)
        and getattr(each.func, "attr", "") == "add_argument"
        and isinstance(each.args[0], ast.Constant)
    }
    if "tyro.cli(main" in script.read_text("utf-8"):
        (main,) = (each for each in tree.body if getattr(each, "name", "") == "main")
        assert isinstance(main, ast.FunctionDef)
        names |= {f"--{each.arg.replace('_', '-')}" for each in main.args.args}
    return names


@pytest.mark.parametrize("place", [*PAGES, *found("scripts/**/*.py")])
def test_scripts_that_it_calls_have_the_options(place: str) -> None:
    text = (ROOT / place).read_text("utf-8")
    is_page = place in PAGES
    if not is_page:
        text = ast.get_docstring(ast.parse(text)) or ""
    for name, options in calls(text, is_page):
        assert options <= options_of(ROOT / name), f"{name} {options}"


def test_a_call_is_found_in_sentences_blocks_and_docstrings() -> None:
    page = "Run `python\nscripts/a.py --one 1` so:\n\n```sh\npython scripts/b.py \\\n"
    page += "    --two-three x  # --four\n```\n"
    assert calls(page, True) == [
        ("scripts/b.py", {"--two-three"}), ("scripts/a.py", {"--one"}),
    ]  # fmt: skip
    assert calls("Do.\n\n    python scripts/a.py --one\n", False) == [
        ("scripts/a.py", {"--one"})
    ]
    listed = [call for text in PAGES.values() for call in calls(text, True)]
    assert len(listed) > 25
