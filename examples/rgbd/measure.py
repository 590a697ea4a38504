"""The table of the README: few views of the room, with and without depth.

python measure.py [steps]
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from gsfw_rgbd.room import write_room

RUNS = {
    "random start, images alone": ("depth_weight=0", "datamanager.points=0"),
    "random start, depth loss": ("depth_weight=0.2", "datamanager.points=0"),
    "points of the depth maps, images alone": ("depth_weight=0",),
    "points of the depth maps, depth loss": ("depth_weight=0.2",),
}


def main(steps):
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder) / "room"
        write_room(room, frames=16, width=160, noise=0.01)
        for number, (name, settings) in enumerate(RUNS.items()):
            command = (
                *(sys.executable, "-m", "gsfw", "train", "method=3dgs-depth", f"data={room}"),
                *("datamanager.held_out_every=2", f"steps={steps}", "device=cpu", "json=true"),
                *("report=false", "eval_every=0", f"out={folder}/{number}", *settings),
            )
            found = subprocess.run(command, check=False, capture_output=True, text=True)
            if found.returncode:
                sys.exit(found.stderr)
            figures = json.loads(found.stdout)
            psnr, error = figures["psnr"], 100 * figures["depth_error"]
            print(f"| {name} | {psnr:.2f} | {error:.1f} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
