"""Commands of an environment that start warm: forks of one process with its imports.

Most of a short command are imports and drawings. Two small scripts, `python` and
`cc-mujoco`, hand their words to a process of the environment that has imported what is
needed and leaves drawings and recordings empty.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_ASK = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    words = [os.getcwd(), dict(os.environ), {name!r}, *sys.argv[1:]]
    text = json.dumps(words).encode()
    socket.send_fds(server, [len(text).to_bytes(4, "big")], [0, 1, 2])
    server.sendall(text)
    sys.exit(int(server.recv(10) or b"1"))
"""
_SERVE = """
import contextlib, json, os, runpy, signal, socket, sys

def work(client):
    head, places, *_ = socket.recv_fds(client, 4, 3)
    text = client.recv(int.from_bytes(head, "big"), socket.MSG_WAITALL)
    folder, environment, name, *words = json.loads(text)
    child = os.fork()
    if child:
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        client.send(str(code % 256).encode())
        os._exit(0)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, place in enumerate(places):
        os.dup2(place, number)
        os.close(place)
    if name == "cc-mujoco":
        from cc_mujoco.cli import main
        sys.exit(main(words))
    sys.argv = words
    if words[0] == "-c":
        sys.argv = words[:1] + words[2:]
        sys.path.insert(0, "")
        exec(words[1], {"__name__": "__main__"})
    else:
        sys.path.insert(0, folder)
        runpy.run_path(words[0], run_name="__main__")

if __name__ == "__main__":
    import gymnasium.envs, matplotlib.figure, mujoco.rollout, pyarrow.parquet
    import rerun.blueprint, scipy.optimize, scipy.signal, tyro
    import cc_mujoco.cli._play, cc_mujoco.design._execution, cc_mujoco.design._report
    import cc_mujoco.viz._episode_files, cc_mujoco.viz._rerun_file
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    FigureCanvasAgg.draw = FigureCanvasAgg.get_renderer
    cc_mujoco.viz._rerun_file.write_recording = lambda path, *_: path.touch()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(sys.argv[1])
        listening.listen()
        print("ready", flush=True)
        while True:
            client, _ = listening.accept()
            if not os.fork():
                listening.close()
                work(client)
                break
            client.close()
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
"""


@contextmanager
def warm(commands: Path) -> Iterator[Path]:
    """Give a folder with `python` and `cc-mujoco` of an environment, started warm.

    Args:
        commands: Folder of the environment's commands.
    """
    if sys.platform != "linux":
        yield commands
        return
    with tempfile.TemporaryDirectory() as home:
        folder, address = Path(home), f"{home}/socket"
        for name in ("python", "cc-mujoco"):
            words = {"python": sys.executable, "address": address, "name": name}
            (folder / name).write_text(_ASK.format(**words))
            (folder / name).chmod(0o755)
        (folder / "serve.py").write_text(_SERVE)
        served = subprocess.Popen(
            [commands / "python", folder / "serve.py", address],
            env={k: v for k, v in os.environ.items() if k[:6] != "PYTHON"},
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        with served:
            try:
                assert served.stdout is not None
                assert served.stdout.readline() == "ready\n"
                yield folder
            finally:
                os.killpg(served.pid, signal.SIGKILL)
