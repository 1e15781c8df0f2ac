"""Export of moving cloth: USD cache, glTF with morph targets, PC2 with an OBJ, and CSV of the tracked points.

USD and CSV keep the frames' own times. glTF interpolates linearly between frames and keeps their times too. PC2 has an
even rate, to which cubic splines resample an uneven recording.

In glTF y is up, so (x, y, z) becomes (x, z, -y). Every frame is a morph target, the difference to the first frame. Its
weight is 1 at its time and 0 at its neighbours'. The parts of a figure are rigid, and move as such in both.

Source: Khronos, "glTF 2.0 Specification", sections 3.7.2.2 and 3.11. PC2: "POINTCACHE2", then version 1, points, first
frame, frames a sample, samples, little-endian, then points as float triples, sample by sample.

Source: the importer of Blender's mesh cache modifier, "PC2".
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fit.export.about import caution_lines, origin_lines, provenance
from fit.export.drawing import node_normals
from fit.export.fabric import Fabric
from fit.export.moving import Moving
from fit.export.solids import Solids
from fit.export.usd_stage import FIGURE, define_cloth, define_mesh, new_stage, usd_bytes
from formats.arrays import Floats, Singles
from formats.fit_records import FitResult
from formats.rows import csv_text

GLTF_FLOAT, GLTF_UNSIGNED = 5126, 5125  # glTF's numbers of component types
VERTICES, INDICES = 34962, 34963  # glTF's buffer targets
SKIN_RGB = (0.77, 0.74, 0.71)  # RGB, of a figure
CODES_PER_SECOND = 30.0  # USD time codes a second; our choice: as the new motions' 30 frames


def words(result: FitResult, fabric: Fabric | None) -> list[str]:
    """Return the provenance of a motion, and its unidentified quantities, in sentences."""
    return [*origin_lines(result), *caution_lines(result, fabric)]


MOTION_HEADS = ("time_s", "point", "x_m", "y_m", "z_m")


def motion_csv(moving: Moving) -> str:
    """Return `motion_rows` as CSV."""
    return csv_text(MOTION_HEADS, motion_rows(moving))


def motion_rows(moving: Moving) -> Iterator[Sequence[object]]:
    """Yield a row per point and frame: the simulated tracked points, and the ends of the held edge.

    A 32-bit float is its shortest decimal, such as 0.2 and not 0.20000000298023224, and reads back as itself.
    """
    named = [*moving.point_names, "held_left", "held_right"]
    places = np.concatenate([_in_shortest_decimals(moving.points), _in_shortest_decimals(moving.held)], axis=1)
    for n, t in enumerate(moving.time):
        for k, name in enumerate(named):
            yield (float(t), name, *places[n, k].tolist())


def _in_shortest_decimals(places: Floats | Singles) -> Floats:
    """Return 32-bit floats as the doubles of their shortest decimals; other numbers unchanged."""
    return (places.astype(str) if places.dtype == np.float32 else places).astype(np.float64)


def usd_cache(result: FitResult, fabric: Fabric | None, moving: Moving) -> bytes:
    """Return a binary USD file of a mesh whose points are sampled in time, z up, metres.

    Raises:
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import Gf, Sdf, UsdGeom, Vt

    stage = new_stage(result)
    codes = moving.time * CODES_PER_SECOND
    stage.SetTimeCodesPerSecond(CODES_PER_SECOND)
    stage.SetFramesPerSecond(CODES_PER_SECOND)
    stage.SetStartTimeCode(float(codes[0]))
    stage.SetEndTimeCode(float(codes[-1]))
    mesh = define_cloth(stage, moving.triangles)
    flat = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    flat.Set(Vt.Vec2fArray.FromNumpy(moving.rest.astype(np.float32)))
    points, extent = mesh.CreatePointsAttr(), mesh.CreateExtentAttr()
    for code, places in zip(codes.tolist(), moving.places, strict=True):
        points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(places)), code)
        ends = [Gf.Vec3f(*end.tolist()) for end in (places.min(0), places.max(0))]
        extent.Set(Vt.Vec3fArray(ends), code)
    if moving.figure is not None:
        _usd_figure(stage, moving.figure, moving.time, codes)
    stage.GetRootLayer().documentation = "\n".join([*words(result, fabric), *moving.remarks])
    return usd_bytes(stage, ".usdc")


def _usd_figure(stage: Any, figure: Solids, time: Floats, codes: Floats) -> None:
    """Add the parts of a figure: rigid meshes whose transforms are sampled in time."""
    from pxr import Gf, UsdGeom, Vt

    UsdGeom.Xform.Define(stage, FIGURE)
    poses = figure.motion.at(time)
    for k, (name, (places, triangles)) in enumerate(zip(figure.names, figure.meshes, strict=True)):
        mesh = define_mesh(stage, f"{FIGURE}/{name}", triangles)
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(places.astype(np.float32)))
        mesh.CreateExtentAttr(Vt.Vec3fArray([Gf.Vec3f(*end.tolist()) for end in (places.min(0), places.max(0))]))
        mesh.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*SKIN_RGB)]))
        move = mesh.AddTransformOp()
        for code, pose in zip(codes.tolist(), poses[:, k].tolist(), strict=True):
            rows = [*pose[3:6], 0.0, *pose[6:9], 0.0, *pose[9:12], 0.0, *pose[:3], 1.0]
            move.Set(Gf.Matrix4d(*rows), code)


def gltf(result: FitResult, fabric: Fabric | None, moving: Moving) -> bytes:
    """Return a binary glTF 2.0 file of the motion."""
    places = np.stack([moving.places[..., 0], moving.places[..., 2], -moving.places[..., 1]], -1).astype(np.float32)
    frames = len(places)
    file = _Glb()
    first = file.add(places[0], "VEC3", VERTICES, has_ends=True)
    turned = np.stack([node_normals(one, moving.triangles) for one in places]).astype(np.float32)
    normals = file.add(turned[0], "VEC3", VERTICES)
    indices = file.add(moving.triangles.astype(np.uint32).ravel(), "SCALAR", INDICES, component=GLTF_UNSIGNED)
    flat = file.add(moving.rest.astype(np.float32), "VEC2", VERTICES)
    targets = [
        {
            "POSITION": file.add(places[n] - places[0], "VEC3", VERTICES, has_ends=True),
            "NORMAL": file.add(turned[n] - turned[0], "VEC3", VERTICES),
        }
        for n in range(1, frames)
    ]
    # Weight n - 1 of frame n is 1: frame 0 is the mesh itself.
    times = file.add(moving.time.astype(np.float32), "SCALAR", has_ends=True)
    weights = file.add(np.eye(frames, frames - 1, -1, dtype=np.float32).ravel(), "SCALAR")
    cautions = [*words(result, fabric), *moving.remarks]
    meshes, nodes, samplers, channels = _gltf_figure(file, moving.figure, moving.time, times)
    return file.finish(
        {
            "asset": {
                "version": "2.0", "generator": provenance(result)["generator"],
                "extras": {"hangtime": provenance(result), "cautions": cautions},
            },
            "scene": 0,
            "scenes": [{"nodes": list(range(1 + len(nodes))), "name": moving.name}],
            "nodes": [{"mesh": 0, "name": "cloth"}, *nodes],
            "materials": [
                {
                    "doubleSided": True, "name": "cloth",
                    "pbrMetallicRoughness": {
                        "baseColorFactor": [0.35, 0.45, 0.65, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9
                    },
                },
                *(
                    [{
                        "name": "figure",
                        "pbrMetallicRoughness": {
                            "baseColorFactor": [*SKIN_RGB, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8
                        },
                    }] if nodes else []
                ),
            ],
            "meshes": [
                {
                    "name": "cloth", "weights": [0.0] * (frames - 1),
                    "primitives": [
                        {
                            "attributes": {"POSITION": first, "NORMAL": normals, "TEXCOORD_0": flat},
                            "indices": indices, "material": 0, "targets": targets,
                        }
                    ],
                },
                *meshes,
            ],
            "animations": [
                {
                    "name": "swing",
                    "samplers": [{"input": times, "output": weights, "interpolation": "LINEAR"}, *samplers],
                    "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}, *channels],
                }
            ],
        }
    )  # fmt: skip


def _gltf_figure(
    file: _Glb, figure: Solids | None, time: Floats, times: int
) -> tuple[list[Any], list[Any], list[Any], list[Any]]:
    """Add the parts of a figure to a file: meshes, nodes, and samplers and channels of their motion."""
    meshes: list[Any] = []
    nodes: list[Any] = []
    samplers: list[Any] = []
    channels: list[Any] = []
    if figure is None:
        return meshes, nodes, samplers, channels
    from scipy.spatial.transform import Rotation

    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    poses = figure.motion.at(time)
    for k, (name, (places, triangles)) in enumerate(zip(figure.names, figure.meshes, strict=True)):
        moved = poses[:, k, :3] @ turned.T
        turns = Rotation.from_matrix(turned @ poses[:, k, 3:].reshape(-1, 3, 3).transpose(0, 2, 1)).as_quat()
        # The quaternions q and -q are one rotation; a player interpolates the short way only between like signs.
        flips = np.cumprod(np.concatenate([[1.0], np.where((turns[1:] * turns[:-1]).sum(1) < 0, -1.0, 1.0)]))
        position = file.add(places.astype(np.float32), "VEC3", VERTICES, has_ends=True)
        normals = file.add(node_normals(places, triangles).astype(np.float32), "VEC3", VERTICES)
        indices = file.add(triangles.astype(np.uint32).ravel(), "SCALAR", INDICES, component=GLTF_UNSIGNED)
        meshes.append(
            {
                "name": name,
                "primitives": [
                    {"attributes": {"POSITION": position, "NORMAL": normals}, "indices": indices, "material": 1}
                ],
            }
        )
        node, first = 1 + k, 1 + 2 * k
        nodes.append({"mesh": 1 + k, "name": name, "translation": moved[0].tolist(), "rotation": turns[0].tolist()})
        for path, values, kind in (("translation", moved, "VEC3"), ("rotation", turns * flips[:, None], "VEC4")):
            output = file.add(values.astype(np.float32), kind)
            samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
            channels.append({"sampler": first + (path == "rotation"), "target": {"node": node, "path": path}})
    return meshes, nodes, samplers, channels


class _Glb:
    """Builder of a glTF file: accessors and binary part."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._accessors: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []

    def add(
        self, values: Floats | Any, kind: str, target: int | None = None, *, component: int = GLTF_FLOAT,
        has_ends: bool = False,
    ) -> int:  # fmt: skip
        """Append an array and return the number of its accessor."""
        raw = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": len(raw)}
        self._views.append(view | ({"target": target} if target is not None else {}))
        accessor = {
            "bufferView": len(self._views) - 1, "componentType": component, "count": len(values), "type": kind
        }  # fmt: skip
        if has_ends:
            rows = np.asarray(values, np.float32).reshape(len(values), -1)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self._accessors.append(accessor)
        self._bytes += raw + b"\0" * (-len(raw) % 4)
        return len(self._accessors) - 1

    def finish(self, document: dict[str, Any]) -> bytes:
        """Return the file: header, JSON chunk, binary chunk."""
        document |= {
            "accessors": self._accessors, "bufferViews": self._views, "buffers": [{"byteLength": len(self._bytes)}]
        }  # fmt: skip
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self._bytes), 0x004E4942) + bytes(self._bytes)
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def pc2(moving: Moving) -> bytes:
    """Return a PC2 point cache of a motion at an even rate; the OBJ of `obj` has its points and faces."""
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, moving.places.shape[1], 0.0, 1.0, len(moving.places))
    return head + np.ascontiguousarray(moving.places, "<f4").tobytes()


def obj(result: FitResult, fabric: Fabric | None, moving: Moving) -> bytes:
    """Return the first frame of the motion of `pc2` as an OBJ, with the provenance that PC2 cannot hold."""
    lines = [f"# {line}" for line in words(result, fabric)]
    lines.append(f"# Motion: {len(moving.places)} samples at {moving.rate:.6g} a second, z up, metres.")
    lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in moving.places[0].tolist()]
    lines += [f"vt {x:.7g} {y:.7g}" for x, y in moving.rest.tolist()]
    lines += [f"f {' '.join(f'{i + 1}/{i + 1}' for i in face)}" for face in moving.triangles.tolist()]
    return ("\n".join(lines) + "\n").encode()
