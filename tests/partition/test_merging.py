import numpy as np
import torch
from support.street import write_street

from gsfw.commands.main import main
from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Sh, Splats
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.partition.document import read_partition
from gsfw.partition.merging import own_rows

FAR = (5e6, 4.2e6, 120.0)


def some_splats(means: torch.Tensor) -> SplatFile:
    count = len(means)
    return SplatFile(
        Splats(
            means=means,
            quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).double().repeat(count, 1),
            scales=torch.full((count, 3), 0.1).double(),
            opacities=torch.full((count,), 0.5).double(),
            colors=Sh(torch.zeros(count, 1, 3), 0),
        )
    )


def test_cells_keep_each_gaussian_once_and_positions_as_they_are(tmp_path):
    write_street(tmp_path / "street", origin=FAR)
    out = tmp_path / "cut"
    assert main(["partition", str(tmp_path / "street"), f"out={out}", "blocks=3"]) == 0
    partition = read_partition(out)
    generator = torch.Generator().manual_seed(0)
    means = torch.tensor(FAR).double() + 50 * torch.randn(1000, 3, generator=generator).double()
    content = some_splats(means)
    kept = [own_rows(content, partition, block).splats.means for block in partition.blocks]
    assert sum(map(len, kept)) == 1000
    merged = torch.cat(kept)
    order = [np.lexsort(part.numpy().T) for part in (merged, means)]
    assert torch.equal(merged[order[0]], means[order[1]])


def test_a_ply_with_double_positions_keeps_millions_of_metres_exactly(tmp_path):
    means = torch.tensor(FAR).double() + torch.rand(100, 3).double()
    content = some_splats(means)
    PlyExporter(positions="double").write(tmp_path / "a.ply", content)
    PlyExporter(positions="double", order="brush").write(tmp_path / "b.ply", content)
    for name in ("a.ply", "b.ply"):
        found = PlyImporter().read(tmp_path / name).splats
        assert torch.equal(found.means, means)
        assert torch.allclose(found.opacities.double(), content.splats.opacities)
    PlyExporter().write(tmp_path / "c.ply", content)
    assert (PlyImporter().read(tmp_path / "c.ply").splats.means - means).abs().max() > 0.01
