"""What metadata.yaml of a rosbag2 folder says of its files."""

from pathlib import Path
from typing import Any

from dynreg.data.readers.budget import Budget
from dynreg.errors import LogError


def bag_information(folder: Path) -> dict[str, Any]:
    """The `rosbag2_bagfile_information` of a folder's metadata.yaml; LogError where it is not one."""
    from ruamel.yaml import YAML

    file = folder / "metadata.yaml"
    Budget(folder.name).check("settings_bytes", file.stat().st_size)
    try:
        document = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
        info = document["rosbag2_bagfile_information"]
        names = info["relative_file_paths"]
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            raise ValueError("no files are listed")
        return info
    except Exception as error:  # any malformed YAML
        raise LogError(
            f"{folder.name}/metadata.yaml is not that of a rosbag2 folder: {error}",
            expected="rosbag2_bagfile_information with relative_file_paths",
            do="mend it with `ros2 bag reindex`, or pass the .mcap or .db3 file itself",
        ) from error


def stated_counts(info: dict[str, Any]) -> dict[str, int]:
    """Messages in each file of a rosbag2 folder, as far as its metadata tells."""
    counts = {Path(f["path"]).name: int(f["message_count"]) for f in info.get("files") or []}
    names = info["relative_file_paths"]
    if not counts and len(names) == 1 and "message_count" in info:
        counts[Path(names[0]).name] = int(info["message_count"])
    return counts
