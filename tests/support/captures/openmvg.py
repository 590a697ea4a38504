"""A small capture as OpenMVG writes its scene."""

import json

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, write_images

BASE = {
    "width": WIDTH, "height": HEIGHT, "focal_length": FOCAL[0],
    "principal_point": [CENTER[0] - 0.5, CENTER[1] - 0.5],
}  # fmt: skip


def wrapped(key, data, identifier=1073741824, **settings):
    """An entry as the library cereal writes pointers to classes."""
    wrapper = {"id": 2147483649 + key, "data": data}
    return {
        "key": key,
        "value": {"polymorphic_id": identifier, **settings, "ptr_wrapper": wrapper},
    }


def scene(data=BASE, kind="pinhole", **parts):
    capture = ring()
    views = [
        {"local_path": "", "filename": name, "width": WIDTH, "height": HEIGHT, "id_view": number,
         "id_intrinsic": 0, "id_pose": number}
        for number, name in enumerate(capture.names)
    ]  # fmt: skip
    poses = [
        {"rotation": pose[:3, :3].tolist(), "center": (-pose[:3, :3].T @ pose[:3, 3]).tolist()}
        for pose in capture.poses
    ]
    return {
        "sfm_data_version": "0.3",
        "root_path": "C:\\photos\\images",
        "views": [wrapped(number, view) for number, view in enumerate(views)],
        "intrinsics": [wrapped(0, data, 2147483649, polymorphic_name=kind)],
        "extrinsics": [{"key": number, "value": pose} for number, pose in enumerate(poses)],
        "structure": [
            {"key": number, "value": {"X": point.tolist(), "observations": []}}
            for number, point in enumerate(capture.points)
        ],
        "control_points": [],
    } | parts


def write(folder, content=None, images="images"):
    write_images(folder / images, ring())
    (folder / "sfm_data.json").write_text(json.dumps(content or scene()))
    return folder
