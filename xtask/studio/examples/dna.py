# dna.py MAIN.smc ANNOTATIONS.smc FOLDER: writes the ring of 48 cameras of a DNA-Rendering sequence, its first 33
# frames, as a capture. Needs h5py, numpy and pillow. RT is the transform from camera to world.
import io
import json
import sys
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

FRAMES, FPS, RING = 33, 15, range(48)
main, annotations, folder = h5py.File(sys.argv[1]), h5py.File(sys.argv[2]), Path(sys.argv[3])

cameras = []
for number in RING:
    taken = main["Camera_5mp"].get(str(number))
    if taken is None:
        continue
    name = f"{number:02}"
    for part in ("images", "masks"):
        (folder / part / name).mkdir(parents=True, exist_ok=True)
    for frame in range(FRAMES):
        photograph = taken["color"][str(frame)][()].tobytes()
        (folder / f"images/{name}/{frame:06}.jpg").write_bytes(photograph)
        mask = annotations["Mask"][str(number)]["mask"][str(frame)][()].tobytes()
        levels = np.asarray(Image.open(io.BytesIO(mask)).convert("RGB")).max(axis=2)
        Image.fromarray(levels).save(folder / f"masks/{name}/{frame:06}.png")
    width, height = Image.open(io.BytesIO(photograph)).size
    parameter = annotations["Camera_Parameter"][name]
    cameras.append({
        "id": name, "w": width, "h": height,
        "K": parameter["K"][()].tolist(),
        "D": parameter["D"][()].ravel().tolist(),
        "w2c": np.linalg.inv(parameter["RT"][()]).tolist(),
    })
manifest = {
    "frames": FRAMES, "fps": FPS, "cameras": cameras,
    "images": "images/{camera}/{frame:06}.jpg", "masks": "masks/{camera}/{frame:06}.png",
}
(folder / "capture.json").write_text(json.dumps(manifest))
