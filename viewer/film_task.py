"""Film task: a camera path rendered to a film, frame by frame, between what pages want."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import torch

from gsfw.core.datamanager import spread
from gsfw.rendering.film import VideoFormat, choose_format, write_film
from gsfw.rendering.image_files import write_image
from gsfw.rendering.pictures import SAMPLES
from gsfw.viewer.frame import has_values, value_scale
from gsfw.viewer.key_frames import PathStates
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import ViewState


@dataclass(frozen=True)
class FilmOrder:
    """A film that a page orders."""

    states: PathStates
    state: ViewState
    """Everything but pose and time: channel, size of the page, crop."""
    stem: Path
    """Path of the film, without its extension."""
    progress: Callable[[int], None]
    """Receives the number of rendered frames."""
    done: Callable[[str], None]
    """Receives the file, or why there is none."""


def film_task(order: FilmOrder, session: Session) -> Generator[None, None, None]:
    """Render the frames, one at each step; then encode them in a thread of its own."""
    folder = Path(tempfile.mkdtemp(prefix="gsfw-film-"))
    encoding = False
    try:
        maker, files, scale = session.service.maker, [], None
        if has_values(order.state):
            samples = []
            for number in spread(range(len(order.states)), SAMPLES):
                samples.append(maker.values(order.states.at(number, order.state)))
                yield
            scale = value_scale(order.state, samples)
        for number in range(len(order.states)):
            frame = maker.make(order.states.at(number, order.state), values=scale)
            image = torch.from_numpy(frame.image).float() / 255
            files.append(write_image(folder / f"{number:05d}.png", image))
            order.progress(number + 1)
            yield
        encoding = True
        chosen = choose_format("auto")
        thread = threading.Thread(
            target=_encode, args=(order, folder, files, chosen), name="viewer-film"
        )
        thread.start()
    except GeneratorExit:
        order.done("There is no film: the viewer was closed before it was rendered.")
        raise
    except Exception as error:  # One film is no reason to end a run.
        order.done(f"There is no film: {error}")
    finally:
        if not encoding:
            shutil.rmtree(folder, ignore_errors=True)


def _encode(order: FilmOrder, folder: Path, files: list[Path], chosen: VideoFormat) -> None:
    try:
        (film,) = write_film(order.stem, files, order.states.fps, chosen)
        order.done(str(film))
    except Exception as error:
        order.done(f"There is no film: {error}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
