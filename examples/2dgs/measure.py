"""The table of the README: normals and depth in the room of the example rgbd.

pip install ../rgbd; python measure.py [steps]
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from gsfw_rgbd.room import write_room

RUNS = {
    "images alone": ("normal_weight=0", "distortion_weight=0"),
    "normals": ("distortion_weight=0",),
    "normals and distortion": (),
}


def main(steps):
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder) / "room"
        write_room(room, frames=16, width=96, noise=0.0)
        for number, (name, settings) in enumerate(RUNS.items()):
            command = (
                *(sys.executable, "-m", "gsfw", "train", "method=2dgs", f"data={room}"),
                *(f"steps={steps}", "device=cpu", "json=true", "report=false", "eval_every=0"),
                *("datamanager.held_out_every=4", f"out={folder}/{number}", *settings),
            )
            found = subprocess.run(command, check=False, capture_output=True, text=True)
            if found.returncode:
                sys.exit(found.stderr)
            figures = json.loads(found.stdout)
            keys = ("psnr", "normal_error", "normal_spread", "depth_error")
            print(f"| {name} |", " | ".join(f"{figures[key]:.3f}" for key in keys), "|", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 600)
