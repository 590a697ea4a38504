"""A folder that comes from another machine stays in its place."""

import io
import tarfile

import pytest

from gsfw.jobs.packed_folder import unpack


def packed(*members: tarfile.TarInfo) -> list[bytes]:
    """The pieces of an archive that no machine of ours would send."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for member in members:
            archive.addfile(member, io.BytesIO(bytes(member.size)))
    return [buffer.getvalue()]


def file(name: str) -> tarfile.TarInfo:
    member = tarfile.TarInfo(name)
    member.size = 4
    return member


def link(name: str, target: str) -> tarfile.TarInfo:
    member = tarfile.TarInfo(name)
    member.type, member.linkname = tarfile.SYMTYPE, target
    return member


@pytest.mark.parametrize(
    "members",
    [
        (file("../../outside"),),
        (link("out", "../.."), file("out/outside")),
        (link("out", "/etc/passwd"),),
    ],
    ids=["a path", "a file behind a link", "a link"],
)
def test_what_leads_out_of_it_is_refused_and_the_folder_before_stays(tmp_path, members):
    folder = tmp_path / "runs" / "first"
    folder.mkdir(parents=True)
    (folder / "kept").touch()
    with pytest.raises(tarfile.FilterError):
        unpack(packed(*members), folder)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["first", "kept", "runs"]


def test_other_archives_are_unpacked(tmp_path):
    unpack(packed(file("a"), file("b/c")), tmp_path / "folder")
    assert (tmp_path / "folder" / "b" / "c").read_bytes() == bytes(4)
