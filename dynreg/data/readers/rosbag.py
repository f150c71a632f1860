"""ROS 1 bags, rosbag2 .db3 files and rosbag2 folders (read with the rosbags library)."""

from collections import Counter
from pathlib import Path
from typing import Any

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.bag_folder import bag_information, stated_counts
from dynreg.data.readers.merge import join
from dynreg.data.readers.messages import Topic, gather
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError


def read(path: Path, options: ReadOptions) -> RawLog:
    """Read a .bag, a .db3 or a rosbag2 folder.

    Raises LogError for a bag without its index (a recording that was cut off) and for damaged ones.
    """
    if path.is_dir():
        info = bag_information(path)
        if info.get("storage_identifier") == "mcap":
            return _read_mcap_folder(path, info, options)
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: dict[str, Topic] = {}
    failed: Counter[str] = Counter()
    try:
        # Older rosbag2 files carry no definitions; the standard types of Humble decode them.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            count, names = reader.message_count, sorted(reader.topics)
            wanted = [c for c in reader.connections if options.wants(c.topic)]
            for connection, stamp, data in reader.messages(wanted) if wanted else ():
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception:  # the message's bytes and its definition come from the file
                    failed[connection.topic] += 1
                    continue
                topics.setdefault(connection.topic, Topic(connection.topic)).add(message, stamp)
    except Exception as error:  # rosbags, apsw, bz2 and lz4 each have their own errors for a damaged file
        raise LogError(
            f"{path.name!r} cannot be read: {error}",
            expected="a whole bag with its index",
            do="mend it with `rosbag reindex` or `ros2 bag reindex`, or record it again",
        ) from error
    findings = [
        Finding("warning", "decode", f"{path.name}, {topic}", f"{n} messages cannot be decoded")
        for topic, n in failed.items()
    ]
    sources, metadata, found = gather(topics, options.time != "log")
    metadata.update(messages_read=count, messages_lost=0, topics=names)
    return RawLog(path, sources, metadata, findings=(*findings, *found))


def _read_mcap_folder(path: Path, info: dict[str, Any], options: ReadOptions) -> RawLog:
    from dynreg.data.readers.mcap_log import read as read_mcap

    counts = stated_counts(info)
    logs = []
    for name in info["relative_file_paths"]:
        file = path / Path(name).name
        if not file.exists():
            raise LogError(
                f"{path.name!r} lacks its file {file.name!r}", expected="all its files", do="copy it again"
            )
        logs.append(read_mcap(LogFile(file), options, counts.get(file.name)))
    return join(path, logs)
