"""ROS 2 bags to ROS 1."""

from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from rosbags.convert import ConverterError, convert
from rosbags.typesys import Stores, get_typestore

from mrp_sumo.errors import MrpSumoError


def convert_to_ros1(bag: Path, out: Path, without: Sequence[str]) -> None:
    """Convert a ROS 2 bag to a ROS 1 bag, uncompressed, which every reader takes.

    Raises MrpSumoError when the bag cannot be converted, and OSError when the disk refuses.
    """
    try:
        with redirect_stdout(StringIO()):  # it reports every type that it copies or migrates
            convert(
                srcs=[bag],
                dst=out,
                dst_storage="",
                dst_version=8,
                compress=None,
                compress_mode="file",
                default_typestore=get_typestore(Stores.ROS2_HUMBLE),
                typestore=get_typestore(Stores.ROS1_NOETIC),
                exclude_topics=without,
                include_topics=(),
                exclude_msgtypes=(),
                include_msgtypes=(),
            )
    except ConverterError as error:
        if isinstance(error.__cause__, OSError):
            raise error.__cause__ from None
        raise MrpSumoError(f"{bag}: cannot be converted to ROS 1: {error}") from None
