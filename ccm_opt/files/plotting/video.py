"""The film ``motion.mp4``, encoded by ffmpeg where that program is found."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from ccm_opt.errors import ProblemError
from ccm_opt.files.plotting.animation import Film, video_settings
from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings

_QUALITY = ("-c:v", "libx264", "-crf", "20", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart")


def encoder() -> str | None:
    """Where ffmpeg is; None where it is not."""
    return shutil.which("ffmpeg")


def motion_mp4(plan: DrawnPlan, settings: FilmSettings = FILM) -> bytes:
    """The motion of a plan as a video, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: size and number of the frames.

    Returns:
        The content of an MP4 file.

    Raises:
        ProblemError: there is no ffmpeg, or it cannot encode.
    """
    program = encoder()
    if program is None:
        raise ProblemError("a video needs the program ffmpeg, which is not found; install it, or leave out 'mp4'")
    rate = settings.video_frames_a_second
    film = Film.of_plan(plan, video_settings(settings), rate, settings.most_video_frames)
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
