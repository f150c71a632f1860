"""Draws poses of a MuJoCo model as a GIF or as a strip of stills: the program that `film` runs.

It runs by itself, `python -m dynreg.sim.camera MODEL POSES FORM PICTURE`, because MuJoCo chooses its OpenGL when it is
imported, from MUJOCO_GL, and an OpenGL that does not work may take its process down.
"""

import sys

import mujoco
import numpy as np
from PIL import Image, ImageDraw

SIZE = (320, 240)  # pixels
COLOURS = 64
MARKS, REACH = 0.25, 2.5  # m between the lines on the ground, and how far they are drawn
LINE = np.array([0.45, 0.5, 0.45, 1.0], dtype=np.float32)


def main(model_file: str, poses_file: str, form: str, picture: str) -> None:
    """Draw the frames; exits with one line where OpenGL gives nothing to see."""
    model = mujoco.MjModel.from_binary_path(model_file)
    with np.load(poses_file, allow_pickle=False) as told:
        times, poses = told["times"], told["poses"]
    frames = [Image.fromarray(f) for f in drawn(model, poses)]
    if all(low == high for low, high in frames[0].getextrema()):
        sys.exit("the picture is of one colour")
    for time, frame in zip(times, frames, strict=True):
        ImageDraw.Draw(frame).text((6, 4), f"{time:.2f} s", fill=(255, 255, 255))
    {"gif": _film, "png": _strip}[form](frames, times, picture)


def drawn(model: mujoco.MjModel, poses: np.ndarray) -> list[np.ndarray]:
    """(height, width, 3) pictures of poses (F, nq), seen by a camera that goes along with the robot."""
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.azimuth, camera.elevation = 125.0, -30.0
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.2, 0.4
    renderer = mujoco.Renderer(model, height=SIZE[1], width=SIZE[0])
    lamps, out = model.light_bodyid == 0, []  # those of the room go along, too
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_forward(model, data)
        centres = data.geom_xpos[model.geom_bodyid > 0]  # of all that can move
        low, high = centres.min(axis=0), centres.max(axis=0)
        if not out:
            camera.distance = 2.5 * (high - low).max()
            height = (low[2] + high[2]) / 2
        camera.lookat[:] = *(low + high)[:2] / 2, height
        data.light_xpos[lamps, :2] += camera.lookat[:2]
        renderer.update_scene(data, camera)
        _mark(renderer.scene, model, camera.lookat)
        out.append(renderer.render())
    renderer.close()
    return out


def _mark(scene: mujoco.MjvScene, model: mujoco.MjModel, centre: np.ndarray) -> None:
    """Lines on the ground, where there is some, that show how far the robot goes."""
    planes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0))
    if not len(planes):
        return
    ground = model.geom_pos[planes[0], 2]
    for axis in (0, 1):
        lines = MARKS * np.arange(np.ceil((centre[axis] - REACH) / MARKS), (centre[axis] + REACH) / MARKS)
        for line in lines:
            if scene.ngeom == scene.maxgeom:
                return
            at, size = np.array([centre[0], centre[1], ground]), np.full(3, REACH)
            at[axis], size[axis], size[2] = line, 0.002, 0.0005
            new = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(new, mujoco.mjtGeom.mjGEOM_BOX, size, at, np.eye(3).ravel(), LINE)
            scene.ngeom += 1


def _film(frames: list[Image.Image], times: np.ndarray, picture: str) -> None:
    palette = frames[len(frames) // 2].quantize(COLOURS)
    flat = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    pause = round(1000 * (times[1] - times[0])) if len(times) > 1 else 1000  # ms
    flat[0].save(picture, "GIF", save_all=True, append_images=flat[1:], duration=pause, loop=0)


def _strip(frames: list[Image.Image], times: np.ndarray, picture: str) -> None:
    width, height = frames[0].size
    strip = Image.new("RGB", (width * len(frames), height))
    for i, frame in enumerate(frames):
        strip.paste(frame, (i * width, 0))
    strip.quantize(2 * COLOURS).save(picture, "PNG", optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
