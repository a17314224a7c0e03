"""Videos of an environment, in real time."""

from __future__ import annotations

from typing import Any

import gymnasium

from ._render import frame_interval


class RecordVideo(gymnasium.wrappers.RecordVideo[Any, Any]):
    """Gymnasium's `RecordVideo` with 30 pictures a second, as players expect.

    Gymnasium's own puts a picture for every control step into the file, a thousand a
    second of them; it plays in real time too, but takes long to encode. All else, and
    the arguments, are Gymnasium's; `video_length` counts pictures.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], video_folder: str, **options: Any
    ) -> None:
        """Wrap an environment of this package, made with `render_mode="rgb_array"`."""
        period = env.get_wrapper_attr("exo").period
        self._stride = frame_interval(period)
        self._asked = 0
        options.setdefault("fps", 1.0 / (self._stride * period))
        super().__init__(env, video_folder, **options)

    def start_recording(self, video_name: str) -> None:
        """Start a new recording, with a picture at once."""
        super().start_recording(video_name)
        self._asked = 0

    def _capture_frame(self) -> None:
        if self._asked % self._stride == 0:
            super()._capture_frame()  # type: ignore[no-untyped-call]
        self._asked += 1
