"""A model from the program `transfer` and baked by the example must be equal bit for bit; a changed one must not.
Usage: bake_test.py PROGRAM LIBRARY BAKE FOLDER. Exit status 77: NumPy is not here."""

import math
import pathlib
import shutil
import subprocess
import sys

try:
    import numpy as np
except ImportError:
    sys.exit(77)

program, library, bake, folder = sys.argv[1:]
folder = pathlib.Path(folder)
shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)

# A knotted tube: it shadows itself, and it is closed.
rings, sides = 120, 12
with open(folder / "knot.obj", "w") as out:
    centre = lambda t: np.array([math.sin(t) + 2 * math.sin(2 * t), math.cos(t) - 2 * math.cos(2 * t), -math.sin(3 * t)])
    for i in range(rings):
        t = 2 * math.pi * i / rings
        along = centre(t + 1e-4) - centre(t - 1e-4)
        a = np.cross(along, [0.3, 0.5, 0.8])
        a /= np.linalg.norm(a)
        b = np.cross(along, a)
        b /= np.linalg.norm(b)
        for k in range(sides):
            angle = 2 * math.pi * k / sides
            out.write("v %.6f %.6f %.6f\n" % tuple(centre(t) + 0.6 * (a * math.cos(angle) + b * math.sin(angle))))
    for i in range(rings):
        for k in range(sides):
            corner = lambda di, dk: (i + di) % rings * sides + (k + dk) % sides + 1
            out.write(f"f {corner(0, 0)} {corner(1, 0)} {corner(1, 1)}\nf {corner(0, 0)} {corner(1, 1)} {corner(0, 1)}\n")

for quality in ("standard", "fine", "paper"):
    model = folder / quality
    subprocess.run([program, "transfer", folder / "knot.obj", "--out", model, "--quality", quality, "--threads", "1"],
                   check=True)
    command = [sys.executable, bake, library, model, "--quality", quality, "--check", "--out", model / "baked.npy"]
    subprocess.run(command, check=True)
    assert np.load(model / "baked.npy").tobytes() == np.load(model / "transfer.npy").tobytes()

transfer = np.load(model / "transfer.npy")
transfer[5, 3] += 1e-7
np.save(model / "transfer.npy", transfer)
planted = subprocess.run(command, capture_output=True, text=True)
assert planted.returncode != 0 and "1 of" in planted.stderr, planted

indices = np.load(model / "indices.npy")
indices[0, 0] = 1 << 30
np.save(model / "indices.npy", indices)
broken = subprocess.run(command, capture_output=True, text=True)
assert broken.returncode != 0 and "index" in broken.stderr, broken
shutil.rmtree(folder)
