"""A small capture as Agisoft Metashape exports its cameras."""

import numpy as np

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, write_images

CALIBRATION = {
    "f": FOCAL[1], "cx": CENTER[0] - WIDTH / 2, "cy": CENTER[1] - HEIGHT / 2,
    "b1": FOCAL[0] - FOCAL[1],
}  # fmt: skip
DISTORTION = {"k1": -0.1, "k2": 0.05, "k3": -0.02, "k4": 0.01, "p1": 2e-3, "p2": -3e-3}
SCALE = 2.5
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SHIFT = np.array([3.0, -4.0, 5.0])
"""How the chunk of the fixture lies in the world."""
PLACED = (
    f"<transform><rotation>{' '.join(map(str, TURN.flatten()))}</rotation>"
    f"<translation>{' '.join(map(str, SHIFT))}</translation><scale>{SCALE}</scale></transform>"
)


def in_chunk(pose):
    """The 4x4 transform from a camera to the chunk."""
    to_world = np.linalg.inv(pose)
    placed = np.eye(4)
    placed[:3, :3] = TURN.T @ to_world[:3, :3]
    placed[:3, 3] = TURN.T @ (to_world[:3, 3] - SHIFT) / SCALE
    return " ".join(repr(float(value)) for value in placed.flatten())


def sensor(values, kind="frame", number=0):
    terms = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
    size = f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
    return (
        f'<sensor id="{number}" label="unknown" type="{kind}">{size}'
        f'<calibration type="{kind}" class="initial">{size}<f>1</f></calibration>'
        f'<calibration type="{kind}" class="adjusted">{size}{terms}</calibration></sensor>'
    )


def write(folder, capture=None, values=None, kind="frame", **parts):
    """Cameras with labels without extension, and their images in images/."""
    capture = capture or ring()
    cameras = "".join(
        f'<camera id="{number}" sensor_id="0" component_id="0" '
        f'label="{name.removesuffix(".png")}"><transform>{in_chunk(pose)}</transform></camera>'
        for number, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True))
    )
    parts = {
        "sensors": sensor(CALIBRATION if values is None else values, kind),
        "components": f'<component id="0">{PLACED}</component>',
        "cameras": cameras,
        "rest": f'{PLACED}<reference>LOCAL_CS["Local Coordinates (m)"]</reference>',
    } | parts
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1">'
        f"<sensors>{parts['sensors']}</sensors><components>{parts['components']}</components>"
        f"<cameras>{parts['cameras']}</cameras>{parts['rest']}</chunk></document>"
    )
    write_images(folder / "images", capture)
    return folder
