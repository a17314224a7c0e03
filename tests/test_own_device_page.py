"""The page about a device of one's own: commands do what it says, no key is missing.

The blocks of a section run in a folder with the three files of the example and what the
sections before it write by hand, for shorter than the page says.
`scripts/examples/README.md` is the source.
"""

from __future__ import annotations

import dataclasses
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cc_mujoco import cli
from cc_mujoco.cli._parsing import parse
from cc_mujoco.device import Sensing, find_device
from cc_mujoco.device import _derivation as derivation
from cc_mujoco.device._description import Cuff
from hardware.peers import Peer
from page_blocks import Block, blocks_of

FOLDER = Path(__file__).parents[1] / "scripts" / "examples"
FILES = ("knee_exo.xml", "knee_motion.csv", "knee_trials.py")
PAGE = (FOLDER / "README.md").read_text(encoding="utf-8")
SECTIONS = {
    text.partition("\n")[0]: text for text in re.split(r"^## ", PAGE, flags=re.M)[1:]
}
ADDRESS = 'address = "127.0.0.1:5005"'
DURATION = re.compile(r"\b(duration[ =])(\d+(?:\.\d+)?)")
SHORTER = 10.0
MOST_WORDS = 1300


def blocks(section: str) -> list[Block]:
    """Return the blocks of a section."""
    return blocks_of(section, SECTIONS[section])


def commands(text: str) -> list[list[str]]:
    """Return the commands of a block, as words."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def shortened(text: str) -> str:
    """Return a block whose episodes and trials are shorter, without processes.

    Designs are played with a controller whose episodes are compiled.
    """
    text = DURATION.sub(lambda found: f"{found[1]}{float(found[2]) / SHORTER:g}", text)
    text = text.replace("predictive --duration", "pi --duration")
    benchmark = "--seeds 1 --duration "  # episodes that exceed a second
    text = text.replace(f"{benchmark}0.2", f"--workers 1 {benchmark}1.1")
    return text.replace("knee_trials.py --out", "knee_trials.py --seconds 4 --out")


def write(block: Block) -> None:
    """Write a block to the file that its first line names, or add it there."""
    with Path(block.file).open("a", encoding="utf-8") as file:
        file.write(block.code)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in FILES:
        shutil.copy(FOLDER / name, tmp_path)
    return tmp_path


def run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command of the page in this process."""
    if words[:2] == ["cc-mujoco", "view"]:
        parse("cc-mujoco", words[1:])  # needs a screen
    elif words[:2] == ["cc-mujoco", "run"]:
        with Peer() as peer:
            text = Path("rig.toml").read_text().replace(ADDRESS, peer.end.rig)
            Path("rig.toml").write_text(text)
            assert cli.main(words[1:]) == 0, words
    elif words[0] == "cc-mujoco":
        assert cli.main(words[1:]) == 0, words
    else:
        assert words[0] == "python", words
        monkeypatch.setattr(sys, "argv", words[1:])
        runpy.run_path(words[1], run_name="__main__")


def play(section: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run all blocks of a section, after what earlier ones write by hand."""
    for other in SECTIONS:
        if other == section:
            break
        for block in blocks(other):
            if block.kind == "toml":
                write(block)
    for block in blocks(section):
        if block.kind == "toml":
            write(block)
        else:
            assert block.kind == "sh"
            for words in commands(shortened(block.code)):
                run(words, monkeypatch)


def described(folder: Path, output: str) -> None:
    found = dict(re.findall(r"^  ([\w.]+) +\"?([^\s\"]+)", output, re.M))
    assert found["axis.motor"] == "winder"
    assert found["axis.joint"] == "right_knee"
    assert found["wearer.right_knee.actuator"] == "leg"
    assert found["wearer.right_knee.stiffness"] == "250.0"
    assert f"`{found['axis.task']}`" in SECTIONS["Describe it"]
    assert "safe_torque" in (folder / "described.toml").read_text()


def compared(folder: Path, _: str) -> None:
    for name in ("whatif/report.html", "cuff/report.html", "benchmark/results.parquet"):
        assert (folder / "runs" / name).is_file()


def diagnosed(folder: Path, output: str) -> None:
    assert "named: Viscous friction in the conduit is missing" in output
    assert "viscous_friction" in (folder / "runs/diagnosis/scene.xml").read_text()


def driven(folder: Path, output: str) -> None:
    assert (folder / "runs/c/cc_controller.h").is_file()
    assert "the 0.1 s are over" in output


CHECKS: dict[str, Callable[[Path, str], None]] = {
    "Describe it": described,
    "Compare and design": compared,
    "Diagnose it": diagnosed,
    "Put it on hardware": driven,
}


LONG = ("Compare and design", "Diagnose it")


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize(
    "section",
    [
        pytest.param(name, marks=pytest.mark.study if name in LONG else ())
        for name in CHECKS
    ],
)
def test_commands_of_the_page_do_what_it_says(
    section: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    play(section, monkeypatch)
    CHECKS[section](folder, capsys.readouterr().out)


@pytest.mark.usefixtures("undrawn")
def test_a_device_without_a_safe_torque_is_played_with_one_that_is_assumed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["play", "knee_exo.xml", "--duration", "0.1", "--out", "runs/x"]
    assert cli.main([*words, "--controller", "pi"]) == 0
    assert re.search(
        r"assumed safe torque: [\d.]+ N m at joint 'right_knee'",
        capsys.readouterr().out,
    )
    (folder / "knee_exo.device.toml").write_text("[axis]\nsafe_torque = 0.5\n")
    assert cli.main([*words, "--controller", "none"]) == 0
    out, err = capsys.readouterr()
    assert "assumed" not in out
    assert "at joint 'right_knee' was above the safe 0.5 N m" in err


def test_the_page_copies_the_files_of_the_example() -> None:
    (block,) = blocks_of("page", PAGE.partition("\n## ")[0])
    assert {Path(word).name for word in block.commands("cp")[0][:-1]} == set(FILES)


def test_the_page_is_short_and_the_scene_has_names_of_its_own() -> None:
    assert len(PAGE.split()) <= MOST_WORDS
    text = (FOLDER / "knee_exo.xml").read_text(encoding="utf-8")
    names = set(re.findall(r'\bname="(\w+)"', text))
    assert not {name for name in names if re.match("motor|wearer", name)}
    lines = re.search(r"\[`knee_exo.xml`\]\(knee_exo.xml\), (\d+) lines", PAGE)
    assert lines is not None and int(lines[1]) == len(text.splitlines()) <= 70


def test_a_written_description_says_how_commands_come_to_read_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("knee_exo.device.toml").unlink(missing_ok=True)
    assert cli.main(["device", "knee_exo.xml", "--out", "other.toml"]) == 0
    said = capsys.readouterr().out
    assert "give other.toml to the commands in place of knee_exo.xml" in said
    assert "or rename it to knee_exo.device.toml" in said
    assert find_device("other.toml").path == Path("knee_exo.xml")
    (folder / "there").mkdir()
    assert cli.main(["device", "knee_exo.xml", "--out", "there/my.toml"]) == 0
    assert "put a copy of knee_exo.xml beside it" in capsys.readouterr().out
    assert cli.main(["device", "knee_exo.xml"]) == 0
    assert "the commands read it with knee_exo.xml" in capsys.readouterr().out


def test_every_key_is_in_the_written_description_or_on_the_page(folder: Path) -> None:
    assert cli.main(["device", "knee_exo.xml", "--out", "described.toml"]) == 0
    told = (folder / "described.toml").read_text("utf-8") + SECTIONS["Every key"]
    fields = {
        field.name for kind in (Sensing, Cuff) for field in dataclasses.fields(kind)
    }
    keys = {
        *(key for keys in derivation.KEYS.values() for key in keys),
        *derivation.UNITS,
        *fields,
    }
    assert not {key for key in keys - {"tendon"} if not re.search(rf"\b{key}\b", told)}
