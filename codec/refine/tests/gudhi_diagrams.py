"""Writes gudhi_diagrams.txt: superlevel H0 diagrams by GUDHI (PyPI `gudhi`), for persistence.rs.

    python gudhi_diagrams.py [FOLDER]

One line per field and connectivity: what the field is, `|`, and the pairs birth,death in order.
Fields are made by the same integer arithmetic here and in persistence.rs, so only diagrams are
stored. FOLDER may hold complexes in Perseus format; those without periodic axes are included.
Values are turned upside down for GUDHI, which knows sublevels only; the essential class ends at 0.
"""

import math
import pathlib
import sys

import gudhi
import numpy as np


def numbers(seed):
    """Knuth's MMIX generator, the upper 32 bits."""
    while True:
        seed = (seed * 6364136223846793005 + 1442695040888963407) % 2**64
        yield seed >> 32


def noise(size, seed, levels):
    draw = numbers(seed)
    return np.array([next(draw) % levels for _ in range(math.prod(size))], np.int64).reshape(size[::-1])


def smooth(size, seed, levels):
    """Sparse points, each axis summed over windows of 5 twice, divided down to `levels`."""
    field = noise(size, seed, 1000)
    field = np.where(field < 990, 0, field)
    for _ in range(2):
        for axis in range(3):
            padded = np.pad(field, [(2, 2) if a == axis else (0, 0) for a in range(3)])
            n = field.shape[axis]
            field = sum(padded.take(range(k, k + n), axis) for k in range(5))
    return field * levels // int(field.max())


def diagram(field, connectivity):
    """Pairs of the superlevels of an integer field, deaths at or below 0 as 0."""
    key = "top_dimensional_cells" if connectivity == 26 else "vertices"
    pairs = gudhi.CubicalComplex(**{key: -field.astype(float)}).persistence(homology_coeff_field=2)
    pairs = [(-birth, max(0.0, -death)) for dimension, (birth, death) in pairs if dimension == 0]
    return sorted((b, d) for b, d in pairs if b > max(d, 0))


def write(name, field):
    for connectivity in (6, 26):
        pairs = " ".join(f"{b:.17g},{d:.17g}" for b, d in diagram(field, connectivity))
        print(f"{name} {connectivity} | {pairs}")


for seed, (size, levels) in enumerate(
    [((5, 6, 7), 3), ((5, 6, 7), 12), ((6, 5, 4), 1000), ((8, 7, 6), 2), ((9, 1, 8), 6), ((1, 40, 1), 30)]
):
    write(f"noise {' '.join(map(str, size))} {seed} {levels}", noise(size, seed, levels))
for seed, (size, levels) in enumerate([((20, 18, 16), 200), ((30, 24, 20), 30), ((48, 48, 48), 2000)]):
    write(f"smooth {' '.join(map(str, size))} {seed} {levels}", smooth(size, seed, levels))
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.txt")) if len(sys.argv) > 1 else []:
    dimension, *rest = path.read_text().split()
    size = [int(n) for n in rest[: int(dimension)]]
    if min(size) > 0:
        values = np.array([float(value) for value in rest[int(dimension) :]])
        # Upside down, and all finite values above 0.
        top = values[np.isfinite(values)].max() + 1
        field = top - values
        field[~np.isfinite(field)] = -1
        write(f"file {path.name}", field.reshape(size[::-1]))
