"""Plausible diagnoses, trials and experiments, for the tests of the command line and the report."""

import math

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.results import (
    Cause,
    Cost,
    Diagnosis,
    DiagnosisTrace,
    EffectEstimate,
    EffectRow,
    EffectSize,
    EffectsList,
    ExpectedEvidence,
    Experiment,
    Gain,
    LegCommands,
    LegProtocol,
    LimitKept,
    Moved,
    Noise,
    Pulled,
    Ranked,
    ResidualShare,
    Rest,
    RolloutError,
    Threshold,
    TrialResult,
    TrialTable,
    Where,
    diagnosis_sentence,
)

THRESHOLD = 18.4
SCORES = {
    "load_friction": 412.0,
    "stribeck_load_friction": 401.5,
    "coulomb_friction": 233.1,
    "stribeck_friction": 219.0,
    "asymmetric_friction": 96.2,
    "viscous_friction": 41.0,
    "inertia": 15.2,
    "command_delay": 3.1,
    "backlash": -1.9,
    "payload": -2.4,
}
# name: nominal, value, half of the interval, unit, pull, limits
PARAMETERS = {
    "tip_mass": (0.49, 0.497, 0.006, "kg", 0.7, (0.4, 0.6)),
    "torque_constant": (0.35, 0.341, 0.02, "N*m/A", -0.3, (0.2, 0.6)),
    "resistance": (4.5, 4.9, 0.4, "ohm", 0.9, (2.5, 8.0)),
    "viscous_friction": (0.006, 0.018, 0.001, "N*m*s/rad", 2.6, (0.002, 0.018)),
    "zero_offset": (0.0, 0.004, 0.003, "rad", None, (-0.08, 0.08)),
}
REGIMES = {
    "overall": 1.0,
    "reversals": 0.61,
    "low_speed": 0.38,
    "high_speed": 0.09,
    "high_load": 0.33,
    "saturation": 0.12,
    "drive_off": 0.02,
    "early": 0.24,
    "late": 0.41,
}
CHANNELS = (("arm/position", "rad", 0.72), ("arm/velocity", "rad/s", 0.28))


def diagnosis(verdict: str = "named", *, held_out: bool = True, traced: bool = True) -> Diagnosis:
    """A diagnosis of the servo bench; "partly_explained" has a second cause and no repeated runs."""
    causes = _causes(verdict, held_out)
    error = _error("arm/position", "rad", 1.0, bool(causes), held_out, verdict != "partly_explained")
    noise = _noise(verdict)
    residual = (
        ResidualShare(joint="arm", signal="position", share=0.14),
        ResidualShare(joint="arm", signal="sign_of_velocity", share=0.05),
        ResidualShare(joint="arm", signal="time", share=0.0),
    )
    left = Rest(joint="arm", unit="rad/s^2", left=3.1, told=0.19, chance=0.01, samples=2800, trajectories=12)
    residual, left = (residual, (left,)) if verdict in ("unknown", "partly_explained") else (None, None)
    told = Diagnosis(
        robot="servo_pendulum",
        recording="b7" * 32,
        recording_name="bench_monday",
        simulator="0d" * 32,
        verdict=verdict,
        sentence="",
        causes=causes,
        ranking=_ranking(verdict),
        threshold_nats=THRESHOLD,
        threshold=Threshold(runs=20, cached=True),
        parameters={
            name: Pulled(
                nominal=nominal,
                value=value,
                low=value - half,
                high=value + half,
                unit=unit,
                pulled_sigma=pull,
                at_bound=value in limits,
                limits=limits,
            )
            for name, (nominal, value, half, unit, pull, limits) in PARAMETERS.items()
        },
        moved=(Moved(name="torque_constant", before=0.298, after=0.341, unit="N*m/A"),) if causes else (),
        error=error,
        errors=(error, _error("arm/velocity", "rad/s", 7.0, bool(causes), held_out, False)),
        where=_where(bool(causes)),
        finding="61 % of the error lies where the motion reverses, most of it on arm/position.",
        noise=noise,
        rest=left,
        residual=residual,
        experiments=_experiments(verdict),
        parts={
            "fit": ("kp100", "kp200", "kp800"),
            "select": ("kp100_again",),
            "test": ("kp400", "kp400_again") if held_out else (),
        },
        traces=tuple(
            _trace(e, c, i, bool(causes)) for i, e in enumerate(("kp400", "kp400_again")) for c in (0, 1)
        )
        if traced
        else (),
        inputs=(
            "the supply voltage was logged: 7.4 V, and falls by 3 % under load, in part by the motion itself",
        ),
        notes=("payload and inertia move together under these commands",),
        calibrated_simulator="ca" * 32,
        extended_simulator="ee" * 32 if causes else None,
        engine="joint",
        cost=Cost(evaluations=0, rollouts=41872, test_rollouts=3, seconds=12.9),
    )
    return told.model_copy(update={"sentence": diagnosis_sentence(told)})


def _causes(verdict: str, held_out: bool) -> tuple[Cause, ...]:
    if verdict in ("unknown", "none"):
        return ()
    first = Cause(
        effect="load_friction",
        joints=("arm",),
        title="dry friction that grows with the load on the gear",
        verdict=verdict,
        parameters={
            "coefficient": EffectEstimate(value=0.21, low=0.18, high=0.24, unit="1", sizes=(0.03, 0.08, 0.2))
        },
        evidence_nats=412.0,
        equivalent=("stribeck_load_friction[arm]",) if verdict == "ambiguous" else (),
        separate_by="slow reversals at two loads",
        gain=Gain(value=0.31, low=0.27, high=0.35) if held_out else None,
    )
    if verdict != "partly_explained":
        return (first,)
    extra = {
        "delay": EffectEstimate(
            value=0.4, low=0.31, high=0.4, unit="s", at_bound=True, sizes=(0.005, 0.01, 0.02)
        )
    }
    second = Cause(
        effect="command_delay",
        joints=(),
        title="commands arrive late",
        verdict="partly_explained",
        parameters=extra,
        evidence_nats=44.0,
        equivalent=("sensor_delay",),
        inseparable=("sensor_delay",),
        separate_by="a hardware loop-back: log when the drive itself sees the command",
        gain=Gain(value=0.02, low=-0.04, high=0.07) if held_out else None,
    )
    return (first, second)


def _ranking(verdict: str) -> tuple[Ranked, ...]:
    scale = 0.04 if verdict in ("unknown", "none") else 1.0
    ranked = [
        Ranked(effect=e, joints=("arm",), score_nats=scale * s, note="below its weak size" if s < -2 else "")
        for e, s in SCORES.items()
    ]
    if verdict == "partly_explained":
        ranked += [Ranked(effect="command_delay", score_nats=44.0, round=2)]
        ranked += [Ranked(effect="sensor_delay", score_nats=43.6, round=2)]
    return tuple(ranked)


def _noise(verdict: str) -> Noise:
    repeated = verdict != "partly_explained"
    left = {"unknown": 0.031, "partly_explained": 0.011}.get(verdict, 0.0046)
    floor = 0.0041 if repeated else 0.0005
    return Noise(
        channel="arm/position",
        unit="rad",
        left=left,
        floor=floor,
        basis="repeatability" if repeated else "stated_noise",
        ratio=left / floor,
        white=None if repeated else False,
    )


def _error(
    channel: str, unit: str, scale: float, extended: bool, held_out: bool, repeated: bool
) -> RolloutError:
    return RolloutError(
        channel=channel,
        unit=unit,
        nominal=0.0652 * scale,
        calibrated=0.0612 * scale,
        extended=0.0421 * scale if extended else None,
        repeatability=0.0041 * scale if repeated else None,
        part="test" if held_out else "select",
    )


def _where(extended: bool) -> tuple[Where, ...]:
    found = []
    for simulator, left in (("calibrated", 1.0), ("extended", 0.7))[: 1 + extended]:
        for channel, unit, part in CHANNELS:
            for i, (regime, share) in enumerate(REGIMES.items()):
                row = {"channel": channel, "regime": regime, "share": share * part, "simulator": simulator}
                ratio = None if regime == "overall" else 0.4 + 0.3 * i
                found.append(Where(**row, joint="arm", unit=unit, error=0.06 * left * share, ratio=ratio))
    return tuple(found)


def _experiments(verdict: str) -> tuple[str, ...]:
    if verdict == "ambiguous":
        return ("Slow reversals at two loads tell load_friction from stribeck_load_friction.",)
    if verdict == "partly_explained":
        return ("Repeat each run of commands, so that the robot's own scatter is known.",)
    return ()


def _trace(episode: str, channel: int, phase: int, extended: bool) -> DiagnosisTrace:
    name, unit, _ = CHANNELS[channel]
    time = [0.01 * i for i in range(500)]
    size = 1.0 if channel == 0 else 2.2

    def curve(gain: float, late: float) -> list[float | None]:
        at = [t - late for t in time]
        swing = [math.sin(2.2 * t + phase + channel) * (1 - 0.3 * math.sin(0.9 * t)) for t in at]
        return [round(gain * size * s, 5) for s in swing]

    measured = curve(1.0, 0.0)
    measured[200:212] = [None] * 12
    return DiagnosisTrace(
        episode=episode,
        channel=name,
        unit=unit,
        time=time,
        measured=measured,
        nominal=curve(1.14, 0.09),
        calibrated=curve(1.07, 0.05),
        extended=curve(1.01, 0.01) if extended else None,
    )


def effects_list(robot: str | None = "servo_pendulum") -> EffectsList:
    """A short library."""
    told = robot is not None
    delay = EffectSize(
        name="delay", unit="s", meaning="from sending to acting", weak=0.005, medium=0.01, strong=0.02
    )
    friction = EffectSize(
        name="torque", unit="N*m", meaning="dry friction", weak=0.01, medium=0.03, strong=0.08, per="torque"
    )
    return EffectsList(
        robot=robot,
        effects=(
            EffectRow(
                id="command_delay",
                acts_on="command",
                title="commands arrive late",
                parameters=(delay,),
                group=("sensor_delay",),
                separate_by="a hardware loop-back",
                applies=True if told else None,
            ),
            EffectRow(
                id="coulomb_friction",
                acts_on="friction",
                title="dry friction, the same at all speeds",
                parameters=(friction,),
                near=("stribeck_friction",),
                separate_by="slow reversals at two loads",
                applies=True if told else None,
            ),
            EffectRow(
                id="ground_friction",
                acts_on="contact",
                title="the ground is more slippery than the model's",
                parameters=(friction,),
                applies=False if told else None,
                why_not="nothing in the model can touch anything" if told else None,
            ),
        ),
    )


def trial(
    seed: int = 0, hidden: str | None = "load_friction", named: str | None = "load_friction"
) -> TrialResult:
    """One hidden robot; it is right where `named` is `hidden`."""
    right = named == hidden
    return TrialResult(
        robot="servo_pendulum",
        seed=seed,
        hidden=hidden,
        size="medium" if hidden else None,
        hidden_values={"coefficient": 0.08} if hidden else {},
        true_parameters={"tip_mass": 0.493},
        named=named,
        verdict="none" if named is None else "named",
        right=right,
        false_alarm=hidden is None and named is not None,
        in_set=right if hidden else None,
        size_of_set=0 if named is None else 1 + seed % 2,
        share_of_attainable_gain=0.97 if right and hidden else None,
        parameter_error=0.06 if right and hidden else None,
        seconds=8.0 + 0.1 * seed,
    )


def trials() -> TrialTable:
    """Ten robots with an effect, one of which is taken for another and one missed, and four without, one alarm."""
    named = ["load_friction"] * 4 + ["stribeck_friction"]
    made = [trial(i, "load_friction", n) for i, n in enumerate(named)]
    made += [
        trial(10 + i, "backlash", n) for i, n in enumerate(["backlash[arm]"] + ["backlash"] * 3 + [None])
    ]
    made[5] = made[5].model_copy(update={"right": True, "in_set": True})
    made += [trial(20 + i, None, n) for i, n in enumerate([None, None, "payload", None])]
    return TrialTable.of("servo_pendulum", made)


def experiment() -> Experiment:
    """Commands that tell a payload from dry friction."""
    limit = LimitKept(name="arm/target", unit="rad", low=-3.1416, high=3.1416, least=-1.9, most=2.2)
    return Experiment(
        robot="servo_pendulum",
        between=("payload", "coulomb_friction"),
        file="next.csv",
        seconds=10.0,
        separation=61.0,
        usual=14.0,
        limits=(limit,),
        note="ramps and holds at two heights",
    )


def protocol() -> LegProtocol:
    """Commands for one leg that hangs free."""
    limit = LimitKept(name="fl_hip/target", unit="rad", low=-0.785, high=0.785, least=-0.5, most=0.6)
    leg = LegCommands(
        leg="fl",
        joints=("fl_hip", "fl_knee"),
        file="fl.csv",
        seconds=25.0,
        episodes=("fit_0", "select_0", "test_0"),
        held_out=("test_0",),
        operator="Fix the base on a stand so that leg fl hangs free.",
        expected=(
            ExpectedEvidence(effect="backlash", joint="fl_hip", nats=236.0),
            ExpectedEvidence(effect="backlash", joint="fl_knee", nats=182.0),
        ),
    )
    return LegProtocol(
        robot="quadruped", folder="hanging", stand="hanging/robot", legs=(leg,), limits=(limit,)
    )


def commands() -> Recording:
    """What an experiment plays: one command, for two seconds."""
    time = 0.01 * np.arange(201)
    values = np.round(1.5 * np.sin(3.0 * time), 6)[:, None]
    return Recording((Channel("arm/target", "rad"),), (Episode("0", time, values),), measured=False)
