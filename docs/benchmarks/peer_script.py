"""The pipeline as one would write it by hand, with OpenCV or with scipy.

Run it as ``python peer_script.py opencv|scipy MAP.yaml OUT_DIR``. It does the work of ``mapdeal
run`` with the default recipe and writes the same kinds of files, without the checks: no
damaged input is noticed, and a kill leaves half a set.
"""

import sys
from pathlib import Path

import numpy as np
import yaml

RADIUS, INFLATION_RADIUS, FACTOR, VIEW_RANGE = 0.3, 0.55, 10.0, 2.0


def main(engine: str, source: Path, folder: Path) -> None:
    """Run the whole pipeline with one of the two libraries."""
    about = yaml.safe_load(source.read_text())
    resolution = about["resolution"]
    pixels, dilate, distances, save, coloured = _library(engine, source.parent / about["image"])
    dark = (255 - pixels) / np.float32(255)
    occupancy = np.full(pixels.shape, -1, np.int8)
    occupancy[dark <= about["free_thresh"]] = 0
    occupancy[dark >= about["occupied_thresh"]] = 100
    reach = int(np.ceil(RADIUS / resolution - 1e-9))
    offsets = np.arange(-reach, reach + 1) * resolution
    disc = np.hypot(offsets[:, None], offsets) <= RADIUS + 1e-9
    solid = dilate(occupancy == 100, disc)
    outside, inside = (distances(side) * np.float32(resolution) for side in (~solid, solid))
    field = np.where(solid, np.float32(resolution) - inside, outside).astype(np.float32)
    cost = (252 * np.exp(-FACTOR * outside)).astype(np.uint8)
    cost[outside > INFLATION_RADIUS] = 0
    cost[(occupancy == -1) & (cost < 253)] = 255
    cost[solid] = 254
    view = (100 * (1 - np.minimum(outside, VIEW_RANGE) / VIEW_RANGE)).astype(np.uint8)
    inflated = np.where(solid, 0, np.where(occupancy == -1, 205, 254)).astype(np.uint8)

    folder.mkdir(parents=True, exist_ok=True)
    geometry = {"resolution": resolution, "origin": about["origin"]}
    np.savez_compressed(folder / "esdf.npz", distance=field[::-1], **geometry)
    np.savez_compressed(folder / "cost.npz", cost=cost[::-1], **geometry)
    for name, layer in (("inflated", inflated), ("esdf", view), ("cost", cost)):
        save(folder / f"{name}.pgm", layer)
        (folder / f"{name}.yaml").write_text(yaml.safe_dump({**about, "image": f"{name}.pgm"}))
    save(folder / "inflated.png", inflated)
    shade = np.clip(field / max(float(field.max()), 1e-6), 0, 1) * 255
    save(folder / "esdf.png", coloured(shade.astype(np.uint8)))
    save(folder / "cost.png", coloured(cost))


def _library(engine: str, image: Path) -> tuple:
    """Return the pixels, and functions that dilate, measure, save and colour."""
    if engine == "opencv":
        import cv2

        precise = (cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return (
            cv2.imread(str(image), cv2.IMREAD_GRAYSCALE),
            lambda mask, disc: cv2.dilate(mask.astype(np.uint8), disc.astype(np.uint8)) > 0,
            lambda mask: cv2.distanceTransform(mask.astype(np.uint8), *precise),
            lambda path, pixels: cv2.imwrite(str(path), pixels),
            lambda pixels: cv2.applyColorMap(pixels, cv2.COLORMAP_VIRIDIS),
        )
    from PIL import Image
    from scipy import ndimage

    return (
        np.asarray(Image.open(image).convert("L")),
        ndimage.binary_dilation,
        lambda mask: ndimage.distance_transform_edt(mask).astype(np.float32),
        lambda path, pixels: Image.fromarray(pixels).save(path),
        lambda pixels: np.stack([pixels, pixels // 2, 255 - pixels], axis=2),
    )


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
