"""Films and frames on disk."""

import importlib.util
import math
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..disk import replacing

FRAME_FORMATS = ("png", "none")
FILM_FORMATS = ("webp", "mp4", "gif", "none")


def check_formats(frames: str, video: str) -> None:
    """Raise ValueError unless both formats are known, and mp4 can be written if it is asked for."""
    checks.one_of("frames", frames, FRAME_FORMATS)
    checks.one_of("video", video, FILM_FORMATS)
    if video == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError("video 'mp4' needs the extra `video`: pip install 'msdwarp[video]'")


def write_film(
    images: Iterable[NDArray[np.uint8]],
    count: int,
    folder: Path,
    *,
    name: str,
    fps: float,
    frames: str = "png",
    video: str = "webp",
) -> Path | None:
    """Write pictures as they come: `frame_0000.png` and so on, and a film.

    Parameters
    ----------
    images
        Pictures, uint8 of shape [height, width, 3], all of one size; never more than a few are kept.
    count
        How many there are.
    folder
        Where to, an existing folder.
    name
        Name of the film, without its ending.
    fps
        Pictures per second of the film.
    frames, video
        Formats, see FRAME_FORMATS and FILM_FORMATS.

    Returns
    -------
    Path | None
        The film, if one was asked for. It has its name only once it is whole.
    """
    check_formats(frames, video)
    if frames == "png":
        images = _with_frames(images, folder)
    if video == "none":
        for _ in images:
            pass
        return None
    path = folder / f"{name}.{video}"
    with replacing(path) as unfinished:
        _write_film(iter(images), count, unfinished, video, fps)
    return path


def _with_frames(images: Iterable[NDArray[np.uint8]], folder: Path) -> Iterator[NDArray[np.uint8]]:
    """Pass the pictures on, and write each as PNG beside: a thread compresses while the next is drawn."""
    with ThreadPoolExecutor(1) as pool:
        pending: Future[None] | None = None
        for k, image in enumerate(images):
            if pending is not None:
                pending.result()
            path = folder / f"frame_{k:04d}.png"
            # Level 1: a fifth of the time of the default level, and hardly larger.
            pending = pool.submit(Image.fromarray(image).save, path, compress_level=1)
            yield image
        if pending is not None:
            pending.result()


class _Reel(Image.Image):
    """The pictures as one image of many frames, in Pillow's sense: each is fetched when it is sought.

    As `append_images` they would all be in memory at once: Pillow makes a list of those for WebP.
    """

    def __init__(self, images: Iterator[NDArray[np.uint8]], count: int) -> None:
        super().__init__()
        self.n_frames = count
        self._images, self._at = images, -1
        self.seek(0)

    def seek(self, frame: int) -> None:
        """Go forward to a frame; going back shows the present one."""
        if frame >= self.n_frames:
            raise EOFError
        while self._at < frame:
            picture = Image.fromarray(next(self._images))
            # A class of images has to set `_mode` and `_size` itself: `mode` and `size` can only be read (Pillow
            # Handbook, "Writing your own image plugin").
            self.im, self._mode, self._size = picture.im, picture.mode, picture.size
            self._at += 1

    def tell(self) -> int:
        """Return the number of the present frame."""
        return self._at


def _write_film(images: Iterator[NDArray[np.uint8]], count: int, path: Path, video: str, fps: float) -> None:
    if video == "mp4":
        import imageio.v2 as imageio  # pyright: ignore[reportMissingImports]

        writer: Any = imageio.get_writer(path, fps=fps, macro_block_size=2, quality=8)
        with writer as film:
            for image in images:
                film.append_data(image)
        return
    every = 1
    if video == "gif":  # counts whole hundredths of a second, and viewers slow down anything below 2
        every = math.ceil(fps * 0.02)
        images = (image for k, image in enumerate(images) if k % every == 0)
    reel = _Reel(images, math.ceil(count / every))
    options: dict[str, Any] = {"quality": 75, "method": 2} if video == "webp" else {}
    reel.save(path, save_all=True, duration=1000 * every / fps, loop=0, **options)
    for _ in images:  # those behind the last one shown
        pass
