"""Frames to files: MP4 (H.264, by PyAV, the extra `video`), GIF and WebP (by Pillow), or a folder of PNG files.

Files are written whole or not at all. Refuses other suffixes, and MP4 where PyAV is not installed.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

from mrp_sumo.errors import MrpSumoError, sentence
from mrp_sumo.files.reading import shortened
from mrp_sumo.files.writing import writing_to, written_for_user
from mrp_sumo.reports.pictures.floor import STATES
from mrp_sumo.reports.video.canvas import Pixels

SUFFIXES = (".mp4", ".gif", ".webp")
FPS = {".mp4": 30, ".gif": 20, ".webp": 20, "": 30}  # by suffix; GIF counts hundredths of a second
SIZE = {".mp4": (1920, 1080), ".gif": (960, 540), ".webp": (960, 540), "": (1920, 1080)}
QUALITY = {"preset": "superfast", "crf": "18"}


def kind_of(path: str) -> str:
    """The suffix of a video; '' for a folder of frames. Raises MrpSumoError for another suffix, and for MP4 where nothing can encode it."""
    if path.endswith("/"):
        return ""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise MrpSumoError(f"{path}: a video ends in .mp4, .gif or .webp, or in / for a folder of frames")
    if suffix == ".mp4" and find_spec("av") is None:
        raise MrpSumoError(f"{path}: MP4 needs PyAV: pip install 'mrp-sumo[video]', or write .gif, .webp or frames/ instead")
    return suffix


def write_video(frames: Iterator[Pixels], poster: Pixels, path: Path, kind: str, fps: int) -> None:
    """Write frames, each valid until the next, as a video of a kind (see `kind_of`); GIF takes its colours from the poster.

    Raises MrpSumoError when it cannot be written; nothing is left then.
    """
    if kind == "":
        return _write_frames(frames, path)
    write = {".mp4": _write_mp4, ".gif": _write_gif, ".webp": _write_webp}[kind]
    with written_for_user(path) as part:
        part.touch()  # says plainly why a place cannot be written
        write(frames, poster, part, fps)
    return None


def write_png(pixels: Pixels, path: Path) -> None:
    """Write a frame. Raises MrpSumoError where it cannot be written."""
    with writing_to(path):
        Image.fromarray(pixels[..., :3]).save(path, compress_level=2)


def _write_frames(frames: Iterator[Pixels], folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise MrpSumoError(f"{shortened(folder)}: cannot be made: {sentence(error)}") from None
    for k, frame in enumerate(frames):
        write_png(frame, folder / f"{k:05d}.png")


def _write_mp4(frames: Iterator[Pixels], poster: Pixels, path: Path, fps: int) -> None:
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as file:
        stream = file.add_stream("libx264", rate=fps, options=QUALITY)
        stream.height, stream.width = poster.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        for pixels in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgba")))
        file.mux(stream.encode(None))


def _write_gif(frames: Iterator[Pixels], poster: Pixels, path: Path, fps: int) -> None:
    """All frames have the poster's colours and those of the states, or they would flicker."""
    states = [tuple(bytes.fromhex(colour[1:])) for colour in STATES]
    band = np.repeat(np.array(states, np.uint8), len(poster) * poster.shape[1] // 40, axis=0)
    band = band[: len(band) // poster.shape[1] * poster.shape[1]].reshape(-1, poster.shape[1], 3)
    palette = Image.fromarray(np.concatenate([poster[..., :3], band])).quantize(255)
    pictures = (Image.fromarray(pixels[..., :3]).quantize(palette=palette, dither=Image.Dither.NONE) for pixels in frames)
    next(pictures).save(path, "GIF", save_all=True, append_images=pictures, duration=1000 / fps, loop=0, optimize=False)


def _write_webp(frames: Iterator[Pixels], poster: Pixels, path: Path, fps: int) -> None:
    pictures = (Image.fromarray(pixels[..., :3]) for pixels in frames)
    next(pictures).save(path, "WEBP", save_all=True, append_images=pictures, duration=round(1000 / fps), loop=0, quality=80, method=2)
