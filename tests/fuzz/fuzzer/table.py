"""The table of targets: every reader of what strangers wrote."""

from fuzzer.formats import bags, documents, mcap, npz, others, registries, robots, tables
from fuzzer.target import Target

_ALL = (
    *mcap.TARGETS,
    *bags.TARGETS,
    *tables.TARGETS,
    *npz.TARGETS,
    *others.TARGETS,
    *robots.TARGETS,
    *registries.TARGETS,
    *documents.TARGETS,
)
TARGETS: dict[str, Target] = {target.name: target for target in _ALL}
