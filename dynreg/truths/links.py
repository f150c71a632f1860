"""The inertia matrix of a chain of links, and the torques that its motion asks for.

Newton and Euler from the base outwards and back for the torques, composite bodies for the inertia matrix
(Featherstone, Rigid Body Dynamics Algorithms, chapters 5 and 6), all in the frame of the world. `kernels` compiles it.
"""

import numpy as np


def dynamics(at, axis, mass, centre, inertia, gravity, q, v, M, bias):
    """Write the inertia matrix M (n, n) and the torques `bias` (n,) of gravity and speed, at q and v (n,)."""
    n = len(q)
    R = np.empty((n, 3, 3))
    p, z, c = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    force, moment = np.empty((n, 3)), np.empty((n, 3))
    world = np.empty((n, 3, 3))
    w, alpha, a = np.zeros(3), np.zeros(3), -gravity.copy()
    before = np.eye(3)
    foot = np.zeros(3)
    for i in range(n):
        d = _turned(before, at[i])
        zi = _turned(before, axis[i])
        p[i] = foot + d
        z[i] = zi
        _rotate(before, axis[i], q[i], R[i])
        a = a + _cross(alpha, d) + _cross(w, _cross(w, d))
        alpha = alpha + _cross(w, zi) * v[i]
        w = w + zi * v[i]
        r = _turned(R[i], centre[i])
        c[i] = p[i] + r
        for j in range(3):
            for k in range(3):
                s = 0.0
                for x in range(3):
                    for y in range(3):
                        s += R[i, j, x] * inertia[i, x, y] * R[i, k, y]
                world[i, j, k] = s
        force[i] = mass[i] * (a + _cross(alpha, r) + _cross(w, _cross(w, r)))
        moment[i] = _turned(world[i], alpha) + _cross(w, _turned(world[i], w))
        before = R[i]
        foot = p[i]
    f, m = np.zeros(3), np.zeros(3)
    whole, first, about = 0.0, np.zeros(3), np.zeros((3, 3))
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            m = m + _cross(p[i + 1] - p[i], f)
        m = m + moment[i] + _cross(c[i] - p[i], force[i])
        f = f + force[i]
        bias[i] = z[i, 0] * m[0] + z[i, 1] * m[1] + z[i, 2] * m[2]
        # the links from here on as one body, about the origin
        whole += mass[i]
        square = c[i, 0] ** 2 + c[i, 1] ** 2 + c[i, 2] ** 2
        for j in range(3):
            first[j] += mass[i] * c[i, j]
            for k in range(3):
                about[j, k] += world[i, j, k] - mass[i] * c[i, j] * c[i, k]
            about[j, j] += mass[i] * square
        drift = _cross(p[i], z[i])
        linear = whole * drift + _cross(z[i], first)
        angular = _turned(about, z[i]) + _cross(first, drift)
        for j in range(i + 1):
            own = _cross(p[j], z[j])
            M[i, j] = 0.0
            for k in range(3):
                M[i, j] += z[j, k] * angular[k] + own[k] * linear[k]
            M[j, i] = M[i, j]


def _cross(a, b):
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def _turned(R, a):
    out = np.empty(3)
    for j in range(3):
        out[j] = R[j, 0] * a[0] + R[j, 1] * a[1] + R[j, 2] * a[2]
    return out


def _rotate(before, axis, angle, out):
    """Write `before` (3, 3) turned by an angle about a unit axis of it (Rodrigues)."""
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    o = 1.0 - c
    t = np.empty((3, 3))
    t[0, 0], t[0, 1], t[0, 2] = c + x * x * o, x * y * o - z * s, x * z * o + y * s
    t[1, 0], t[1, 1], t[1, 2] = y * x * o + z * s, c + y * y * o, y * z * o - x * s
    t[2, 0], t[2, 1], t[2, 2] = z * x * o - y * s, z * y * o + x * s, c + z * z * o
    for j in range(3):
        for k in range(3):
            out[j, k] = before[j, 0] * t[0, k] + before[j, 1] * t[1, k] + before[j, 2] * t[2, k]
