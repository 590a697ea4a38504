"""Files of runs that nobody trained, and what ``gsfw runs`` says of them."""

import json
import zipfile
from pathlib import Path

from gsfw.commands.main import main
from gsfw.core.files.folder_lock import LOCK
from gsfw.core.loop.run_folder import RunFolder

CONFIG = """\
schema: 1
gsfw: 0.1.0
given: [method, steps, {key}]
method: {method}
datamanager: colmap
data: /data/{scene}
steps: 100
{key}: {value}
optim.means_lr_steps: {value}
"""


def make_run(path, scene="fox", method="3dgs", done=100, psnr=30.0, key="seed", value=1) -> Path:
    """The files of a run: a finished one if all 100 steps are done."""
    folder = RunFolder(Path("runs") / path)
    folder.checkpoints.mkdir(parents=True)
    (folder.path / LOCK).touch()
    folder.config.write_text(CONFIG.format(method=method, scene=scene, key=key, value=value))
    with zipfile.ZipFile(folder.checkpoint(done), "w") as file:
        file.writestr("data", b"0" * 1000)
    lines = [{"step": step, "num_gaussians": 500 + step, "step_ms": 10.0}
             for step in range(10, done + 1, 10)]  # fmt: skip
    folder.metrics_log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    folder.evaluations.mkdir()
    (folder.evaluations / f"step_{done:09d}.json").write_text(json.dumps({"psnr": psnr}))
    (folder.evaluations / f"step_{done:09d}_train.json").write_text(json.dumps({"psnr": 99.0}))
    if done == 100:
        summary = {
            "completed": True, "scene": scene, "method": method, "psnr": psnr, "ssim": 0.9,
            "num_gaussians": 1234, "train_seconds": 65.0, "steps": 100, "model_bytes": 290_000,
            "protocol": {"views": 7},
        }  # fmt: skip
        folder.summary.write_text(json.dumps(summary))
    return folder.path


def listed(capsys, *arguments: str) -> list[dict]:
    assert main(["runs", *arguments, "json=true"]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *arguments: str) -> str:
    assert main(["runs", *arguments]) in (1, 2)
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return said
