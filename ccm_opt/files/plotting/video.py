"""The film ``motion.mp4``, encoded by ffmpeg where that program is found."""

import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

from ccm_opt.errors import ProblemError
from ccm_opt.files.plotting.film import Film
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings

_QUALITY = ("-c:v", "libx264", "-crf", "20", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart")


def encoder() -> str | None:
    """Where ffmpeg is; None where it is not."""
    return shutil.which("ffmpeg")


def video_settings(settings: FilmSettings = FILM) -> FilmSettings:
    """The settings of a film with the size and the frames of a video."""
    return replace(
        settings,
        longest_side=settings.video_side,
        frames_a_second=settings.video_frames_a_second,
        most_frames=settings.most_video_frames,
    )


def film_mp4(film: Film) -> bytes:
    """A film as a video.

    Args:
        film: with the settings of `video_settings`.

    Returns:
        The content of an MP4 file.

    Raises:
        ProblemError: there is no ffmpeg, or it cannot encode.
    """
    program = encoder()
    if program is None:
        raise ProblemError("a video needs the program ffmpeg, which is not found; install it, or leave out 'mp4'")
    settings = film.settings
    rate = settings.frames_a_second
    frames = list(film.frames())
    still = frames[-1:] * round(rate * settings.last_frame / 1e3)
    width, height = frames[0].size
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "-")
    with tempfile.TemporaryDirectory() as folder:
        # The index of an MP4 stands at its beginning, so that it cannot be written into a pipe.
        out = Path(folder) / "motion.mp4"
        content = b"".join(frame.tobytes() for frame in (*frames, *still))
        command = [program, "-loglevel", "error", "-y", *raw, *_QUALITY, str(out)]
        done = subprocess.run(command, input=content, capture_output=True, check=False)  # noqa: S603 - no shell
        if done.returncode != 0:
            raise ProblemError(f"ffmpeg cannot encode the video: {done.stderr.decode(errors='replace').strip()}")
        return out.read_bytes()
