"""A plausible drift document."""

from dynreg.results import Drift, DriftCell, DriftPattern, FalseAlarms, Separating, Shift, Taken

FACTORS = {"left wheel": 0.802, "all speeds": 0.905, "turns only": 0.911, "right wheel": 1.004}


def drift(verdict: str = "moved", rivals: tuple[str, ...] = ()) -> Drift:
    """The left wheel slower; where there are rivals, they cannot be told from it."""
    moved = verdict == "moved"
    cells = () if verdict == "too little data" else tuple(_cell(i, moved and i < 2) for i in range(4))
    tests = 3 * len(cells)
    return Drift(
        robot="diffdrive",
        recording="ab" * 32,
        recording_name="friday",
        earlier=_taken("monday", "cd" * 32),
        recent=_taken("friday", "ab" * 32),
        chosen=False,
        verdict=verdict,
        test="student",
        together=True,
        tests=tests,
        rejected=4 if moved else 0,
        false_alarms=FalseAlarms(
            level=0.05,
            expected=0.05 * tests,
            splits=200 if tests else 0,
            by="episodes" if tests else None,
            tests=230.5 if tests else None,
            one_by_one=0.043 if tests else None,
            alarms=0.06 if tests else None,
        ),
        pattern="left wheel" if moved and not rivals else None,
        rivals=rivals,
        separate_by=(Separating(left=0.19, right=0.19, apart=14.2, known=False),) if rivals else (),
        patterns=_patterns(moved) if tests else (),
        cells=cells,
        sample=0.5,
        grid=20,
        low=-0.315,
        high=0.315,
        reference={"left": 0.98, "right": 1.01, "turns": 0.998, "speed_lag": 0.084, "yaw_lag": 0.097},
        seed=0,
        notes=(),
        seconds=1.5,
    )


def _taken(name: str, identity: str) -> Taken:
    return Taken(recording=identity, name=name, samples=792, pieces=1690, short=763, long=0, outside=2)


def _patterns(moved: bool) -> tuple[DriftPattern, ...]:
    nothing = DriftPattern(name="no change", factor=1.0, low=1.0, high=1.0, share=0.0, evidence=0.0)
    found = tuple(
        DriftPattern(
            name=name,
            factor=factor if moved else 1.0,
            low=factor - 0.003 if moved else 0.997,
            high=factor + 0.003 if moved else 1.003,
            share=0.98 / (i + 1) if moved else 0.001,
            evidence=9000.0 / (i + 1) if moved else -5.0 - i,
        )
        for i, (name, factor) in enumerate(FACTORS.items())
    )
    return (*found, nothing) if moved else (nothing, *found)


def _cell(i: int, moved: bool) -> DriftCell:
    size = -12.0 + i if moved else 0.5 * i
    axes = {"dx": ("m", 0.0005), "dy": ("m", 0.0005), "dtheta": ("rad", 0.01)}
    return DriftCell(
        left=-0.29925 + 0.0315 * (4 * i + 2),
        right=-0.29925 + 0.0315 * (15 - i),
        earlier=6,
        recent=7,
        shifts={
            axis: Shift(
                value=size * error,
                error=error,
                unit=unit,
                p=1e-8 if moved else 0.6,
                sigmas=size,
                rejected=moved and axis != "dx",
            )
            for axis, (unit, error) in axes.items()
        },
    )
