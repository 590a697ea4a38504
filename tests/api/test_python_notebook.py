"""A notebook that trains, renders and interrupts, executed by a real kernel."""

import os
import sys
import warnings

import pytest
from support.small_scene import SMALL_SCENE

SMALL = {"report": False, **dict(pair.split("=") for pair in SMALL_SCENE)}

CELLS = (
    "import warnings, signal, os\nwarnings.simplefilter('error')\n"
    "from gsfw.api import Callback, load, train",
    f"run = train(method='3dgs', steps=40, out='first', settings={SMALL})\nrun",
    "run.render(run.cameras())",
    "load('first')",
    "class Interrupt(Callback):\n"
    "    def on_tick(self, step, control):\n"
    "        if step == 7: os.kill(os.getpid(), signal.SIGINT)\n"
    f"stopped = train(method='3dgs', steps=40, out='second', settings={SMALL},\n"
    "    callbacks=[Interrupt()])\n"
    "print(stopped.steps, stopped.is_finished, stopped.resume(progress=False).steps)",
)


@pytest.mark.slow
def test_a_notebook_shows_progress_figures_and_images(tmp_path):
    nbclient = pytest.importorskip("nbclient", reason="nbclient runs notebooks, and is not here")
    pytest.importorskip("ipykernel", reason="the kernel of notebooks is not here")
    nbformat = pytest.importorskip("nbformat")
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    client = nbclient.NotebookClient(
        book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.create_kernel_manager().kernel_spec.argv[0] = sys.executable
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Of the event loop and the sockets of the client.
        client.execute(env={**os.environ, "OMP_NUM_THREADS": "1"})
    _, trained, rendered, loaded, interrupted = [cell.outputs for cell in book.cells]
    html = [output["data"]["text/html"] for output in trained if "data" in output]
    assert html[-2] == "<span></span>", "the line of progress is empty at the end"
    assert "3dgs on synthetic, 40 of 40 steps" in html[-1]
    assert html[-1].count("<img") == 4
    printed = "".join(output["text"] for output in trained if output.get("name") == "stdout")
    assert "preparing method 3dgs on the built-in scene" in printed
    assert "done: 3dgs on synthetic, 40 steps" in printed
    assert not [output for output in trained if output.get("name") == "stderr"]
    assert "2 images of 32 x 24 pixels" in rendered[0]["data"]["text/html"]
    assert "Gaussians of method 3dgs" in loaded[0]["data"]["text/html"]
    printed = "".join(output["text"] for output in interrupted if output.get("name") == "stdout")
    assert printed.endswith("7 False 40\n"), "the unfinished run is returned, and resumed"
