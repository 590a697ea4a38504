"""The blocks of docs/guides/python.md run, one after another, in one process."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "guides" / "python.md"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_blocks_of_the_guide_run_in_their_order(tmp_path, monkeypatch, capsys):
    import runpy

    import gsfw

    own = runpy.run_path(str(ROOT / "package" / "gsfw" / "__init__.py"))
    monkeypatch.setattr(gsfw, "__getattr__", own["__getattr__"], raising=False)
    monkeypatch.chdir(tmp_path)
    # The latest run is the one that the page has trained.
    monkeypatch.setenv("GSFW_STATE_DIR", str(tmp_path / "state"))
    blocks = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    for number, block in enumerate(blocks, start=1):
        exec(compile(block, f"block {number} of {PAGE.name}", "exec"), names)
    printed = capsys.readouterr().out
    assert re.search(r"^[\d.]+ 4000$", printed, re.MULTILINE), "as many Gaussians as points"
    assert "Did you mean 'strategy.max_gaussians'?" in printed
    assert "torch.Size([4, 54, 96, 3])" in printed
    assert float(re.findall(r"([\d.]+) dB", printed)[-1]) > 25
