"""A plausible answer of drift for an arm: a load at the elbow, and a friction that stayed."""

from dynreg.results import Change, Changes, Cost, DiagnosisTrace, Interval, RolloutError


def changes(changed: bool = True) -> Changes:
    """What changed from monday to friday; nothing, where it is told so."""
    load = _change("payload[elbow]", "mass", "kg", (0.0, 0.31 if changed else 0.0), not changed)
    trace = DiagnosisTrace(
        episode="run_1",
        channel="elbow/position",
        unit="rad",
        time=[0.0, 0.1, 0.2],
        measured=[0.0, 0.1, 0.3],
        nominal=[0.0, 0.2, 0.5],
        extended=[0.0, 0.11, 0.31],
    )
    return Changes(
        robot="arm",
        recording="ab" * 32,
        recording_name="friday",
        earlier="cd" * 32,
        earlier_name="monday",
        chosen=False,
        verdict="changed" if changed else "still true",
        changes=(load, _change(None, "elbow_damping", "N*m*s/rad", (0.6, 0.61), True)),
        threshold_nats=8.1,
        began="12" * 32,
        answer="34" * 32,
        error=RolloutError(
            channel="elbow/position", unit="rad", nominal=0.04, calibrated=0.02, extended=0.01
        ),
        traces=(trace,),
        seed=0,
        cost=Cost(evaluations=0, rollouts=900, seconds=12.0),
    )


def _change(cause: str | None, name: str, unit: str, values: tuple[float, float], same: bool) -> Change:
    def around(value: float) -> Interval:
        return Interval(value=value, low=value - 0.02, high=value + 0.02, unit=unit)

    before, after = values
    return Change(
        cause=cause,
        parameter=name,
        unit=unit,
        values={"before": around(before), "after": around(after)},
        together=around(before),
        same=same,
        nats=-1.5 if same else 41.0,
        there=("after",) if cause and not same else (),
        absent=("before",) if cause and not same else (),
        difference=around(after - before),
    )
