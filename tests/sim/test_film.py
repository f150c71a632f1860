"""Pictures drawn without a screen: a frame for every moment, not of one colour; a clear error without OpenGL."""

import io

import mujoco
import numpy as np
import pytest
from PIL import Image

from dynreg.errors import PictureError
from dynreg.sim.film import STILLS, backends, draw, moments
from dynreg.sim.robot import load_robot

RATE = 36.0


@pytest.fixture(scope="module")
def standing() -> tuple[mujoco.MjModel, np.ndarray]:
    """The quadruped, and a second of poses in which it is pushed half a metre ahead."""
    model = load_robot("quadruped").model
    poses = np.tile(model.keyframe("stance").qpos, (37, 1))
    poses[:, 0] = np.linspace(0.0, 0.5, 37)
    return model, poses


@pytest.fixture(scope="module")
def opengl(standing) -> None:
    """Skips where this machine cannot draw."""
    try:
        draw(*standing, RATE, np.zeros(1), "png")
    except PictureError as problem:
        pytest.skip(str(problem))


def test_moments_of_a_film_and_of_a_strip() -> None:
    film = moments(1.0, "gif", 0.4)
    assert len(film) == 13 and np.allclose(np.diff(film), 0.08) and film[-1] <= 1.0
    assert np.allclose(moments(10.0, "png", 0.4), [5.0, 5.1, 5.2, 5.3])
    brief = moments(0.5, "png", 0.4)
    assert len(brief) == STILLS and brief[-1] <= 0.5
    assert moments(0.2, "png", 0.4).max() <= 0.2


def test_a_film_has_every_moment_and_shows_the_robot_move(standing, opengl) -> None:
    times = moments(0.4, "gif", 0.4)
    film = Image.open(io.BytesIO(draw(*standing, RATE, times, "gif")))
    assert film.format == "GIF" and film.n_frames == len(times) == 6
    frames = []
    for i in range(film.n_frames):
        film.seek(i)
        frames.append(np.array(film.convert("RGB"), dtype=float))
        assert film.info["duration"] == 80
    below = [f[20:] for f in frames]  # the time stands above
    assert min(f.std() for f in below) > 10.0
    assert np.abs(below[0] - below[3]).max() > 30.0  # the lines on the ground pass by


def test_a_strip_has_four_stills_side_by_side(standing, opengl) -> None:
    strip = Image.open(io.BytesIO(draw(*standing, RATE, moments(1.0, "png", 0.4), "png")))
    assert strip.format == "PNG" and strip.size == (320 * STILLS, 240)
    assert np.array(strip.convert("RGB"))[:, -320:].std() > 10.0


def test_a_film_ends_where_the_simulation_diverged(standing, opengl) -> None:
    model, poses = standing
    lost = poses.copy()
    lost[10:] = np.nan
    film = Image.open(io.BytesIO(draw(model, lost, RATE, moments(1.0, "gif", 0.4), "gif")))
    assert film.n_frames == 4  # up to 9 / 36 s
    with pytest.raises(PictureError, match="diverged at once"):
        draw(model, np.full_like(poses, np.nan), RATE, np.zeros(1), "gif")


def test_where_one_opengl_fails_the_next_one_draws(standing, opengl, monkeypatch) -> None:
    works = backends()
    monkeypatch.setattr("dynreg.sim.film.backends", lambda: ("disable", *works))
    assert draw(*standing, RATE, np.zeros(1), "png").startswith(b"\x89PNG")


def test_what_the_user_chose_is_what_is_tried(monkeypatch) -> None:
    """Also where the program has set it aside; and nothing chosen is a choice, too."""
    for name in ("DYNREG_GL", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    usual = backends()
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert backends() == ("osmesa",)
    monkeypatch.setenv("DYNREG_GL", "egl")
    assert backends() == ("egl",)
    monkeypatch.setenv("DYNREG_GL", "")
    assert backends() == usual


def test_without_opengl_the_error_says_what_failed_and_what_to_install(standing, monkeypatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(PictureError, match="no picture was drawn .disable: .*libegl1") as caught:
        draw(*standing, RATE, np.zeros(1), "gif")
    assert caught.value.exit_status == 1
    monkeypatch.setenv("MUJOCO_GL", "crayons")
    with pytest.raises(PictureError, match="crayons"):
        draw(*standing, RATE, np.zeros(1), "gif")
