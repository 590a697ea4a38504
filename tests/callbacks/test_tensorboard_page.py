"""TensorBoard itself, in a browser, on the events of a run."""

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("websockets", reason="the driver of Chromium needs websockets")

from support.chromium import chromium, needs_chromium

ADDRESS = re.compile(r"(http://127\.0\.0\.1:\d+)/")

DEEP_TEXT = """(function all(node) {
  let text = node.nodeType === 3 ? node.textContent : "";
  for (const root of [node, node.shadowRoot]) {
    for (const child of root?.childNodes ?? []) text += all(child);
  }
  return text;
})(document.body)"""
"""JavaScript: the text of a page, in shadow trees too, which Custom Scalars is made of."""


@pytest.fixture
def address(finished_run: Path) -> Iterator[str]:
    """Address at which TensorBoard serves the events of a small run."""
    command = [sys.executable, "-m", "tensorboard.main", "--logdir", str(finished_run)]
    process = subprocess.Popen(
        [*command, "--host", "127.0.0.1", "--port", "0"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    assert process.stderr is not None
    try:
        found = next(filter(None, map(ADDRESS.search, process.stderr)))
        # A pipe that nobody empties would stop the server.
        drain = threading.Thread(target=process.stderr.read)
        drain.start()
        yield found[1]
    finally:
        process.terminate()
        process.wait()
        drain.join()
        process.stderr.close()


@needs_chromium
@pytest.mark.slow
def test_the_first_screen_says_whether_it_works(address, tmp_path):
    with chromium(tmp_path / "chromium") as browser:
        page = browser.open(address, size=(1400, 1100))
        page.wait_for("document.body.innerText.includes('1_overview')")
        page.wait_for("document.body.innerText.includes('psnr_held_out')")
        words = page.text()
        groups = re.findall(r"^(\d_[a-z_]+)\d* cards?$", words, re.MULTILINE)
        assert groups[:2] == ["1_overview", "2_quality"]
        assert groups == sorted(groups)
        cards = re.findall(r"^/(\w+)$", words, re.MULTILINE)
        assert cards[:4] == ["loss", "psnr_held_out", "psnr_of_one_color", "psnr_training"]
        assert np.ptp(page.screenshot(tmp_path / "first.png")) == 255

        page.open(f"{address}/#custom_scalars")
        page.wait_for(f"{DEEP_TEXT}.includes('PSNR in dB: training image, held-out')")
        assert "Quality" in page.evaluate(DEEP_TEXT)
        assert not page.errors()
