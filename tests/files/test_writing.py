"""Files and folders are written whole; what is no file stays what it is."""

import os

import pytest

from mrp_sumo.files.writing import new_folder, write_text, write_whole


def test_a_pipe_or_device_is_written_to_and_never_replaced(tmp_path):
    """Whoever runs as root would take /dev/null from everybody else."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)
    write_text(pipe, "plan")
    write_whole(tmp_path / "file", b"plan")
    assert os.read(reader, 9) == b"plan" and pipe.is_fifo()
    with pytest.raises(NotADirectoryError), new_folder(pipe) as new:
        (new / "page").write_text("never")
    with new_folder(tmp_path / "folder") as new:
        (new / "page").write_text("report")
    os.close(reader)
    assert pipe.is_fifo() and sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "pipe"]
