"""KSPLAT files as other writers make them: several sections, and level 2."""

import struct

import numpy as np

from gsfw.formats.ksplat.layout import MAIN_BYTES, RANGE, Section, record_type


def sections(level, parts):
    """A file of several sections: degree, lengths of full and partial buckets, and records."""
    total = sum(len(records) for *_, records in parts)
    main = struct.pack(
        "<BB2xIIIIH2x3fff", 0, 1, len(parts), len(parts), total, total, level, 0, 0, 0, 1.0, 2.0
    )
    headers, data = [], []
    for degree, size, full, partial, centers, records in parts:
        section = Section(
            *(len(records), len(records), size, full + len(partial), 4.0, 12, 0),
            *(full, len(partial), degree),
        )
        headers.append(section.to_bytes(level))
        data += [np.array(partial, "<u4").tobytes(), np.array(centers, "<f4").tobytes()]
        data.append(records.tobytes())
    return main.ljust(MAIN_BYTES, b"\0") + b"".join([*headers, *data])


def records(level, degree, count):
    rows = np.zeros(count, record_type(level, degree))
    rows["position"] = RANGE
    rows["position"][:, 0] += np.arange(count, dtype=np.uint16) * 1000
    rows["scale"], rows["quat"][:, 0], rows["rgba"] = 0.5, 1, 128
    if degree:
        rows["sh"] = np.arange(rows["sh"].shape[1])
    return rows
