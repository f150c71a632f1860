"""Laws that hold for every effect of the library."""

from itertools import combinations

import numpy as np
import pytest
from effect_benches import Bench, bench, fine, plain, rms, together

from dynreg.sim.effects import Effect, effects

EFFECTS = tuple(effects().values())
SHARED = [e for e in EFFECTS if e.why_not(bench("servo").robot) is None]  # both engines offer their ports
NOISES = 3.0  # sensor noises that a strong effect moves a channel by, at the least
ROOTS = ("motor_backlash",)  # a motor that crosses its play gathers speed by the root of it
TWICE = (
    {"torque_limit", "duty_limit"},
    {"backlash", "motor_backlash"},
)  # one limit, one play: each bends the other
# flanks that a motor leaves and meets within a step: engines are compared by a step that resolves that
FLANKS = (("backlash", "medium"),)
AGREEMENT = 0.1  # of the change, by which the two engines may differ: their time steps are of different order


def _benches(effect: Effect, *names: str) -> list[Bench]:
    """Those of the benches where the effect can act."""
    return [b for b in map(bench, names) if effect.why_not(b.robot) is None]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.id)
def test_half_of_a_small_size_is_half_the_change(effect: Effect):
    """Nothing at size zero, and a slope there that a fit can follow (small is 2 % of the weak size)."""
    for b in _benches(effect, "servo_short", "air", "lean", "wheels") or _benches(effect, "arm"):
        half, whole, weak = (rms(together(b, size)[effect]) for size in (0.01, 0.02, 1.0))
        assert whole <= 0.2 * weak, b.name
        if (
            half > 1e-12
        ):  # a limit that is far away changes nothing at all, nor does the ground a leg in the air
            assert (1.15 if effect.id in ROOTS else 1.4) < whole / half < 2.8, b.name
        else:
            assert effect.size.inverse or weak == 0, b.name


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.id)
def test_a_strong_effect_is_seen(effect: Effect):
    """On at least one bench some channel moves by several times its sensor noise."""
    most = 0.0
    for b in _benches(effect, "servo", "arm", "stand", "lean", "wheels"):
        change = together(b, "strong")[effect]
        assert np.isfinite(change).all()
        noise = np.array([c.noise for c in b.robot.file.channels])[b.columns]
        most = max(most, float((np.sqrt((change**2).mean(axis=(0, 1))) / noise).max()))
    assert most > NOISES


@pytest.mark.parametrize("size", ["medium", "strong"])
@pytest.mark.parametrize("effect", SHARED, ids=lambda e: e.id)
@pytest.mark.parametrize("drive", ["servo", "pid"])
def test_engines_agree_on_the_change_that_an_effect_makes(effect: Effect, size: str, drive: str):
    benches = [bench(name) for name in (drive, f"{drive}_mujoco")]
    if effect.why_not(benches[0].robot):
        pytest.skip("not on this drive")
    if drive == "pid":  # whose integral adds up what a time step is off
        benches = [fine(b) for b in benches]
    if (effect.id, size) in FLANKS and drive != "pid":
        joint, mujoco = (fine(b).changes({effect: size})[0] for b in benches)
    else:
        joint, mujoco = (together(b, size)[effect] for b in benches)
    assert rms(joint - mujoco) < AGREEMENT * rms(joint)


@pytest.mark.parametrize("name", ["servo", "servo_mujoco", "stand"])
def test_rows_are_independent_of_each_other_and_of_the_threads(name: str):
    """A batch of all effects, of pairs and of none gives the bits of each simulator alone; -8 % of clock error
    asks for another number of time steps, which must not let the memories of the others run on."""
    b = bench(name)
    able = [e for e in EFFECTS if e.why_not(b.robot) is None]
    clock = effects()["clock_error"]
    rows = [{}, *({e: "medium"} for e in able), *({e: "strong", clock: -8.0} for e in able if e is not clock)]
    states = b.states(*rows)
    assert np.isfinite(states).all()
    np.testing.assert_array_equal(states[0], plain(b))
    np.testing.assert_array_equal(b.states(*rows, threads=2), states)
    for row, whole in zip(rows[1::3], states[1::3], strict=True):
        np.testing.assert_array_equal(b.states(row)[0], whole, err_msg=str(row))


def test_small_effects_add_up_in_every_pair():
    b = bench("servo_short")
    alone = dict(zip(SHARED, b.changes(*({e: 0.01} for e in SHARED)), strict=True))
    pairs = [(e, f) for e, f in combinations(SHARED, 2) if {e.id, f.id} not in TWICE]
    for (first, second), change in zip(
        pairs, b.changes(*({e: 0.01, f: 0.01} for e, f in pairs)), strict=True
    ):
        error = rms(change - alone[first] - alone[second])
        assert error < 0.02 * max(rms(alone[first]), rms(alone[second])) + 1e-9, (first, second)


def test_any_two_strong_effects_compose():
    for name in ("servo", "lean", "wheels"):
        b = bench(name)
        pairs = combinations([e for e in EFFECTS if e.why_not(b.robot) is None], 2)
        assert np.isfinite(b.states(*({e: "strong", f: "strong"} for e, f in pairs))).all(), name


def test_every_effect_says_what_it_is_and_what_is_like_it():
    ports = {"command", "drive", "friction", "transmission", "body", "contact", "sensor"}
    for e in EFFECTS:
        assert e.acts_on in ports and e.title and e.separate_by
        assert set(e.near) <= set(effects()) and e.id not in e.near
        acting = (e.configure, e.feedback, e.command, e.encoder, e.drive, e.friction, e.roll, e.observe)
        assert any(acting)
        for p in e.parameters:
            sizes = [p.weak, p.medium, p.strong, p.most][:: -1 if p.inverse else 1]
            assert sizes == sorted(sizes) and sizes[0] > 0
