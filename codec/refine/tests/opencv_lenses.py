"""Writes opencv_lenses.txt: points that OpenCV (PyPI `opencv-python-headless`) distorts, for lenses.rs.

    python opencv_lenses.py > opencv_lenses.txt        with OpenCV 5, whose version is the first line

A lens starts with a line: its model, the image size, fx, fy, cx, cy, `|`, the coefficients in OpenCV's
order, `|`, and the radius at which it ends in focal lengths (inf if it does not), by NumPy's roots.
Points follow, two lists for each lens, a line each: normalised x and y without the lens, and pixels
with it.

`project` points come from projectPoints, from the axis to just before the end of the lens. `undistort`
points cover the image: pixels of a grid, and where undistortPoints puts them. It iterates; points at
which it does not come within 1e-6 px are left out.
"""

import numpy as np
from numpy.polynomial import polynomial as poly

import cv2

# Model, image size, (fx, fy, cx, cy), coefficients.
LENSES = [
    # An action camera in its linear mode.
    ("rational", (1920, 1080), (1450.3, 1448.7, 963.2, 538.9), [-0.11, 0.07, 6e-4, -4e-4, -0.02]),
    # A webcam with a wide lens.
    ("rational", (1280, 720), (640.8, 641.5, 655.1, 349.2), [-0.38, 0.21, 1e-3, -2e-3, -0.07]),
    # A pincushion, and a principal point and pixels far from the usual.
    ("rational", (1600, 1200), (700, 1100, 300, 900), [0.3, -0.05, 0.02, -0.03, 0.01]),
    # A depth camera whose maker gives six radial coefficients.
    (
        "rational",
        (2048, 1536),
        (973.4, 973.1, 1017.6, 779.9),
        [0.4554, -2.5946, 5.7e-4, -1.2e-4, 1.5122, 0.3347, -2.4166, 1.4396],
    ),
    # Large coefficients that nearly cancel, as calibrations of wide lenses find them.
    (
        "rational",
        (1920, 1200),
        (560.2, 559.6, 949.5, 604.3),
        [7.62, 2.93, 1.1e-4, -2.3e-4, 0.052, 7.98, 5.41, 0.463],
    ),
    # A pole at 1.29 focal lengths.
    ("rational", (800, 600), (310, 305, 395, 310), [-0.1, 0, 0, 0, 0, -0.6, 0, 0]),
    # A lens that folds over at 1.29 focal lengths.
    ("rational", (800, 600), (310, 305, 395, 310), [-0.2, 0, 0, 0, 0]),
    # No real lens: a calibration that went astray.
    ("rational", (640, 480), (500, 500, 320, 240), [1e3, -1e6, 0, 0, 1e4, -1e2, 1e5, 1e6]),
    # The wide mode of an action camera.
    ("fisheye", (2704, 2028), (1183.4, 1181.9, 1349.3, 1021.7), [0.047, 0.013, -0.0092, 0.0017]),
    ("fisheye", (1280, 960), (386.2, 385.7, 641.3, 483.8), [-0.0166, 0.0045, -0.0031, 0.0005]),
    # Equidistant, with pixels that are not square.
    ("fisheye", (1000, 1000), (320, 410, 480, 530), [0, 0, 0, 0]),
    # Lenses that fold over, at 59 and 28 degrees from the axis.
    ("fisheye", (1200, 900), (520.5, 521.1, 610.2, 441.9), [-0.35, 0.02, 0.003, -0.001]),
    ("fisheye", (640, 480), (500, 500, 320, 240), [-1.5, 0.3, -0.1, 0.05]),
    # Two coefficients, as COLMAP's RADIAL_FISHEYE has them, growing to right angles.
    ("fisheye", (1920, 1080), (600, 600, 960, 540), [0.12, 0.03, 0, 0]),
]


def first_root(polynomial, limit):
    """Least positive real root below a limit; coefficients from the lowest."""
    roots = poly.polyroots(np.trim_zeros(polynomial, "b"))
    real = roots.real[np.abs(roots.imag) < 1e-9 * np.abs(roots)]
    return min((r for r in real if 0 < r < limit), default=np.inf)


def end(model, k):
    """Radius at which the distorted one stops growing or jumps at a pole."""
    if model == "fisheye":
        angle = first_root(poly.polyder([0, 1, 0, k[0], 0, k[1], 0, k[2], 0, k[3]]), np.pi / 2)
        return np.tan(angle) if np.isfinite(angle) else np.inf
    k = np.pad(np.asarray(k, float), (0, 8 - len(k)))
    over = [0, 1, 0, k[0], 0, k[1], 0, k[4]]
    under = [1, 0, k[5], 0, k[6], 0, k[7]]
    slope = poly.polysub(poly.polymul(poly.polyder(over), under), poly.polymul(over, poly.polyder(under)))
    return min(first_root(slope, 100), first_root(under, 100))


def project(model, points, k, d):
    points = np.column_stack([points, np.ones(len(points))]).reshape(-1, 1, 3)
    of = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    return of(points, np.zeros(3), np.zeros(3), k, d)[0].reshape(-1, 2)


def undistort(model, pixels, k, d):
    pixels = pixels.reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-13)
    if model == "fisheye":
        return cv2.fisheye.undistortPoints(pixels, k, d, criteria=criteria).reshape(-1, 2)
    return cv2.undistortPoints(pixels, k, d, criteria=criteria).reshape(-1, 2)


def rows(name, points, pixels):
    print(name)
    for (x, y), (u, v) in zip(points, pixels):
        print(f"{x:.16g} {y:.16g} {u:.13g} {v:.13g}")


print(f"# OpenCV {cv2.__version__}")
for model, (width, height), (fx, fy, cx, cy), coefficients in LENSES:
    k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)
    d = np.array(coefficients, float)
    last = end(model, coefficients)
    print(
        f"{model} {width} {height} {fx} {fy} {cx} {cy} | {' '.join(map(str, coefficients))} | {last:.12g}"
    )
    # Without an end, to beyond every corner.
    reach = last if np.isfinite(last) else (500 if model == "fisheye" else 3)
    radii = reach * np.array([0, 1e-6, 0.1, 0.35, 0.6, 0.85, 0.99, 0.99999])
    angles = 0.3 + 2 * np.pi * np.arange(5) / 5
    points = np.array([[r * np.cos(a), r * np.sin(a)] for r in radii for a in angles])
    rows("project", points, project(model, points, k, d))
    grid = np.array(
        [[x, y] for y in np.linspace(0.5, height - 0.5, 5) for x in np.linspace(0.5, width - 0.5, 7)]
    )
    points = undistort(model, grid, k, d)
    back = project(model, np.nan_to_num(points, nan=1e9), k, d)
    good = (np.abs(back - grid).max(axis=1) < 1e-6) & (np.hypot(*points.T) < last)
    rows("undistort", points[good], grid[good])
