"""The integrators of truths, compiled: each is the text of a few modules, put together without their imports."""

import ast
from functools import cache
from pathlib import Path
from types import ModuleType

from dynreg.compiled import compiled

_HEAD = """import numpy as np
from numba import njit

_plain = njit(error_model="numpy")
_kept = njit(error_model="numpy", cache=True)
"""
_JOINTS = ("rows", "links", "solve", "drives", "gears", "joints")
_ROLLING = ("rolling",)


@cache
def joints() -> ModuleType:
    """`joints.episode`, compiled; 15 s of a core for the first process that asks for it."""
    return compiled(text(_JOINTS, "episode"), "truth_joints")


@cache
def rolling() -> ModuleType:
    """`rolling.drive`, compiled."""
    return compiled(text(_ROLLING, "drive"), "truth_rolling")


def text(rooms: tuple[str, ...], entry: str) -> str:
    """One module of these, lowest first, in which every function is compiled, and `entry` kept on disk."""
    parts = [_HEAD]
    for room in rooms:
        tree = ast.parse(Path(__file__).with_name(f"{room}.py").read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                continue
            if isinstance(node, ast.FunctionDef) and node.name == "plain":
                continue  # for those who fill the table
            if isinstance(node, ast.FunctionDef):
                node.decorator_list = [ast.Name("_kept" if node.name == entry else "_plain", ast.Load())]
            parts.append(ast.unparse(node))
    return "\n\n".join(parts) + "\n"
