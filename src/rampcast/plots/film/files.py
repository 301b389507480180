"""Films as files: mp4 by ffmpeg, gif and webp by pillow, and single pictures."""

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from rampcast.errors import MissingExtra, RampcastError
from rampcast.files import write_whole

Picture = UInt8[np.ndarray, "height width 3"]
COLOURS: Final = 96  # of a gif: as many as the palette of a film needs
SAMPLED: Final = 6  # pictures from which these are taken
QUALITY: Final = 70  # of webp, from 0 to 100
RATE_FACTOR: Final = "20"  # of x264: 18 is nearly without loss, 23 the default


def ffmpeg_program() -> str:
    """Returns the path of ffmpeg.

    Raises:
        MissingExtra: there is none.
    """
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError as error:
        raise MissingExtra(
            'an mp4 needs ffmpeg; run: pip install "rampcast[video]" (or apt install ffmpeg), or write a .gif or .webp'
        ) from error
    return str(get_ffmpeg_exe())


def check_film(path: Path) -> None:
    """Checks that a film can be written there, before long work is done for it.

    Raises:
        RampcastError: its suffix is none that is known.
        MissingExtra: what it takes is not installed.
    """
    if path.suffix.lower() not in WRITERS:
        raise RampcastError(f"{path}: expected a name that ends in {', '.join(WRITERS)}")
    if path.suffix.lower() == ".mp4":
        ffmpeg_program()


def write_film(pictures: Iterable[Picture], path: Path, *, rate: float) -> int:
    """Writes a film, whole or not at all, and returns the number of its pictures; a .png is the first alone.

    Args:
        pictures: all of one size.
        path: .mp4, .gif, .webp or .png.
        rate: pictures a second.

    Raises:
        RampcastError, MissingExtra: as `check_film`, or there is no picture, or ffmpeg fails.
    """
    path = Path(path)
    check_film(path)
    with write_whole(path) as partial:
        count = WRITERS[path.suffix.lower()](iter(pictures), partial, rate)
        if not count:
            raise RampcastError(f"{path}: there is no moment to draw")
    return count


def _write_png(pictures: Iterator[Picture], path: Path, _: float) -> int:
    for picture in pictures:
        Image.fromarray(picture).save(path, format="PNG", optimize=True)
        return 1
    return 0


def _write_gif(pictures: Iterator[Picture], path: Path, rate: float) -> int:
    frames = [Image.fromarray(picture) for picture in pictures]
    if not frames:
        return 0
    some = frames[:: max(1, len(frames) // SAMPLED)]
    together = Image.new("RGB", (some[0].width, sum(one.height for one in some)))
    for place, one in enumerate(some):
        together.paste(one, (0, place * one.height))
    palette = together.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    first, *others = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames)
    kind = {"save_all": True, "append_images": others, "duration": round(1e3 / rate), "loop": 0, "optimize": True}
    first.save(path, format="GIF", **kind)
    return len(frames)


def _write_webp(pictures: Iterator[Picture], path: Path, rate: float) -> int:
    frames = [Image.fromarray(picture) for picture in pictures]
    if not frames:
        return 0
    kind = {"save_all": True, "append_images": frames[1:], "duration": round(1e3 / rate), "loop": 0}
    frames[0].save(path, format="WEBP", quality=QUALITY, method=6, minimize_size=True, **kind)
    return len(frames)


def _write_mp4(pictures: Iterator[Picture], path: Path, rate: float) -> int:
    first = next(pictures, None)
    if first is None:
        return 0
    height, width = first.shape[:2]
    command = [ffmpeg_program(), "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    command += ["-r", f"{rate:g}", "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", RATE_FACTOR]
    command += ["-movflags", "+faststart", "-f", "mp4", str(path)]
    count = 0
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for picture in _with(first, pictures):
                process.stdin.write(np.ascontiguousarray(picture).tobytes())
                count += 1
            process.stdin.close()
        except BrokenPipeError:
            pass
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise RampcastError(f"{path.name}: ffmpeg failed: {said or process.returncode}")
    return count


def _with(first: Picture, others: Iterator[Picture]) -> Iterator[Picture]:
    yield first
    yield from others


WRITERS: Final[dict[str, Callable[[Iterator[Picture], Path, float], int]]] = {
    ".mp4": _write_mp4,
    ".gif": _write_gif,
    ".webp": _write_webp,
    ".png": _write_png,
}
