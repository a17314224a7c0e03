"""The engine plugin as a shared library computes the same bits without Python."""

from __future__ import annotations

import contextlib
import io
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.cable._cable import KEYS
from cc_mujoco.errors import CableError
from cc_mujoco.export import _plugin_library, write_plugin, write_plugin_source
from cc_mujoco.native._library import digest
from cc_mujoco.plugin import _registration as registration
from cc_mujoco.plugin._registration import PLUGIN_LIBRARY

ROOT = Path(__file__).parents[2]
SCENES = sorted(scene_path("wrist").parent.glob("*.xml"))

STEPS = """
import hashlib, sys
import mujoco
import numpy as np
from mujoco import batch, rollout
if sys.argv[1]:
    mujoco.mj_loadPluginLibrary(sys.argv[1])
else:
    import cc_mujoco.plugin
for file in sys.argv[2:]:
    spec = mujoco.MjSpec.from_file(file)
    for integrator in range(4):
        spec.option.integrator = integrator
        model = spec.compile()
        data = mujoco.MjData(model)
        total = hashlib.sha256()
        for step in range(30):
            data.ctrl[:] = np.sin(0.3 * step + np.arange(model.nu))
            mujoco.mj_step(model, data)
            for seen in (data.qpos, data.qvel, data.plugin_state, data.actuator_force):
                total.update(seen.tobytes())
        physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(model, physics))
        mujoco.mj_getState(model, data, start, physics)
        states, _ = rollout.rollout(
            model, data, np.stack([start] * 3), nstep=10
        )
        total.update(states.tobytes())
        many = batch.Batch(model, 3, nthread=2)
        qpos, plugin_state = many.bind("qpos"), many.bind("plugin_state")
        many.step(nstep=10)
        total.update(qpos.tobytes() + plugin_state.tobytes())
        print(file, integrator, total.hexdigest())
assert not sys.argv[1] or "cc_mujoco" not in sys.modules
"""

FUNCTIONS = """
import sys
import mujoco
if sys.argv[1]:
    mujoco.mj_loadPluginLibrary(sys.argv[1])
from cc_mujoco import plugin
for file in sys.argv[2:]:
    model = mujoco.MjModel.from_xml_path(file)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    data.qpos[:] += 0.01
    plugin.settle(model, data)
    print(data.plugin_state.tobytes().hex(), plugin.step_limits(model, data))
    for name in plugin.cables(model):
        print(plugin.stored_energy(model, data, name), plugin.read(model, data, name))
        print(plugin.segment_wrap(model, data, name).tobytes().hex())
        try:
            print(plugin.route_tendon(model, name))
            print(plugin.route_wrap(model, data, name))
        except ValueError as error:
            print(error)
"""

CALLED = """
import ctypes, sys
import mujoco
mujoco.mj_loadPluginLibrary(sys.argv[1])
from cc_mujoco.plugin import cables
from cc_mujoco.plugin._path_table import moving_joints
library = ctypes.CDLL(sys.argv[1])
assert [name for name in sys.argv[3:] if not hasattr(library, name)] == []
model = mujoco.MjModel.from_xml_path(sys.argv[2])
for name in cables(model):
    assert moving_joints(model, name, poses=1)
"""

STALE = """
import sys
import mujoco
mujoco.mj_loadPluginLibrary(sys.argv[1])
try:
    import cc_mujoco.plugin
except ImportError as error:
    print(error)
"""

REFUSED = """
import sys, mujoco
if sys.argv[1]:
    mujoco.mj_loadPluginLibrary(sys.argv[1])
else:
    import cc_mujoco.plugin
spec = mujoco.MjSpec.from_file(sys.argv[2])
kept = [dict(plugin.config) for plugin in spec.plugins]
for key in sys.argv[3:]:
    for plugin, config in zip(spec.plugins, kept):
        plugin.config = config | {key: "?"}
    try:
        spec.compile()
    except ValueError as error:
        print(error)
"""

WARNED = """
import sys, mujoco
if sys.argv[1]:
    mujoco.mj_loadPluginLibrary(sys.argv[1])
else:
    import cc_mujoco.plugin
for file in sys.argv[2:]:
    spec = mujoco.MjSpec.from_file(file)
    spec.option.timestep = 0.05
    for plugin in spec.plugins:
        plugin.config = dict(plugin.config) | {"ends": "explicit"}
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] += 0.5
    mujoco.mj_step(model, data, 2)
"""

OTHER_RELEASE = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
version = ctypes.CFUNCTYPE(ctypes.c_int)(lambda: 5_001_000)
warning = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda text: print(text.decode()))
found = (ctypes.c_void_p * int(sys.argv[2]))()
found[-3], found[-1] = (ctypes.cast(f, ctypes.c_void_p) for f in (version, warning))
assert library.cc_mujoco_register(found) == -1
"""

HOST = """
#include <stdio.h>
#include <mujoco/mujoco.h>
int main(int count, char** given) {
  char error[1000] = "";
  mj_loadPluginLibrary(given[1]);
  mjModel* model = mj_loadXML(given[2], NULL, error, sizeof(error));
  if (!model) { printf("%s\\n", error); return 1; }
  mjData* data = mj_makeData(model);
  for (int i = 0; i < 100; i++) mj_step(model, data);
  for (int i = 0; i < model->nq; i++) printf("%a ", data->qpos[i]);
  return 0;
}
"""


def played_here(script: str, *words: str | Path) -> str:
    """Return what a script of these prints in this process, with the plugin of Python.

    The scripts take a library first; here there is none.
    """
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
        patch.setattr(sys, "argv", ["-c", "", *map(str, words)])
        exec(script, {})
    return said.getvalue()


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, text=True, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def library(plugin_library: Path) -> Path:
    return plugin_library


def test_library_computes_the_bits_of_python(library: Path, tmp_path: Path) -> None:
    native = run(sys.executable, "-P", "-c", STEPS, library, *SCENES, cwd=tmp_path)
    assert len(native.splitlines()) == 4 * len(SCENES)
    assert native == played_here(STEPS, *SCENES)


def test_functions_in_python_use_the_loaded_library(
    library: Path, tmp_path: Path
) -> None:
    native = run(sys.executable, "-P", "-c", FUNCTIONS, library, *SCENES, cwd=tmp_path)
    assert "StepLimits" in native
    assert native == played_here(FUNCTIONS, *SCENES)


def test_library_of_other_code_is_no_plugin_for_python(
    library: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.so"
    content = library.read_bytes()
    made_of = digest().encode()
    assert content.count(made_of) == 1
    other.write_bytes(content.replace(made_of, b"0" * len(made_of)))
    said = run(sys.executable, "-P", "-c", STALE, other, cwd=tmp_path)
    assert f"that of {other}, written by another version of cc_mujoco" in said


def test_library_has_every_function_that_python_calls(
    library: Path, tmp_path: Path
) -> None:
    own = [f"cc_mujoco_{name}" for name in registration.PYTHON_FUNCTIONS]
    scene = scene_path("wrist")
    run(sys.executable, "-P", "-c", CALLED, library, scene, *own, cwd=tmp_path)


def test_library_refuses_a_configuration_as_python_does(
    library: Path, tmp_path: Path
) -> None:
    scene = scene_path("wrist")
    words = (scene, *KEYS)
    native = run(sys.executable, "-P", "-c", REFUSED, library, *words, cwd=tmp_path)
    assert all(f"key `{key}` is '?'" in native for key in KEYS)
    assert native == played_here(REFUSED, *words)


def test_library_warns_as_python_does(library: Path, tmp_path: Path) -> None:
    said = []
    for loaded in (library, ""):
        folder = tmp_path / ("native" if loaded else "python")
        folder.mkdir()
        run(sys.executable, "-P", "-c", WARNED, loaded, *SCENES, cwd=folder)
        log = (folder / "MUJOCO_LOG.TXT").read_text().splitlines()
        said.append([line.partition("plugin")[2] for line in log])
    assert any("stable only with a `timestep` below" in line for line in said[0])
    assert said[0] == said[1]


def test_library_refuses_a_release_that_it_does_not_know(
    library: Path, tmp_path: Path
) -> None:
    count = str(len(registration.ENGINE_NAMES))
    said = run(sys.executable, "-P", "-c", OTHER_RELEASE, library, count, cwd=tmp_path)
    assert said.startswith(f"{PLUGIN_LIBRARY} is for MuJoCo 3.17.0, 4.0.0, not for")


@pytest.mark.study
def test_source_builds_with_cmake(library: Path, tmp_path: Path) -> None:
    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("there is no cmake")
    written = write_plugin_source(tmp_path / "source").parent
    listed = written / "CMakeLists.txt"
    listed.write_text(listed.read_text().replace(" -O3 ", " -O0 "))
    run(cmake, "-S", written, "-B", tmp_path / "built", cwd=tmp_path)
    run(cmake, "--build", tmp_path / "built", cwd=tmp_path)
    (built,) = (tmp_path / "built").glob("libcc_mujoco_cable.*")
    scene = scene_path("wrist")
    one, other = (
        run(sys.executable, "-P", "-c", STEPS, loaded, scene, cwd=tmp_path)
        for loaded in (library, built)
    )
    assert one == other


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no C compiler `cc`")
def test_library_works_in_a_host_in_c(library: Path, tmp_path: Path) -> None:
    home = Path(mujoco.__file__).parent
    (engine,) = home.glob("libmujoco.so*")
    (tmp_path / "host.c").write_text(HOST)
    include = f"-I{home / 'include'}"
    run(
        *("cc", "host.c", include, engine, f"-Wl,-rpath,{home}", "-o", "host"),
        cwd=tmp_path,
    )
    scene = scene_path("wrist")
    written = run(tmp_path / "host", library, scene, cwd=tmp_path)
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert [float.fromhex(text) for text in written.split()] == data.qpos.tolist()


def test_library_that_exists_is_kept(library: Path) -> None:
    with pytest.raises(CableError, match=f"{PLUGIN_LIBRARY} exists"):
        write_plugin(library.parent)


def test_file_in_place_of_the_folder_is_refused_before_compiling(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_plugin_library, "_source", pytest.fail)
    taken = tmp_path / "taken"
    taken.write_text("mine")
    with pytest.raises(CableError, match="taken is a file; it must be a folder"):
        write_plugin(taken)
    assert taken.read_text() == "mine"
