"""Export of what a log leaves open: the posterior of a query or a diagnosis, as ranges for training."""

from pathlib import Path

from dynreg.errors import NoMatchError, UsageError, command
from dynreg.extend.ranges import Open, Quantity, text
from dynreg.registry import Registry, ResultRecord
from dynreg.results.diagnosis import Diagnosis
from dynreg.results.ranges import CarriedBy, FreeQuantity, RangesFile
from dynreg.verbs.newest import newest_for
from dynreg.verbs.ranges_document import Answer, opened
from dynreg.verbs.show import stored_result
from dynreg.verbs.simulator import WORDS
from dynreg.verbs.simulators import stored
from dynreg.verbs.written import require_new, write_new

KINDS = ("neighbours", "diagnosis")


def export_ranges(registry: Registry, ref: str, path: Path) -> RangesFile:
    """Write the posterior of a query's or a diagnosis's free parameters and effects to a new TOML file.

    ref : the result, a recording (its newest such result), or a word such as `@answer` or `diagnosed`.
    Raises NoMatchError where there is no such result or it made no simulator, UsageError for a result of another kind
    and where the file exists or cannot be written.
    """
    require_new(path)
    record = _record(registry, ref)
    answer = stored_result(registry, record.id)
    if _simulator_of(answer) is None:
        raise NoMatchError(
            f"result {record.id[:12]} made no simulator",
            expected="a query that synthesises one, or a diagnosis",
            do="ask again, without --no-synthesise",
        )
    found = stored(registry, "simulator", _simulator_of(answer))
    left = opened(record.id, answer, found)
    write_new(path, text(left).encode())
    return _told(left, path)


def _record(registry: Registry, ref: str) -> ResultRecord:
    """The result of a query or a diagnosis that `ref` means."""
    if ref in WORDS and WORDS[ref].kind in KINDS:
        return registry.latest(WORDS[ref].kind)
    kind, identity = registry.resolve(ref, ("result", "recording"))
    if kind == "result":
        record = registry.result(identity)
        if record.kind not in KINDS:
            raise UsageError(
                f"result {ref!r} is of kind {record.kind!r}",
                expected="a query or a diagnosis: these say what a log leaves open",
                do="see `dynreg list --kind result`",
            )
        return record
    info = registry.recording_info(identity)
    robot = registry.robots()[info.robot_as(ref)]
    newest = [one for kind in KINDS if (one := newest_for(registry, kind, identity, robot))]
    if not newest:
        raise NoMatchError(
            f"no query or diagnosis of recording {ref!r} is stored",
            expected="one that says what the log leaves open",
            do=f"run `{command('query', ref)}` or `{command('diagnose', ref)}` first",
        )
    order = registry.results_about(None, identity)
    return min(newest, key=lambda one: order.index(one.id))


def _simulator_of(answer: Answer) -> str | None:
    if isinstance(answer, Diagnosis):
        return answer.extended_simulator or answer.calibrated_simulator
    return answer.synthesised and answer.synthesised.simulator


def _told(left: Open, path: Path) -> RangesFile:
    """What was written."""
    about = left.about
    return RangesFile(
        robot=about["robot"],
        recording_name=about["recording"],
        result=about["result"],
        kind=about["kind"],
        simulator=about["simulator"],
        file=str(path),
        correlated=about["correlated"],
        reliable=about["reliable"],
        warning=about["warning"] or "",
        complete_in_model=about["complete_in_model"],
        incomplete=about.get("incomplete", ""),
        free=tuple(
            FreeQuantity(low=q.interval[0], high=q.interval[1], **_named(q, FreeQuantity)) for q in left.free
        ),
        fixed=tuple(one.name for one in left.fixed),
        effects=tuple(CarriedBy(effect=e.key, carried_by=e.carried_by, why=e.why) for e in left.effects),
        left_out={q.name: q.left_out for q in left.free if q.left_out},
        notes=about["notes"],
    )


def _named(q: Quantity, kind: type[FreeQuantity]) -> dict[str, object]:
    return {name: value for name, value in vars(q).items() if name in kind.model_fields}
