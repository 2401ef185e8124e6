#!/usr/bin/env python3
"""Bakes transfer vectors of a model through nusselt's C interface, from NumPy arrays without a copy.

    bake.py LIBRARY FOLDER [--out FILE.npy] [--quality NAME] [--check]

FOLDER holds positions.npy, normals.npy and indices.npy, as `nusselt transfer MODEL --out FOLDER` writes them. --check
compares with the folder's transfer.npy and masks.npy, bit for bit: equal for a model of one mesh in its rest pose.
"""

import argparse
import ctypes as c
import pathlib
import sys

import numpy as np

QUALITIES = {"paper": 1, "draft": 2, "standard": 3, "fine": 4}


class Status(c.Structure):
    _fields_ = [("code", c.c_uint32), ("text", c.c_char_p)]


class View(c.Structure):
    _fields_ = [("data", c.c_void_p), ("count", c.c_size_t), ("stride", c.c_size_t)]

    def __init__(self, array=None):
        if array is not None:
            super().__init__(array.ctypes.data, len(array), array.strides[0])


class Mesh(c.Structure):
    _fields_ = [("slot", c.c_uint32), ("generation", c.c_uint32)]


class MeshDesc(c.Structure):
    _fields_ = [("size", c.c_size_t), ("rest_positions", View), ("rest_normals", View), ("indices", c.c_void_p),
                ("index_count", c.c_size_t)]


class FrameMesh(c.Structure):
    _fields_ = [("mesh", Mesh), ("positions", View), ("normals", View), ("transfer", View), ("masks", View),
                ("needed", c.c_void_p), ("outputs", c.c_void_p), ("output_size", c.c_size_t),
                ("output_count", c.c_uint32), ("receive_only", c.c_uint32), ("gloss", c.c_void_p),
                ("gloss_size", c.c_size_t), ("back_transfer", View), ("back_masks", View),
                ("back_needed", c.c_void_p), ("back_outputs", c.c_void_p), ("back_output_count", c.c_uint32),
                ("object", c.c_uint32)]


class FrameDesc(c.Structure):
    _fields_ = [("size", c.c_size_t), ("meshes", c.POINTER(FrameMesh)), ("mesh_size", c.c_size_t),
                ("mesh_count", c.c_uint32), ("quality", c.c_uint32), ("order", c.c_uint32), ("same_pose", c.c_uint32),
                ("origin", c.c_void_p), ("history", Mesh), ("budget_us", c.c_float),
                ("falloff_from", c.c_float), ("falloff_to", c.c_float), ("light", c.c_void_p),
                ("environment", c.c_void_p), ("visible", c.c_void_p), ("record", c.c_void_p),
                ("visible_segment", c.c_uint32), ("watertight", c.c_uint32)]


class Nusselt:
    """The library with one context. Methods raise RuntimeError with the library's own text."""

    def __init__(self, path):
        self.library = c.CDLL(str(path))
        self.context = c.c_void_p()
        self.call("nusselt_create_context", None, c.byref(self.context))

    def close(self):
        self.call("nusselt_destroy_context", self.context)

    def call(self, name, *arguments):
        function = getattr(self.library, name)
        function.restype = Status
        status = function(*arguments)
        if status.code:
            raise RuntimeError(status.text.decode())

    def bake(self, positions, normals, indices, quality):
        """(transfer, masks): float32 (V, 25), and uint32 (V, bits / 32)."""
        desc = MeshDesc(c.sizeof(MeshDesc), View(positions), View(normals), indices.ctypes.data, indices.size)
        mesh = Mesh()
        self.call("nusselt_add_mesh", self.context, c.byref(desc), c.byref(mesh))
        bits = self.library.nusselt_quality_mask_bits(QUALITIES[quality])
        transfer = np.empty((len(positions), 25), np.float32)
        masks = np.empty((len(positions), bits // 32), np.uint32)
        one = FrameMesh(mesh, View(positions), View(normals), View(transfer), View(masks))
        frame = FrameDesc(c.sizeof(FrameDesc), c.pointer(one), c.sizeof(FrameMesh), 1, QUALITIES[quality])
        handle = Mesh()  # of the same shape as a frame's
        self.call("nusselt_submit", self.context, c.byref(frame), c.byref(handle))
        self.call("nusselt_wait", self.context, handle, None)
        self.call("nusselt_remove_mesh", self.context, mesh)
        return transfer, masks


def load(folder, name, dtype):
    array = np.load(folder / (name + ".npy"))
    if array.dtype != dtype:
        sys.exit(f"bake.py: {folder / name}.npy: {array.dtype} where {np.dtype(dtype)} is needed")
    return np.ascontiguousarray(array)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("library", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--quality", choices=QUALITIES, default="standard")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()

    arrays = [load(options.folder, "positions", np.float32), load(options.folder, "normals", np.float32),
              load(options.folder, "indices", np.uint32)]
    try:
        nusselt = Nusselt(options.library)
        transfer, masks = nusselt.bake(*arrays, options.quality)
        nusselt.close()
    except RuntimeError as error:
        sys.exit(f"bake.py: {options.folder}: {error}")
    if options.out:
        np.save(options.out, transfer)
    print(f"{len(transfer)} vertices, mean openness {transfer[:, 0].mean() / 0.28209479:.3f}")
    if options.check:
        for name, mine in (("transfer", transfer), ("masks", masks)):
            theirs = np.load(options.folder / (name + ".npy"))
            if mine.tobytes() != theirs.tobytes():
                differ = (mine != theirs).any(axis=1).sum() if mine.shape == theirs.shape else "all"
                sys.exit(f"bake.py: {name}.npy: {differ} of {len(mine)} vertices differ")
        print("equal, bit for bit")


if __name__ == "__main__":
    main()
