"""The examples of docs/plugins/slots: each is a plugin that works as it stands there."""

from types import ModuleType

import pytest
import torch
from support.page_plugins import PLUGINS, blocks, composed, module_of, registry_with, specs_of

from gsfw.api import Cameras, Control, Sh, SplatFile, Splats
from gsfw.core.callback import StepReport
from gsfw.core.loop.run_folder import RunFolder

pytestmark = pytest.mark.unchecked

PAGES = sorted((PLUGINS / "slots").glob("*.md"))


def example(slot: str) -> ModuleType:
    """The example of a page."""
    return module_of(blocks(PLUGINS / "slots" / f"{slot}.md")["Example"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_example_of_a_slot_registers_a_part_that_loads(page):
    assert [spec.load() for spec in specs_of(example(page.stem)).values()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slot", "settings"),
    [
        ("method", {"method": "spheres", "count": "50"}),
        ("strategy", {"strategy": "halve", "strategy.every": "2"}),
        ("sampler", {"sampler": "pairs"}),
        ("datamanager", {"datamanager": "plain"}),
        ("metric", {}),
    ],
)
def test_the_example_of_a_slot_trains(slot, settings, tmp_path):
    run = composed(registry_with(example(slot)), **settings)
    summary = run.trainer(RunFolder(tmp_path / "run")).fit()
    assert summary["steps"] == 6
    assert slot != "strategy" or summary["num_gaussians"] > 120
    assert slot != "metric" or 0 <= summary["within-5"] <= 1


def test_the_callback_of_the_page_stops_at_its_psnr():
    callback, control = example("callback").Enough(20.0), Control()
    for step in range(100):
        callback.on_step(StepReport(step, 0.1, {}, 25.0, 10, {}, 1.0), control)
    assert control.stop_reason == "training images have 20.4 dB"


def test_the_file_format_of_the_page_reads_what_it_wrote(tmp_path):
    module, path = example("exporter-importer"), tmp_path / "splats.json"
    means, quats = torch.rand(3, 3).double(), torch.tensor([[1.0, 0, 0, 0]] * 3).double()
    colors = Sh(torch.rand(3, 1, 3).double(), degree=0)
    given = Splats(means, torch.rand(3).double(), colors, quats, torch.rand(3, 3).double())
    module.JsonExporter().write(path, SplatFile(given))
    assert module.JsonImporter.recognises(path)
    found = module.JsonImporter().read(path).splats
    torch.testing.assert_close(found.means, given.means)
    torch.testing.assert_close(found.opacities, given.opacities)


def test_the_rasterizer_of_the_page_draws_a_pixel_for_a_centre():
    matrix = torch.tensor([[[20.0, 0, 8.5], [0, 20, 8.5], [0, 0, 1]]])
    means, scales = torch.tensor([[0.0, 0, 2]]), torch.full((1, 3), 0.1)
    quats, red = torch.tensor([[1.0, 0, 0, 0]]), torch.tensor([[1.0, 0, 0]])
    splats = Splats(means, torch.tensor([0.5]), red, quats, scales)
    image = example("rasterizer").Dots().render(splats, Cameras(torch.eye(4)[None], matrix, 17, 17))
    assert image.color[0, 8, 8].tolist() == [1, 0, 0]
    assert image.alpha.sum() == 1
